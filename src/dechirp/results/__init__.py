"""Results on disk: tables, the cube, and folders that are there whole or not at all."""
