"""Axis limits that stay constant while noise moves the data."""

import math

import numpy as np

_STEP_DB = 10.0
_MAX_SPAN_DB = 100.0  # without noise, window sidelobes reach down 200 dB


def stable_top(largest: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten; 1 for zero."""
    if not largest > 0:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(largest))
    return next(step * decade for step in (1, 2, 5, 10, 20) if step * decade >= largest)


def stable_limits_db(lowest_db: float, highest_db: float) -> tuple[float, float]:
    """Return limits in multiples of 10 dB around both levels, at most 100 dB apart."""
    top_db = _STEP_DB * math.ceil((highest_db + 2) / _STEP_DB)
    bottom_db = _STEP_DB * math.floor(lowest_db / _STEP_DB)
    return min(max(bottom_db, top_db - _MAX_SPAN_DB), top_db - _STEP_DB), top_db


def floor_db(level_db: np.ndarray) -> float:
    """Return the lower limit of a level axis: single noise cells reach down arbitrarily far."""
    return float(np.median(level_db)) - 12.0
