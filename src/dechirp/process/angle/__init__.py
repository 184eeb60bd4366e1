"""Directions of what was detected: a family of estimators."""
