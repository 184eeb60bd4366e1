"""Settings files of recordings in the formats of vendors."""
