"""Array calibration from a reflector at known positions."""
