"""Rotations between coordinate axes."""

import numpy as np


def rotation_about_z(angle_rad: np.ndarray) -> np.ndarray:
    """Return rotations to the left by angles of any shape, (..., 3, 3)."""
    c, s, zero = np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def to_local_axes(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the components of vectors along local axes.

    Parameters
    ----------
    axes : array (n_times, 3, 3)
        Unit vectors as columns.
    vectors : array (n_times, n, 3)
        Components in the outer axes.
    """
    return np.asarray(vectors @ axes)


def from_local_axes(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the components in the outer axes of vectors given along local axes."""
    return np.asarray(vectors @ np.swapaxes(axes, -1, -2))
