"""Fixed-point processing up to the detector, bit-accurate for given word lengths."""
