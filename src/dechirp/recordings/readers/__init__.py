"""Readers of recordings: a family, one file per format."""
