"""Detections beside the truth: which belongs to which, and how far off it is."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, frequencies, seen, wrapped

_CELLS = 2.0  # a detection is its target's within two resolution cells on every estimated axis


class Match(NamedTuple):
    """For each detection: its target, -1 for none, and its errors, NaN where there is none."""

    target: np.ndarray
    range_error_m: np.ndarray
    velocity_error_m_per_s: np.ndarray


def on_map(place: Place, radar: Radar) -> Place:
    """Return where such peaks lie on the map: range-Doppler coupling put back."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = frequencies(place, radar)
    return Place(chirp.range_m(1.0) * beat_hz, doppler_hz * chirp.wavelength_m / 2)


def match(detections: xr.Dataset, truth: xr.Dataset, radar: Radar) -> Match:
    """Give each detection to the nearest target of its frame, within two cells on every axis."""
    expected = seen(truth, radar)
    of_frame = {int(frame): index for index, frame in enumerate(truth.frame.values)}
    index = np.array([of_frame[int(frame)] for frame in detections.frame.values], dtype=int)
    range_error_m = detections.range.values[:, None] - expected.range_m.T[index]
    velocity_error = wrapped(
        detections.velocity.values[:, None] - expected.velocity_m_per_s.T[index],
        2 * radar.frame.max_velocity_m_per_s,
    )
    range_cells = abs(range_error_m) / radar.frame.chirp.range_resolution_m
    # One chirp measures no velocity: its detections have none to be told apart by.
    has_velocity = radar.frame.n_chirps > 1
    resolution_m_per_s = radar.frame.velocity_resolution_m_per_s
    velocity_cells = abs(velocity_error if has_velocity else 0 * range_error_m) / resolution_m_per_s
    cells = np.where(
        np.maximum(range_cells, velocity_cells) <= _CELLS,
        np.hypot(range_cells, velocity_cells),
        np.inf,
    )
    if cells.shape[1] == 0:
        nothing = np.full(len(index), np.nan)
        return Match(np.full(len(index), -1), nothing, nothing)
    nearest = cells.argmin(axis=1)
    row = np.arange(len(index))
    missing = np.isinf(cells[row, nearest])
    return Match(
        np.where(missing, -1, nearest),
        np.where(missing, np.nan, range_error_m[row, nearest]),
        np.where(missing, np.nan, velocity_error[row, nearest]),
    )
