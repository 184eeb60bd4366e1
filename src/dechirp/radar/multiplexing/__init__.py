"""Multiplexing, a family: sharing of the chirps of a frame among transmitters."""
