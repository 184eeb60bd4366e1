"""Headings of a traffic file compared with the directions in which the vehicles move."""

import numpy as np
import xarray as xr

from dechirp.core.display import format_count_with_noun
from dechirp.core.findings import Finding
from dechirp.core.text import join_names

_VEHICLES = ("car", "van", "truck", "bus", "motorcycle", "bicyclist")
_MOVES_M_PER_S = 2.0  # 0.1 m of jitter in 0.1 s turns the course of slower ones
_NEVER_REVERSES_M_PER_S = 10.0
_MAX_SLIP_RAD = np.radians(30.0)  # tyres slip by at most 15 degrees before a vehicle spins
_MIN_STEPS = 3
_ONE_TURN_RAD = 2 * np.pi + 0.01


def find_wrong_headings(objects: xr.Dataset) -> tuple[Finding, ...]:
    """Return warnings on headings that begin beyond one turn, or contradict the motion.

    Headings in degrees, clockwise or from north do so.

    Parameters
    ----------
    objects : Dataset
        Objects as `Traffic.objects`, with velocities.
    """
    return (*_headings_beyond_one_turn(objects), *_contradicting_headings(objects))


def _headings_beyond_one_turn(objects: xr.Dataset) -> tuple[Finding, ...]:
    """Return a warning if first headings exceed one turn; later ones may be unwrapped."""
    headings_rad = objects["heading"].values
    is_known = np.isfinite(headings_rad)
    first_rad = headings_rad[np.arange(len(headings_rad)), is_known.argmax(axis=1)]
    beyond = np.flatnonzero(np.abs(first_rad) > _ONE_TURN_RAD)  # false for NaN, which is unknown
    if not beyond.size:
        return ()
    names = [f"{objects['id'].values[index]} at {first_rad[index]:g}" for index in beyond.tolist()]
    return (
        Finding(
            level="warning",
            setting="traffic.heading",
            value=f"headings of {format_count_with_noun(len(names), 'object')} begin beyond one"
            f" turn: {join_names(names, at_most=4)}",
            expected="radians, counterclockwise from the x axis",
            fix="convert them if they are degrees; nothing to do if they are radians",
        ),
    )


def _contradicting_headings(objects: xr.Dataset) -> tuple[Finding, ...]:
    """Return a warning if vehicles move across or against their headings."""
    course_rad = np.arctan2(objects["vy"].values, objects["vx"].values)
    speeds = np.hypot(objects["vx"].values, objects["vy"].values)
    away = np.abs(np.exp(1j * (objects["heading"].values - course_rad)) - 1)  # 2 sin(angle / 2)
    away_rad = 2 * np.arcsin(np.minimum(away / 2, 1))
    slip_rad = np.minimum(away_rad, np.pi - away_rad)
    is_compared = (speeds > _MOVES_M_PER_S) & np.isfinite(away_rad)
    is_compared &= np.isin(objects["kind"].values, _VEHICLES)[:, None]
    is_wrong = slip_rad > _MAX_SLIP_RAD
    is_wrong |= (away_rad > np.pi / 2) & (speeds > _NEVER_REVERSES_M_PER_S)
    n_compared = is_compared.sum(axis=1)
    n_wrong = (is_compared & is_wrong).sum(axis=1)
    is_listed = (n_wrong >= _MIN_STEPS) & (n_wrong > n_compared / 2)
    if not is_listed.any():
        return ()
    names = []
    for index in np.flatnonzero(is_listed).tolist():
        angle_deg = np.degrees(np.median(away_rad[index, is_compared[index]]))
        names.append(f"{objects['id'].values[index]} by {angle_deg:.0f} deg")
    return (
        Finding(
            level="warning",
            setting="traffic.heading",
            value=f"headings of {format_count_with_noun(len(names), 'vehicle')} of"
            f" {int((n_compared >= _MIN_STEPS).sum())} that move differ from the directions of"
            f" their motion: {join_names(names, at_most=4)}",
            expected="radians, counterclockwise from the x axis, towards the front",
            fix="convert degrees, angles from north, or y axes to the right; or leave the headings"
            " out, which are the directions of the motion then",
        ),
    )
