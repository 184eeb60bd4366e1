"""Sides of `side_by_side.py`: implementations of each job, and their alternating timing."""
