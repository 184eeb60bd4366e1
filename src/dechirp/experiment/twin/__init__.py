"""A recording and its simulation side by side."""
