"""Judging results: rates, distances, consistency, and whose track is whose."""
