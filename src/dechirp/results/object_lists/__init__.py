"""The object list for others: CAN FD, Ethernet, ASAM OSI, point clouds and tables."""
