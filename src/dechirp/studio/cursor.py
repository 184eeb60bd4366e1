"""Cursor of a frame: its cell of the map, the cuts through it, and the beat signal."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import threshold_cuts_through_cell
from dechirp.processing.spectrum import range_spectrum
from dechirp.radar.radar import Radar
from dechirp.report.figures.common import uniform_cell_width
from dechirp.scene.aliasing import RangeVelocity, range_doppler_map_position

_MAX_CHIRPS = 64  # averaged for the range profile, whose fluctuation is then 0.5 dB


class Cursor(NamedTuple):
    """Range and velocity shown by all views."""

    range_m: float
    velocity_m_per_s: float


class MapCut(NamedTuple):
    """Power and threshold along one axis of the map through the cursor."""

    positions: np.ndarray
    """m along range, m/s along velocity."""
    power: np.ndarray
    threshold: np.ndarray
    """Infinite where the detector does not search."""


class BeatSignal(NamedTuple):
    """Samples of the first receiver and their range spectrum."""

    time_s: np.ndarray
    """(sample,) since the start of the ramp."""
    samples: np.ndarray
    """(sample,) of the first chirp."""
    range_m: np.ndarray
    """(range,)"""
    power: np.ndarray
    """(range,) of the first chirp: the spectrum of its samples."""
    profile: np.ndarray
    """(range,) mean over chirps of the first slot: the range profile."""


_FOLLOWED_CELLS = 3
"""Distance in cells within which a detection is the one that the cursor was at a frame before."""
_FOLLOWED_SNR = 0.01
"""Ratio to the strongest detection above which the cursor stays: fading takes 20 dB."""


def cursor_at_followed_detection(
    power: xr.DataArray, detections: xr.Dataset, radar: Radar, previous: Cursor | None
) -> Cursor:
    """Return the cell of a detection: near the previous cursor, else the strongest one.

    Without detections, the strongest cell. Echoes of similar strength take turns as the strongest,
    so the cursor would jump between them.
    """
    velocity_m_per_s, range_m = map_velocities_and_ranges(power)
    rows, columns = slice(None), slice(None)
    if detections.sizes["detection"]:
        variables = detections.variables
        snr, *estimates = (variables[name].values for name in ("snr", "range", "velocity"))
        places = range_doppler_map_position(RangeVelocity(*estimates), radar)

        def cell_of_detection(index: int) -> tuple[int, int]:
            return nearest_cell_indices(power, Cursor(*(float(place[index]) for place in places)))

        row, column = cell_of_detection(int(snr.argmax()))
        if previous is not None:
            last = nearest_cell_indices(power, previous)
            is_candidate = (snr >= _FOLLOWED_SNR * snr.max()) & (
                abs(places.range_m - previous.range_m)
                <= (_FOLLOWED_CELLS + 1) * uniform_cell_width(range_m)
            )
            for index in np.flatnonzero(is_candidate)[np.argsort(-snr[is_candidate])]:
                cell = cell_of_detection(int(index))
                if max(abs(cell[0] - last[0]), abs(cell[1] - last[1])) <= _FOLLOWED_CELLS:
                    row, column = cell
                    break
        # Noise may raise a neighbour above the nearest cell.
        rows, columns = (slice(max(index - 1, 0), index + 2) for index in (row, column))
    neighbourhood = power.values[rows, columns]
    row_offset, column_offset = divmod(int(neighbourhood.argmax()), neighbourhood.shape[1])
    return Cursor(
        range_m=float(range_m[columns][column_offset]),
        velocity_m_per_s=float(velocity_m_per_s[rows][row_offset]),
    )


def nearest_cell_indices(power: xr.DataArray, cursor: Cursor) -> tuple[int, int]:
    """Return the nearest cell (velocity, range); velocities alias, and one chirp has none."""
    velocity, range_m = map_velocities_and_ranges(power)
    column = int(abs(range_m - cursor.range_m).argmin())
    if velocity.size == 1 or not np.isfinite(cursor.velocity_m_per_s):
        return velocity.size // 2, column
    step = (velocity[-1] - velocity[0]) / (velocity.size - 1)
    return round((cursor.velocity_m_per_s - velocity[0]) / step) % velocity.size, column


def map_velocities_and_ranges(power: xr.DataArray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocities and ranges; `power.range` takes 35 us instead of 3, ten times a frame."""
    variables = power.coords.variables
    return variables["velocity"].values, variables["range"].values


def power_and_threshold_cuts(
    power: xr.DataArray, radar: Radar, chain: Chain, cell: tuple[int, int]
) -> tuple[MapCut, MapCut]:
    """Return the cuts through a cell along range and along velocity."""
    row, column = cell
    velocity_m_per_s, range_m = map_velocities_and_ranges(power)
    over_range, over_velocity = threshold_cuts_through_cell(power, radar, chain, cell)
    return (
        MapCut(range_m, power.values[row], over_range),
        MapCut(velocity_m_per_s, power.values[:, column], over_velocity),
    )


def first_receiver_beat_and_spectrum(cube: xr.DataArray, radar: Radar, chain: Chain) -> BeatSignal:
    """Return samples and range spectrum of the first receiver in a frame (chirp, rx, sample)."""
    # Falling ramps have other beat frequencies: the first slot alone.
    first_slot = cube.variable[{"chirp": slice(None, None, radar.frame.n_slots)}]
    samples = first_slot.transpose("rx", "chirp", "sample").values[0, :_MAX_CHIRPS]
    chirp = radar.frame.chirp
    transform = chain.range_transform(chirp)
    power = abs(range_spectrum(samples, chirp.sampling, transform)) ** 2
    return BeatSignal(
        time_s=cube["sample"].values,
        samples=samples[0],
        range_m=chirp.range_bins_m(transform.n_bins),
        power=power[0],
        profile=power.mean(axis=0),
    )
