"""Steps of each object of a traffic file: common times, typical steps and gaps."""

import numpy as np
import xarray as xr

SAME_TIME_S = 1e-6
"""Times this close are one step: an object of 100 m/s moves 0.1 mm."""
_ROUNDING_ULPS = 4  # of Unix times, 1 us; times above 1e12 s, where it is 0.5 ms, are refused
_LONGEST_GAP_STEPS = 4.5
"""Up to three missing rows. At 10 Hz, full braking in between, 12 m/s^2, leaves the path by at most
a T^2 / 8 = 0.24 m; a path through a longer gap would be a guess."""
_SINGLE_STEP_S = 1.0  # presence of objects in a trace of one step


def join_times_s(times_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ascending steps of times that differ by more than rounding, and each one's index.

    Files contain 0.3 beside 3 * 0.1, which differ in the last bit.
    """
    distinct_s, at_distinct = np.unique(times_s, return_inverse=True)
    tolerance_s = max(SAME_TIME_S, _ROUNDING_ULPS * float(np.spacing(np.abs(distinct_s).max())))
    is_new = np.concatenate([[True], np.diff(distinct_s) > tolerance_s])
    return distinct_s[is_new], (np.cumsum(is_new) - 1)[at_distinct]


def typical_steps_s(objects: xr.Dataset) -> np.ndarray:
    """Return the median step of each object, (n_objects,).

    An object of less than three rows has no rate of its own: its step is the median of all objects.
    """
    times_s, is_present = objects["time"].values, np.isfinite(objects["x"].values)
    steps_s = np.full(len(is_present), np.nan)
    has_rate = is_present.sum(axis=1) > 2
    for index, present in enumerate(is_present):
        if present.sum() > 1:
            steps_s[index] = np.median(np.diff(times_s[present]))
    is_known = np.isfinite(steps_s)
    if not is_known.any():
        return np.full(len(steps_s), _SINGLE_STEP_S)
    has_rate &= is_known
    of_all_s = np.median(steps_s[has_rate if has_rate.any() else is_known])
    return np.where(has_rate, steps_s, of_all_s)


def find_gaps(times_s: np.ndarray, present: np.ndarray, step_s: float) -> np.ndarray:
    """Return whether an object is absent between its steps, (n-1,).

    Parameters
    ----------
    times_s : array of float
        Times of all steps of the file.
    present : array of int
        Indices of the times at which the object has a row.
    step_s : float
        Its typical step. Objects of several rates have rows at different times, and rows get lost.
    """
    return np.asarray(np.diff(times_s[present]) > _LONGEST_GAP_STEPS * step_s)


def count_bridged_rows(times_s: np.ndarray, present: np.ndarray, step_s: float) -> np.ndarray:
    """Return the number of rows that are missing between the steps of an object, (n-1,).

    It is 0 in gaps. The parameters are those of `find_gaps`.
    """
    n_steps = np.rint(np.diff(times_s[present]) / step_s).astype(int)
    return np.where(find_gaps(times_s, present, step_s), 0, np.maximum(n_steps - 1, 0))
