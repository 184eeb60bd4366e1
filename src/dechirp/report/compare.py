"""Detections beside the truth: which belongs to which, and how far off it is."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.radar import Radar

_CELLS = 2.0  # a detection is its target's within two resolution cells on both axes


class Place(NamedTuple):
    """Ranges (m) and velocities (m/s) of the same shape."""

    range_m: np.ndarray
    velocity_m_per_s: np.ndarray


class Match(NamedTuple):
    """For each detection: its target, -1 for none, and its errors, NaN where there is none."""

    target: np.ndarray
    range_error_m: np.ndarray
    velocity_error_m_per_s: np.ndarray


def seen(truth: xr.Dataset, radar: Radar) -> Place:
    """Return what a perfect detector reports of the truth, (target, frame): aliases folded.

    Differs from the truth only where a range or velocity is ambiguous.
    """
    chirp = radar.frame.chirp
    known = truth.transpose("target", "frame")
    beat_hz, doppler_hz = _frequencies_hz(Place(known.range.values, known.velocity.values), radar)
    beat_hz = beat_hz % chirp.sample_rate_hz
    if chirp.sampling == "real":
        # The upper half of the spectrum is the mirror of the lower: both frequencies turn.
        mirrored = beat_hz > chirp.sample_rate_hz / 2
        beat_hz = np.where(mirrored, chirp.sample_rate_hz - beat_hz, beat_hz)
        doppler_hz = np.where(mirrored, -doppler_hz, doppler_hz)
    doppler_hz = _wrapped(doppler_hz, 1 / radar.frame.interval_s)
    delay_hz = beat_hz - doppler_hz
    return Place(
        chirp.range_m(1.0) * delay_hz,
        doppler_hz * SPEED_OF_LIGHT / (2 * (_sent_hz(radar) - delay_hz)),
    )


def on_map(place: Place, radar: Radar) -> Place:
    """Return where such peaks lie on the map: range-Doppler coupling put back."""
    chirp = radar.frame.chirp
    beat_hz, doppler_hz = _frequencies_hz(place, radar)
    return Place(chirp.range_m(1.0) * beat_hz, doppler_hz * chirp.wavelength_m / 2)


def match(detections: xr.Dataset, truth: xr.Dataset, radar: Radar) -> Match:
    """Give each detection to the nearest target of its frame, within two cells on both axes."""
    expected = seen(truth, radar)
    of_frame = {int(frame): index for index, frame in enumerate(truth.frame.values)}
    index = np.array([of_frame[int(frame)] for frame in detections.frame.values], dtype=int)
    range_error_m = detections.range.values[:, None] - expected.range_m.T[index]
    velocity_error = _wrapped(
        detections.velocity.values[:, None] - expected.velocity_m_per_s.T[index],
        2 * radar.frame.max_velocity_m_per_s,
    )
    range_cells = abs(range_error_m) / radar.frame.chirp.range_resolution_m
    velocity_cells = abs(velocity_error) / radar.frame.velocity_resolution_m_per_s
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


def _frequencies_hz(place: Place, radar: Radar) -> tuple[np.ndarray, np.ndarray]:
    """Beat and Doppler frequencies at mid-window: f_b = S tau + f_D, f_D = 2 v (f - S tau) / c."""
    delay_hz = place.range_m / radar.frame.chirp.range_m(1.0)
    doppler_hz = 2 * place.velocity_m_per_s * (_sent_hz(radar) - delay_hz) / SPEED_OF_LIGHT
    return delay_hz + doppler_hz, doppler_hz


def _sent_hz(radar: Radar) -> float:
    chirp = radar.frame.chirp
    return chirp.start_frequency_hz + chirp.slope_hz_per_s * chirp.mid_window_s


def _wrapped(amount: np.ndarray, period: float) -> np.ndarray:
    return (amount + period / 2) % period - period / 2
