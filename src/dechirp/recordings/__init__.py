"""Recordings: a family of formats, and the settings files that come with them."""
