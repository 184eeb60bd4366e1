"""Even grids on which the elements of an array lie, holes allowed."""

from typing import NamedTuple

import numpy as np

# How far elements may lie off, in wavelengths: 0.4 degrees of phase.
_OFF = 1e-3
# A grid finer than an eighth of a wavelength is one by chance, and nearly empty.
_LEAST_STEP = 0.125


class Places(NamedTuple):
    """Where the elements are on an even grid across the line of sight."""

    step: tuple[float, float]
    """Along y and z, in wavelengths; 1 where the elements share one coordinate."""
    place: np.ndarray
    """(n_elements, 2) whole steps along y and z from the first."""


def places(positions: np.ndarray) -> Places | None:
    """The coarsest even grid on which all elements lie, within 0.4 degrees of phase, or None.

    `positions` (n_elements, 3), in wavelengths.
    """
    across = positions - positions.min(axis=0)
    if across[:, 0].max() > _OFF:
        return None
    step_y, step_z = (_common_step(along) for along in across[:, 1:].T)
    place = np.rint(across[:, 1:] / [step_y, step_z])
    off = np.abs(across[:, 1:] - place * [step_y, step_z]).max()
    if min(step_y, step_z) < _LEAST_STEP or off > _OFF:
        return None
    return Places((step_y, step_z), place.astype(int))


def _common_step(along: np.ndarray) -> float:
    """Step of which coordinates, the least being 0, are whole multiples; 1 if all are 0."""
    step = 0.0
    for one in along:
        # Euclid's algorithm, with lengths of a few tolerances taken as none.
        longer, shorter = max(step, float(one)), min(step, float(one))
        while shorter > 4 * _OFF:
            longer, shorter = shorter, abs(longer - shorter * round(longer / shorter))
        step = longer
    if step <= 4 * _OFF:
        return 1.0
    place = np.rint(along / step)
    return float(along @ place / (place @ place))  # least squares over all of them
