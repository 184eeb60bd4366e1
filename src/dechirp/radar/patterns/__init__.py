"""Antenna patterns, a family."""
