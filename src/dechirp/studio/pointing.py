"""What lies under the cursor of a frame: its cell of the map, cuts through it, the beat signal."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.process.chain import Chain
from dechirp.process.maps import threshold_through
from dechirp.process.spectrum import over_range
from dechirp.radar.radar import Radar
from dechirp.scene.folding import Place, on_map

_MOST_CHIRPS = 64  # averaged for the range profile: the mean is smooth to 0.5 dB by then


class Cursor(NamedTuple):
    """Where all views look."""

    range_m: float
    velocity_m_per_s: float


class Cut(NamedTuple):
    """Cells of the map along one axis through the cursor, and what they have to exceed."""

    at: np.ndarray
    """m along range, m/s along velocity."""
    power: np.ndarray
    threshold: np.ndarray
    """Infinite where nothing is searched for."""


class Beat(NamedTuple):
    """What the first receiver hears: samples, and what is in them over range."""

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


def strongest(power: xr.DataArray, detections: xr.Dataset, radar: Radar) -> Cursor:
    """The cell of a map with the strongest detection; without any, the strongest cell."""
    rows, columns = slice(None), slice(None)
    if detections.sizes["detection"]:
        found = detections.variables
        snr, range_m, velocity = (found[n].values for n in ("snr", "range", "velocity"))
        first = slice(int(snr.argmax()), None)
        place = on_map(Place(range_m[first][:1], velocity[first][:1]), radar)
        row, column = cell_of(power, Cursor(*(float(at[0]) for at in place)))
        # Noise may raise a neighbour above the nearest cell.
        rows, columns = (slice(max(at - 1, 0), at + 2) for at in (row, column))
    near = power.values[rows, columns]
    up, right = divmod(int(near.argmax()), near.shape[1])
    return Cursor(
        range_m=float(power.range.values[columns][right]),
        velocity_m_per_s=float(power.velocity.values[rows][up]),
    )


def cell_of(power: xr.DataArray, cursor: Cursor) -> tuple[int, int]:
    """Nearest cell (velocity, range) of a map; velocities fold, one chirp tells none."""
    velocity, range_m = power.velocity.values, power.range.values
    column = int(abs(range_m - cursor.range_m).argmin())
    if velocity.size == 1 or not np.isfinite(cursor.velocity_m_per_s):
        return velocity.size // 2, column
    step = (velocity[-1] - velocity[0]) / (velocity.size - 1)
    return round((cursor.velocity_m_per_s - velocity[0]) / step) % velocity.size, column


def cuts(power: xr.DataArray, radar: Radar, chain: Chain, cell: tuple[int, int]) -> tuple[Cut, Cut]:
    """The row and the column of a map through a cell, over range and over velocity."""
    row, column = cell
    over_range, over_velocity = threshold_through(power, radar, chain, cell)
    return (
        Cut(power.range.values, power.values[row], over_range),
        Cut(power.velocity.values, power.values[:, column], over_velocity),
    )


def beat(cube: xr.DataArray, radar: Radar, chain: Chain) -> Beat:
    """What the first receiver hears in one frame, (chirp, rx, sample)."""
    # Falling ramps have other beat frequencies: the first slot alone.
    alike = cube.variable[{"chirp": slice(None, None, radar.frame.n_slots)}]
    heard = alike.transpose("rx", "chirp", "sample").values[0, :_MOST_CHIRPS]
    chirp = radar.frame.chirp
    transform = chain.over_range(chirp)
    power = abs(over_range(heard, chirp.sampling, transform)) ** 2
    return Beat(
        time_s=cube["sample"].values,
        samples=heard[0],
        range_m=chirp.range_bins_m(transform.n_bins),
        power=power[0],
        profile=power.mean(axis=0),
    )
