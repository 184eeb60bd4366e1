"""What the radar looks at, and the truth about it."""
