"""Views of a frame: one file per tile."""
