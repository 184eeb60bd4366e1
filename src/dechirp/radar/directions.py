"""Tables over directions: values at azimuths and elevations, and between them in decibels."""

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import listed, number
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import PhysicsWarning

# Angles that came through degrees may lie a rounding error beyond their limits.
_SLACK = 1e-9
# A step that is so many times wider than half of the others is one where angles are missing.
_HOLE = 3.0


def keep_table(owner: object, name: str, *, at_least: float, at_most: float) -> None:
    """Keep a table over directions as tuples of floats, or raise `InvalidSetting`.

    Parameters
    ----------
    owner : value
        With fields `azimuth_rad` and `elevation_rad`, lists of ascending angles.
    name : str
        Its field of the values, powers or areas: a list of rows, a row for each elevation,
        with a value for each azimuth.
    at_least, at_most : float
        Bounds of the values; above 0, since zero has no level in decibels.

    Raises
    ------
    InvalidSetting
        About `Class.field.place`, places counted from 0: for angles out of order, twice or
        not finite, azimuths over more than a circle, elevations beyond the poles, a row
        that is missing or of another length, a value that is none (NaN is a gap).

    Warns
    -----
    PhysicsWarning
        For a hole: a step over three times as wide as the median of the steps.
    """
    azimuths = _angles(owner, "azimuth_rad", at_most_rad=2 * math.pi)
    elevations = _angles(owner, "elevation_rad", at_most_rad=math.pi / 2)
    owner_name = type(owner).__name__
    for place, azimuth in enumerate(azimuths):
        if azimuth - azimuths[0] > 2 * math.pi + _SLACK:
            raise InvalidSetting(
                f"{owner_name}.azimuth_rad.{place}",
                got=f"{_deg(azimuth - azimuths[0])} past the first",
                need="at most 360 deg past it",
                fix="Keep one turn.",
            )
    where = f"{owner_name}.{name}"
    rows = _members(where, getattr(owner, name), "row", f"{len(elevations)}, one an elevation")
    _must_be_as_many(where, len(rows), len(elevations), "rows, one for each elevation")
    made = []
    for i, row in enumerate(rows):
        here = f"{where}.{i}"
        cells = _members(here, row, "value", f"{len(azimuths)}, one an azimuth")
        _must_be_as_many(here, len(cells), len(azimuths), "values, one for each azimuth")
        made.append(
            tuple(
                number(f"{here}.{j}", cell, at_least=at_least, at_most=at_most)
                for j, cell in enumerate(cells)
            )
        )
    object.__setattr__(owner, "azimuth_rad", azimuths)
    object.__setattr__(owner, "elevation_rad", elevations)
    object.__setattr__(owner, name, tuple(made))
    for field, angles in (("azimuth_rad", azimuths), ("elevation_rad", elevations)):
        missing = hole(angles)
        if missing:
            warnings.warn(
                f"{owner_name}.{field} has a hole {missing}: values in it are drawn in a straight"
                " line of decibels.",
                PhysicsWarning,
                stacklevel=4,  # where the owner is made
            )


def hole(angles_rad: tuple[float, ...]) -> str:
    """Say where a table of ascending angles has a hole, over three usual steps wide; or nothing."""
    steps = np.diff(angles_rad)
    widest = int(np.argmax(steps)) if steps.size else 0
    if not steps.size or steps[widest] <= _HOLE * np.median(steps):
        return ""
    ends = f"from {_deg(angles_rad[widest])} to {_deg(angles_rad[widest + 1])}"
    return f"{ends}, where other steps are {_deg(float(np.median(steps)))}"


def interpolated(
    azimuths_rad: ArrayLike,
    elevations_rad: ArrayLike,
    values: ArrayLike,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
) -> np.ndarray:
    """Read a table over directions, bilinear in decibels.

    In decibels because patterns fall by tens of them from one sample to the next: half way
    between 0 and -20 dB is -10 dB, where a straight line of powers says -3 dB.

    Parameters
    ----------
    azimuths_rad : array (n_azimuths,), rad
        Ascending.
    elevations_rad : array (n_elevations,), rad
        Ascending. A table of one azimuth or one elevation is constant along it.
    values : array (n_elevations, n_azimuths)
        Above 0.
    azimuth_rad, elevation_rad : array, rad
        Where to read it; any shapes that broadcast. Azimuths may be whole turns away.

    Returns
    -------
    array
        In the unit of the values; the broadcast shape.

    Notes
    -----
    Round a whole circle it wraps: where the gap from the last azimuth to the first is no
    wider than the widest step. Outside what a smaller table covers, the value at the
    nearest edge holds.
    """
    azimuths, elevations = np.asarray(azimuths_rad, float), np.asarray(elevations_rad, float)
    levels = np.log(np.asarray(values, dtype=float))
    azimuth, elevation = np.broadcast_arrays(
        np.asarray(azimuth_rad, dtype=float), np.asarray(elevation_rad, dtype=float)
    )
    gap = 2 * math.pi - (azimuths[-1] - azimuths[0])
    if azimuths.size > 1 and gap <= np.diff(azimuths).max() + _SLACK:
        start = azimuths[0]
        if gap > _SLACK:
            azimuths = np.append(azimuths, start + 2 * math.pi)
            levels = np.concatenate([levels, levels[:, :1]], axis=1)
    else:
        start = (azimuths[0] + azimuths[-1]) / 2 - math.pi  # the edge that is nearest holds
    left, right, u = _between(azimuths, start + np.mod(azimuth - start, 2 * math.pi))
    below, above, v = _between(elevations, elevation)
    low = (1 - u) * levels[below, left] + u * levels[below, right]
    high = (1 - u) * levels[above, left] + u * levels[above, right]
    return np.asarray(np.exp((1 - v) * low + v * high))


def _between(nodes: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of the nodes about each x, and how far it is from the one to the other, 0 to 1."""
    if nodes.size == 1:
        first = np.zeros(x.shape, dtype=int)
        return first, first, np.zeros(x.shape)
    x = np.clip(x, nodes[0], nodes[-1])
    place = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    return place, place + 1, (x - nodes[place]) / (nodes[place + 1] - nodes[place])


def _angles(owner: object, field: str, *, at_most_rad: float) -> tuple[float, ...]:
    where = f"{type(owner).__name__}.{field}"
    most = at_most_rad + _SLACK
    angles = [
        number(f"{where}.{place}", angle, at_least=-most, at_most=most)
        for place, angle in enumerate(
            _members(where, getattr(owner, field), "angle", "at least one")
        )
    ]
    for place in range(1, len(angles)):
        if angles[place] <= angles[place - 1]:
            raise InvalidSetting(
                f"{where}.{place}",
                got=f"{_deg(angles[place])} after {_deg(angles[place - 1])}",
                need="above the angle before it",
                fix="Sort the angles, each once, and the values with them.",
            )
    return tuple(angles)


def _members(where: str, given: Any, what: str, need: str) -> tuple[Any, ...]:
    members = listed(given)
    if not members:
        raise InvalidSetting(
            where,
            got=given,
            need=f"a list of {what}s: {need}",
            fix="Write them in brackets, with commas between.",
        )
    return members


def _must_be_as_many(where: str, n: int, need: int, of_what: str) -> None:
    if n != need:
        raise InvalidSetting(
            where,
            got=f"{n} {of_what.partition(',')[0]}",
            need=f"{need} {of_what}",
            fix="Add what is missing, or take out what is too much.",
        )


def _deg(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.6g} deg"
