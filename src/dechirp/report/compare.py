"""Detections beside the truth: which belongs to which, and how far off it is."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

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


def on_map(place: Place, radar: Radar) -> Place:
    """Return where such peaks lie on the map: range-Doppler coupling put back."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = frequencies(place, radar)
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

    A body of the scene is where its scatterers are, on parts that move as well, the hidden ones
    left out; without the scene it is where its origin is.
    """
    expected = seen(truth, radar)
    of_frame = {int(frame): index for index, frame in enumerate(truth.frame.values)}
    index = np.array([of_frame[int(frame)] for frame in detections.frame.values], dtype=int)
    target = np.full(len(index), -1)
    for at in np.unique(index):
        owners, places = np.arange(truth.sizes["target"]), Place(*(of.T[at] for of in expected))
        if scene is not None:
            shown = visible(scene, float(truth.time[at]), radar)
            owners = scene.owners[shown]
            there = scatterers(scene, truth.time.values[at : at + 1])
            places = folded(Place(*(of[0, shown] for of in there)), radar)
        own = index == at
        found = Place(detections.range.values[own], detections.velocity.values[own])
        target[own] = _nearest(found, places, owners, radar)
    has_place = target >= 0
    if scene is not None:
        has_body = np.array([one.body is not None for one in scene.targets], dtype=bool)
        has_place[has_place] = ~has_body[target[has_place]]
    range_error_m, velocity_error = np.full((2, len(index)), np.nan)
    of = target[has_place], index[has_place]
    range_error_m[has_place] = detections.range.values[has_place] - expected.range_m[of]
    velocity_error[has_place] = wrapped(
        detections.velocity.values[has_place] - expected.velocity_m_per_s[of],
        2 * radar.frame.max_velocity_m_per_s,
    )
    return Match(target, range_error_m, velocity_error)


def _nearest(found: Place, places: Place, owners: np.ndarray, radar: Radar) -> np.ndarray:
    """Owner of the place nearest to each detection, -1 where none is within two cells."""
    if not len(owners):
        return np.full(len(found.range_m), -1)
    # A tree: a detection may have 100,000 scatterers about it.
    tree = KDTree(_cells(places, radar), boxsize=np.array([0, radar.frame.n_chirps]))
    apart, nearest = tree.query(_cells(found, radar), p=np.inf)
    return np.where(apart <= _CELLS, owners[nearest % len(owners)], -1)


def _cells(place: Place, radar: Radar) -> np.ndarray:
    """Range and velocity in resolution cells, (n, 2); velocities go round."""
    frame = radar.frame
    over_velocity = np.zeros_like(place.range_m)  # one chirp measures none to be told apart by
    if frame.n_chirps > 1:
        over_velocity = place.velocity_m_per_s / frame.velocity_resolution_m_per_s % frame.n_chirps
    return np.stack([place.range_m / frame.chirp.range_resolution_m, over_velocity], axis=-1)
