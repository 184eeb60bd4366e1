"""Impairments, a family: oscillator, propagation and receiver effects."""
