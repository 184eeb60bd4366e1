"""Messages of ROS 2 in MCAP and SQLite files."""
