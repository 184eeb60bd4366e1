"""Simulated twin of a recording, and its comparison with the recording."""
