"""Directions from spectra on a grid: maximum, refined by a parabola through the logarithm."""

import numpy as np


def directions(spectra: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """Estimate the azimuth of each row, rad, from powers (n, n_sines) on equally spaced sines."""
    top = np.clip(np.argmax(spectra, axis=1), 1, len(sines) - 2)
    rows = np.arange(len(spectra))
    below, middle, above = (np.log(spectra[rows, top + k]) for k in (-1, 0, 1))
    curvature = np.minimum(below - 2 * middle + above, -1e-12)
    offset = np.clip((below - above) / (2 * curvature), -0.5, 0.5)
    return np.arcsin(np.clip(sines[top] + offset * (sines[1] - sines[0]), -1, 1))
