"""Members of three families of dechirp, from another package."""
