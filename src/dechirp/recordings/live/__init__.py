"""Samples that are still arriving: files that grow, and packets."""
