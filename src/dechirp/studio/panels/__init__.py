"""What is turned and read beside the views."""
