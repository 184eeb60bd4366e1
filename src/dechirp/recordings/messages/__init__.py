"""Messages of ROS in MCAP, SQLite and bag files, and point clouds in files."""
