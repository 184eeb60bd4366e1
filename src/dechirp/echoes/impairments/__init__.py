"""What hardware does to the echoes: a family."""
