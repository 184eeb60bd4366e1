"""What moves, and how: the radar itself from one frame, objects from frame to frame."""
