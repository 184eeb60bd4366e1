"""How the ramps of a frame differ from each other: a family."""
