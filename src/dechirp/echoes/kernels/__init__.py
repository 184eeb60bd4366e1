"""Compiled sums over targets and samples."""
