"""Writers of recordings: a family, one file for each format."""
