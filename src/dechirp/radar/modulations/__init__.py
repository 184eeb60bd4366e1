"""Modulations, a family: differences between the ramps of a round."""
