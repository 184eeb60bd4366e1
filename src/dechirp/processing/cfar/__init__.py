"""CFAR detectors, a family of noise estimators for constant-false-alarm-rate thresholds."""
