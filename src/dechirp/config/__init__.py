"""Settings files: the only place where text becomes values."""
