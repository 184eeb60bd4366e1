"""Motion of the radar from one frame, and tracks of objects from frame to frame."""
