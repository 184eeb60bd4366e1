"""Panels: groups of widgets beside the views, one file each."""
