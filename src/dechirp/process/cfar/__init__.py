"""Constant-false-alarm-rate thresholds: a family of noise estimators."""
