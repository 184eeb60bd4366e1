"""Recordings for other tools: writers of files, and from one format to another."""
