"""Studio: an interactive web page of a radar and its processing."""
