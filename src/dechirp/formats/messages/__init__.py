"""Messages of ROS 2 in files: where they lie, and what they say."""
