"""Detections beside the truth: which belongs to which, and how far off it is."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from dechirp.radar.cells import in_cells, in_one_fold
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, folded, frequencies, seen, wrapped
from dechirp.scene.rcs import cross_sections_m2
from dechirp.scene.scene import Scene

_CELLS = 2.0  # a detection is its target's within two resolution cells on every estimated axis

# What reflects 60 dB less than the strongest of its body is hidden, or in a null.
_HIDDEN = 1e-6

# Ranges are differenced over it: 1e-8 m/s off at 100 m, and wheels and rotors do not turn.
_MOMENT_S = 1e-6


class Match(NamedTuple):
    """For each detection: its target, -1 for none, and its errors, NaN where there is none.

    A body has no one place to be off from: NaN.
    """

    target: np.ndarray
    range_error_m: np.ndarray
    velocity_error_m_per_s: np.ndarray
    azimuth_error_rad: np.ndarray
    elevation_error_rad: np.ndarray


def on_map(place: Place, radar: Radar) -> Place:
    """Return where such peaks lie on the map: coupling put back, velocities folded."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = frequencies(place, radar)
    doppler_hz = wrapped(doppler_hz, 1 / radar.frame.repetition_s)
    return Place(chirp.range_m(1.0) * beat_hz, doppler_hz * chirp.wavelength_m / 2)


def scatterers(scene: Scene, times_s: ArrayLike) -> Place:
    """Range of each scatterer at each time and its rate of change, (n_times, n_scatterers)."""
    times_s = np.asarray(times_s, dtype=float)
    before_m, at_m, after_m = (
        np.linalg.norm(scene.positions_m(times_s + shift_s), axis=-1)
        for shift_s in (-_MOMENT_S, 0.0, _MOMENT_S)
    )
    return Place(at_m, (after_m - before_m) / (2 * _MOMENT_S))


def in_bodies(scene: Scene, at_most: int, among: np.ndarray | None = None) -> np.ndarray:
    """Scatterers of bodies, places in the list, so many at most, spread over all.

    `among`: whether each may be one of them, (n_scatterers,); all without it.
    """
    has_body = np.array([target.body is not None for target in scene.targets], dtype=bool)
    chosen = has_body[scene.owners]
    places = np.flatnonzero(chosen if among is None else chosen & among)
    return places[:: -(-len(places) // at_most) or 1]


def visible(scene: Scene, time_s: float, radar: Radar) -> np.ndarray:
    """Whether each scatterer sends something back: not those on the far side of a car."""
    rcs_m2 = cross_sections_m2(scene, time_s, radar.frame.chirp.wavelength_m)
    strongest_m2 = np.zeros(len(scene.targets))
    np.maximum.at(strongest_m2, scene.owners, rcs_m2)
    return rcs_m2 > _HIDDEN * strongest_m2[scene.owners]


def match(
    detections: xr.Dataset, truth: xr.Dataset, radar: Radar, scene: Scene | None = None
) -> Match:
    """Give each detection to the nearest target of its frame, within two cells on every axis.

    Where the fold of a velocity is not known its direction counts only if there is a target in it.

    A body of the scene is where its scatterers are, on parts that move as well, the hidden ones
    left out; without the scene it is where its origin is.
    """
    expected = seen(truth, radar)
    folds = radar.frame.n_folds if radar.frame.n_intervals == 1 else None
    unfolded = seen(truth, radar, folds=folds)
    of_frame = {int(frame): index for index, frame in enumerate(truth.frame.values)}
    index = np.array([of_frame[int(frame)] for frame in detections.frame.values], dtype=int)
    target, span = np.full(len(index), -1), np.zeros(len(index))
    for at in np.unique(index):
        owners, places = np.arange(truth.sizes["target"]), Place(*(of.T[at] for of in expected))
        of_truth = truth.transpose("target", "frame").isel(frame=at)
        towards = _Towards(of_truth.azimuth.values, of_truth.elevation.values)
        if scene is not None:
            shown = visible(scene, float(truth.time[at]), radar)
            owners = scene.owners[shown]
            moving = scatterers(scene, truth.time.values[at : at + 1])
            one = radar.at(int(truth.frame[at]))
            places = folded(Place(*(of[0, shown] for of in moving)), one)
            x, y, z = scene.positions_m(truth.time.values[at : at + 1])[0, shown].T
            towards = _Towards(np.arctan2(y, x), np.arctan2(z, np.hypot(x, y)))
        own = index == at
        rows, one = detections.isel(detection=own), radar.at(int(truth.frame[at]))
        span[own] = 2 * one.frame.max_velocity_m_per_s
        place = Place(rows.range.values, rows.velocity.values)
        angles = _Towards(*(_estimated(rows, name) for name in ("azimuth", "elevation")))
        found, there = (
            in_one_fold(
                in_cells(r.range_m, r.velocity_m_per_s, u.azimuth_rad, u.elevation_rad, one),
                one.frame.n_chirps,
            )
            for r, u in ((place, angles), (places, towards))
        )
        nearest = _nearest(found, there, owners, one)
        again = (nearest < 0) & _turned(rows, one)
        found[again, 2:] = np.nan
        nearest[again] = _nearest(found[again], there, owners, one)
        target[own] = nearest
    has_place = target >= 0
    if scene is not None:
        has_body = np.array([one.body is not None for one in scene.targets], dtype=bool)
        has_place[has_place] = ~has_body[target[has_place]]
    errors = dict(zip(_AXES, np.full((4, len(index)), np.nan), strict=True))
    of = target[has_place], index[has_place]
    is_unfolded = np.isfinite(_estimated(detections, "fold"))[has_place]
    range_m, velocity = (
        np.where(is_unfolded, told[of], not_told[of])
        for told, not_told in zip(unfolded, expected, strict=True)
    )
    errors["range"][has_place] = detections.range.values[has_place] - range_m
    error = detections.velocity.values[has_place] - velocity
    within = span[has_place] * np.where(is_unfolded, folds or 1, 1)
    # What frames of all intervals tell together does not go round.
    goes_round = ~is_unfolded | (folds is not None)
    errors["velocity"][has_place] = np.where(goes_round, wrapped(error, within), error)
    for name in ("azimuth", "elevation"):
        of_all = truth[name].transpose("target", "frame").values
        errors[name][has_place] = _estimated(detections, name)[has_place] - of_all[of]
    return Match(target, *errors.values())


_AXES = ("range", "velocity", "azimuth", "elevation")


class _Towards(NamedTuple):
    """Directions, in rad, NaN where not estimated."""

    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray


def _estimated(detections: xr.Dataset, name: str) -> np.ndarray:
    """A column of detections, NaN where there is none."""
    if name not in detections:
        return np.full(detections.sizes["detection"], np.nan)
    return np.asarray(detections[name].values)


def _turned(detections: xr.Dataset, radar: Radar) -> np.ndarray:
    """Whether directions may be off: transmitters that share chirps tell them with the fold."""
    return np.isnan(_estimated(detections, "fold")) & (len(radar.array.tx_m) > 1)


def _nearest(found: np.ndarray, places: np.ndarray, owners: np.ndarray, radar: Radar) -> np.ndarray:
    """Owner of the place nearest to each detection, -1 where none is within two cells."""
    out = np.full(len(found), -1)
    if not len(owners):
        return out
    around = np.array([0, radar.frame.n_chirps, 0, 0])  # velocities go round
    known = np.isfinite(found)
    for axes in np.unique(known, axis=0):
        own = (known == axes).all(axis=1)
        # A tree: a detection may have 100,000 scatterers about it.
        tree = KDTree(places[:, axes], boxsize=around[axes])
        apart, nearest = tree.query(found[np.ix_(own, axes)], p=np.inf)
        out[own] = np.where(apart <= _CELLS, owners[nearest % len(owners)], -1)
    return out
