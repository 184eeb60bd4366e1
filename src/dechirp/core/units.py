"""Physical constants, and conversion to and from decibels."""

import numpy as np
from numpy.typing import ArrayLike

SPEED_OF_LIGHT = 299_792_458.0  # m/s
BOLTZMANN = 1.380_649e-23  # J/K
REFERENCE_TEMPERATURE = 290.0  # K, at which noise figures are defined


def to_decibels(power_ratio: ArrayLike) -> np.ndarray:
    """Convert a power ratio to dB; the caller squares amplitudes."""
    return 10.0 * np.log10(power_ratio)


def from_decibels(level_db: ArrayLike) -> np.ndarray:
    """Convert a level in dB to a power ratio."""
    return 10.0 ** (np.asarray(level_db, dtype=float) / 10.0)
