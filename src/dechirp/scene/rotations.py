"""Turning vectors from the axes of one thing into those of another."""

import numpy as np


def about_z(angle_rad: np.ndarray) -> np.ndarray:
    """Rotations to the left by angles of any shape, (..., 3, 3)."""
    c, s, zero = np.cos(angle_rad), np.sin(angle_rad), np.zeros_like(angle_rad)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def into(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Components along axes of vectors, which are given by those in the axes around.

    Parameters
    ----------
    axes : array (n_times, 3, 3)
        Unit vectors as columns.
    vectors : array (n_times, n, 3)
    """
    return np.asarray(vectors @ axes)


def out_of(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Undo `into`: from components along axes to those in the axes around."""
    return np.asarray(vectors @ np.swapaxes(axes, -1, -2))
