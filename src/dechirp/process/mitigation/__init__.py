"""Clean-up of the samples of a frame: what stands still, leakage, interference."""
