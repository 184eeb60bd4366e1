"""Formats that recordings are written in."""
