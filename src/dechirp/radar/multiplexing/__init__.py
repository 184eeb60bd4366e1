"""How transmitters share the chirps of a frame: a family."""
