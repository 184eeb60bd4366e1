"""Mitigation of static echoes, leakage and interference in the samples of a frame."""
