"""The witness board: results compared with answers of other people, from their published files."""
