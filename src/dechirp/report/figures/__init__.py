"""Figures of the report, a file a subject; each returns SVG to stand in the page."""
