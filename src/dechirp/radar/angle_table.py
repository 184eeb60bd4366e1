"""Tables over azimuth and elevation: checks, and interpolation in decibels."""

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import as_tuple_or_none, check_number
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning

# Angles converted from degrees may exceed their limits by a rounding error.
_ANGLE_TOLERANCE_RAD = 1e-9
# A step wider than this multiple of the median step is a gap.
_MAX_STEP_RATIO = 3.0


def check_angle_table(owner: object, name: str, *, at_least: float, at_most: float) -> None:
    """Convert a table over directions to tuples of floats, or raise `InvalidSetting`.

    Parameters
    ----------
    owner : value
        Value with fields `azimuth_rad` and `elevation_rad`, lists of ascending angles.
    name : str
        Field of the tabulated powers or areas: a list of rows, one for each elevation, with a
        value for each azimuth.
    at_least, at_most : float
        Bounds of the values, above 0, since zero has no decibel value.

    Raises
    ------
    InvalidSetting
        About `Class.field.index`, counted from 0: for unsorted, repeated or non-finite angles,
        azimuths over more than a circle, elevations beyond the poles, a missing row, a row of
        another length, an invalid value (NaN included).

    Warns
    -----
    PhysicsWarning
        For a gap: a step over three times as wide as the median step.
    """
    azimuths = _check_ascending_angles(owner, "azimuth_rad", at_most_rad=2 * math.pi)
    elevations = _check_ascending_angles(owner, "elevation_rad", at_most_rad=math.pi / 2)
    owner_name = type(owner).__name__
    for index, azimuth in enumerate(azimuths):
        if azimuth - azimuths[0] > 2 * math.pi + _ANGLE_TOLERANCE_RAD:
            raise InvalidSetting(
                f"{owner_name}.azimuth_rad.{index}",
                value=f"{_format_degrees(azimuth - azimuths[0])} past the first",
                expected="at most 360 deg past it",
                fix="keep one turn",
            )
    setting = f"{owner_name}.{name}"
    rows = _check_nonempty_list(
        setting, getattr(owner, name), "row", f"{len(elevations)}, one an elevation"
    )
    _check_entry_count(setting, len(rows), len(elevations), "rows, one for each elevation")
    checked_rows = []
    for i, row in enumerate(rows):
        row_setting = f"{setting}.{i}"
        cells = _check_nonempty_list(row_setting, row, "value", f"{len(azimuths)}, one an azimuth")
        _check_entry_count(row_setting, len(cells), len(azimuths), "values, one for each azimuth")
        checked_rows.append(
            tuple(
                check_number(f"{row_setting}.{j}", cell, at_least=at_least, at_most=at_most)
                for j, cell in enumerate(cells)
            )
        )
    object.__setattr__(owner, "azimuth_rad", azimuths)
    object.__setattr__(owner, "elevation_rad", elevations)
    object.__setattr__(owner, name, tuple(checked_rows))
    for field, angles in (("azimuth_rad", azimuths), ("elevation_rad", elevations)):
        gap = describe_wide_angle_gap(angles)
        if gap:
            warnings.warn(
                f"{owner_name}.{field} has a gap {gap}: values in it are interpolated"
                " linearly in decibels.",
                PhysicsWarning,
                stacklevel=4,  # the constructor of the owner
            )


def describe_wide_angle_gap(angles_rad: tuple[float, ...]) -> str:
    """Describe the widest gap of ascending angles, over three median steps, or return ""."""
    steps = np.diff(angles_rad)
    widest = int(np.argmax(steps)) if steps.size else 0
    if not steps.size or steps[widest] <= _MAX_STEP_RATIO * np.median(steps):
        return ""
    ends = (
        f"from {_format_degrees(angles_rad[widest])} to {_format_degrees(angles_rad[widest + 1])}"
    )
    return f"{ends}, where other steps are {_format_degrees(float(np.median(steps)))}"


def interpolate_angle_table(
    azimuths_rad: ArrayLike,
    elevations_rad: ArrayLike,
    values: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
) -> np.ndarray:
    """Interpolate a table over directions, bilinearly in decibels.

    Patterns fall by tens of decibels from one sample to the next: half way between 0 and
    -20 dB the result is -10 dB, where linear interpolation of powers would give -3 dB.

    Parameters
    ----------
    azimuths_rad : array (n_azimuths,), rad
        Ascending.
    elevations_rad : array (n_elevations,), rad
        Ascending. A table of one azimuth or one elevation is constant along it.
    values : array (n_elevations, n_azimuths)
        Above 0.
    azimuth_rad, elevation_rad : array, rad
        Directions at which to interpolate; any shapes that broadcast. Azimuths may be off by
        whole turns.

    Returns
    -------
    array
        In the unit of the values; the broadcast shape.

    Notes
    -----
    The table wraps round a full circle where the gap from the last azimuth to the first is no
    wider than the widest step. Outside a smaller table the value at the nearest edge holds.
    """
    azimuths, elevations = np.asarray(azimuths_rad, float), np.asarray(elevations_rad, float)
    levels = np.log(np.asarray(values, dtype=float))
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth_rad, dtype=float), np.asarray(elevation_rad, dtype=float)
    )
    gap = 2 * math.pi - (azimuths[-1] - azimuths[0])
    if azimuths.size > 1 and gap <= np.diff(azimuths).max() + _ANGLE_TOLERANCE_RAD:
        start = azimuths[0]
        if gap > _ANGLE_TOLERANCE_RAD:
            azimuths = np.append(azimuths, start + 2 * math.pi)
            levels = np.concatenate([levels, levels[:, :1]], axis=1)
    else:
        start = (azimuths[0] + azimuths[-1]) / 2 - math.pi  # the nearest edge holds
    left_index, right_index, u = _bracketing_indices_and_fractions(
        azimuths, start + np.mod(azimuth - start, 2 * math.pi)
    )
    below, above, v = _bracketing_indices_and_fractions(elevations, elevation)
    low = (1 - u) * levels[below, left_index] + u * levels[below, right_index]
    high = (1 - u) * levels[above, left_index] + u * levels[above, right_index]
    return np.asarray(np.exp((1 - v) * low + v * high))


def _bracketing_indices_and_fractions(
    nodes: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nodes below and above each x, and the fraction between them, 0 to 1."""
    if nodes.size == 1:
        first = np.zeros(x.shape, dtype=int)
        return first, first, np.zeros(x.shape)
    x = np.clip(x, nodes[0], nodes[-1])
    lower = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    return lower, lower + 1, (x - nodes[lower]) / (nodes[lower + 1] - nodes[lower])


def _check_ascending_angles(owner: object, field: str, *, at_most_rad: float) -> tuple[float, ...]:
    setting = f"{type(owner).__name__}.{field}"
    limit_rad = at_most_rad + _ANGLE_TOLERANCE_RAD
    angles = [
        check_number(f"{setting}.{index}", angle, at_least=-limit_rad, at_most=limit_rad)
        for index, angle in enumerate(
            _check_nonempty_list(setting, getattr(owner, field), "angle", "at least one")
        )
    ]
    for index in range(1, len(angles)):
        if angles[index] <= angles[index - 1]:
            raise InvalidSetting(
                f"{setting}.{index}",
                value=f"{_format_degrees(angles[index])} after"
                f" {_format_degrees(angles[index - 1])}",
                expected="above the angle before it",
                fix="sort the angles, each once, and the values with them",
            )
    return tuple(angles)


def _check_nonempty_list(setting: str, entries: Any, noun: str, expected: str) -> tuple[Any, ...]:
    members = as_tuple_or_none(entries)
    if not members:
        raise InvalidSetting(
            setting,
            value=entries,
            expected=f"a list of {noun}s: {expected}",
            fix="write them in brackets, with commas between",
        )
    return members


def _check_entry_count(setting: str, n: int, expected: int, contents: str) -> None:
    if n != expected:
        raise InvalidSetting(
            setting,
            value=f"{n} {contents.partition(',')[0]}",
            expected=f"{expected} {contents}",
            fix="add the missing entries or remove the extra ones",
        )


def _format_degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.6g} deg"
