"""Directions from spectra over a grid: the highest point, and a parabola through its logarithm."""

import numpy as np


def directions(spectra: np.ndarray, sines: np.ndarray) -> np.ndarray:
    """Azimuth of each row, rad, from powers (n, n_sines) over evenly spaced sines."""
    top = np.clip(np.argmax(spectra, axis=1), 1, len(sines) - 2)
    rows = np.arange(len(spectra))
    below, middle, above = (np.log(spectra[rows, top + k]) for k in (-1, 0, 1))
    bend = np.minimum(below - 2 * middle + above, -1e-12)
    off = np.clip((below - above) / (2 * bend), -0.5, 0.5)
    return np.arcsin(np.clip(sines[top] + off * (sines[1] - sines[0]), -1, 1))
