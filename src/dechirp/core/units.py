"""Physical constants, units of samples, and conversion to and from decibels."""

import numpy as np
from numpy.typing import ArrayLike

SPEED_OF_LIGHT = 299_792_458.0  # m/s
BOLTZMANN = 1.380_649e-23  # J/K
REFERENCE_TEMPERATURE = 290.0  # K, at which noise figures are defined


SAMPLE_UNITS = ("W**0.5", "1")
"""Units of samples, absolute or relative to a full scale of 1, in the syntax of pint."""
_EARLIER_UNITS = {"sqrt(W)": "W**0.5", "full scale": "1", "full scale squared": "1"}


def current_units(units: object) -> str:
    """Return units as they are named today: files of earlier versions contain `sqrt(W)`."""
    return _EARLIER_UNITS.get(str(units), str(units))


def is_absolute(sample_units: object) -> bool:
    """Return whether samples are in W**0.5, and not relative to full scale."""
    return current_units(sample_units) == "W**0.5"


def power_units(sample_units: object) -> str:
    """Return the units of the squared samples: W, or 1 for the square of full scale."""
    return "W" if is_absolute(sample_units) else "1"


def to_decibels(power_ratio: ArrayLike) -> np.ndarray:
    """Convert a power ratio to dB; the caller squares amplitudes."""
    return 10.0 * np.log10(power_ratio)


def from_decibels(level_db: ArrayLike) -> np.ndarray:
    """Convert a level in dB to a power ratio."""
    return 10.0 ** (np.asarray(level_db, dtype=float) / 10.0)
