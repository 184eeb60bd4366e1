"""Bare samples: their order, and which part comes first."""
