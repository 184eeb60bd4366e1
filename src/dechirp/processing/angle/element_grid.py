"""Even grid, possibly with holes, on which the elements of an array lie."""

from typing import NamedTuple

import numpy as np

# Largest deviation of an element, in wavelengths: 0.4 degrees of phase.
_MAX_DEVIATION = 1e-3
# A grid finer than an eighth of a wavelength is accidental, and nearly empty.
_MIN_SPACING = 0.125


class ElementGrid(NamedTuple):
    """Elements on an even grid across the line of sight."""

    spacing: tuple[float, float]
    """Spacing along y and z, in wavelengths; 1 where the elements share one coordinate."""
    indices: np.ndarray
    """Grid indices (n_elements, 2) along y and z from the first."""


def find_element_grid(positions: np.ndarray) -> ElementGrid | None:
    """Find the coarsest even grid that fits all elements within 0.4 degrees of phase, or None.

    `positions` (n_elements, 3), in wavelengths.
    """
    across = positions - positions.min(axis=0)
    if across[:, 0].max() > _MAX_DEVIATION:
        return None
    spacing_y, spacing_z = (_common_spacing(coordinates) for coordinates in across[:, 1:].T)
    indices = np.rint(across[:, 1:] / [spacing_y, spacing_z])
    deviation = np.abs(across[:, 1:] - indices * [spacing_y, spacing_z]).max()
    if min(spacing_y, spacing_z) < _MIN_SPACING or deviation > _MAX_DEVIATION:
        return None
    return ElementGrid((spacing_y, spacing_z), indices.astype(int))


def _common_spacing(coordinates: np.ndarray) -> float:
    """Return the spacing of which coordinates from 0 on are multiples; 1 if all are 0."""
    spacing = 0.0
    for coordinate in coordinates:
        # Euclid's algorithm, with lengths of a few tolerances taken as 0.
        longer, shorter = max(spacing, float(coordinate)), min(spacing, float(coordinate))
        while shorter > 4 * _MAX_DEVIATION:
            longer, shorter = shorter, abs(longer - shorter * round(longer / shorter))
        spacing = longer
    if spacing <= 4 * _MAX_DEVIATION:
        return 1.0
    indices = np.rint(coordinates / spacing)
    return float(coordinates @ indices / (indices @ indices))  # least squares
