"""Detections drawn from what theory says of cells and estimates, without samples."""
