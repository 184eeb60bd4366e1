"""Kernels that sum the echoes of scatterers: direct, low-rank and non-uniform FFT."""
