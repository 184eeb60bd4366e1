"""Ends of axes that stand still while noise moves what is drawn."""

import math

import numpy as np

_STEP_DB = 10.0
_MOST_DB = 100.0  # without noise, what a window leaves of its sidelobes is 200 dB down


def steady_top(largest: float) -> float:
    """The next of 1, 2, 5 and 10 times a power of ten; 1 for none."""
    if not largest > 0:
        return 1.0
    ten = 10.0 ** math.floor(math.log10(largest))
    return next(step * ten for step in (1, 2, 5, 10, 20) if step * ten >= largest)


def steady_db(lowest_db: float, highest_db: float) -> tuple[float, float]:
    """Whole tens of decibels about both, at most 100 dB apart."""
    top_db = _STEP_DB * math.ceil((highest_db + 2) / _STEP_DB)
    bottom_db = _STEP_DB * math.floor(lowest_db / _STEP_DB)
    return min(max(bottom_db, top_db - _MOST_DB), top_db - _STEP_DB), top_db


def floor_db(level_db: np.ndarray) -> float:
    """Where an axis of levels may begin: single cells of noise reach down without end."""
    return float(np.median(level_db)) - 12.0
