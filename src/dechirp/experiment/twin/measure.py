"""What a map tells of its noise and of its peaks, the same way for a recording and its twin."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import xarray as xr
from scipy.special import gammaincinv

from dechirp.process.chain import Chain
from dechirp.process.interpolation import between_bins
from dechirp.process.maps import cells_over, level_of, power_map
from dechirp.process.spectrum import amplitude_weights, independent_rows
from dechirp.process.virtual import channels
from dechirp.radar.radar import Radar

# A stretch of rows has so many cells at least, for its median to be good to 0.5 dB in one channel
# and better in several, and a map so many stretches at most, for a settings file to be readable.
_FEWEST_CELLS, _MOST_STRETCHES = 256, 24
_ROUNDING = 1e-12  # of the strongest cell; single precision has 1e-14


@dataclass(frozen=True)
class Seen:
    """One frame, as a chain sees it."""

    frame: xr.DataArray
    """(chirp, rx, sample)."""
    radar: Radar
    chain: Chain

    @cached_property
    def power(self) -> xr.DataArray:
        """Its map, (velocity, range)."""
        return power_map(self.frame, self.radar, self.chain).transpose("velocity", "range")

    @property
    def median_over_mean(self) -> float:
        """Median of the noise in a cell over its mean: that of the mean of so many exponentials."""
        n_channels = self.radar.n_summed
        return float(gammaincinv(n_channels, 0.5) / n_channels)


@dataclass(frozen=True)
class Peaks:
    """Peaks of a map, or of a twin about the peaks of its recording."""

    cell: np.ndarray
    """(n, 2), velocity and range."""
    power: np.ndarray
    """(n,), of the highest cell."""
    slow: np.ndarray
    """(n,), place between the bins, in cells of the map."""
    fast: np.ndarray


def stretches(of: Seen) -> list[slice]:
    """Rows of the map in stretches of about equal length, in which noise is taken as even."""
    n_velocity, n_rows = of.power.shape
    rows = max(-(-_FEWEST_CELLS // n_velocity), -(-n_rows // _MOST_STRETCHES))
    n = max(n_rows // rows, 1)
    edges = np.linspace(0, n_rows, n + 1).round().astype(int)
    return [slice(first, stop) for first, stop in pairwise(edges.tolist())]


def floor(of: Seen) -> np.ndarray:
    """Mean power of the noise in a cell of each of the `stretches`, (n,).

    From the median of all their cells, which targets in few of them move little.
    """
    medians = [np.median(of.power.values[:, rows]) for rows in stretches(of)]
    return np.asarray(medians) / of.median_over_mean


def is_noisy(of: Seen) -> bool:
    """Whether there is noise in all stretches, and not rounding errors alone."""
    return bool(np.all(floor(of) > _ROUNDING * of.power.values.max()))


def floor_at(of: Seen, rows: np.ndarray) -> np.ndarray:
    """The noise in rows of the map, straight in decibels between the middles of the stretches."""
    middles = [(one.start + one.stop - 1) / 2 for one in stretches(of)]
    level = np.maximum(floor(of), np.finfo(np.float32).tiny)
    return np.asarray(np.exp(np.interp(rows, middles, np.log(level))))


def peaks_of(of: Seen) -> np.ndarray:
    """Cells of the peaks that the chain finds, (n, 2), strongest first; no rounding errors."""
    power = of.power.values
    cells = cells_over(level_of(power, of.radar, of.chain), of.radar, of.chain)
    return cells[power[cells[:, 0], cells[:, 1]] > _ROUNDING * power.max()]


def searched(of: Seen, cells: np.ndarray) -> np.ndarray:
    """Whether detection looks for peaks in the rows of cells, (n, 2)."""
    rows = independent_rows(of.radar.frame.chirp, of.chain.noise(of.radar).over_range)
    return np.asarray((rows.start <= cells[:, 1]) & (cells[:, 1] < rows.stop))


def peaks_at(of: Seen, cells: np.ndarray) -> Peaks:
    """The highest cell within one of each cell given, (n, 2), and where its peak lies."""
    around, powers = _around(of, cells)
    best = powers.argmax(axis=1)
    at = np.arange(len(cells))
    slow, fast = _places(of, around[at, best], cells)
    return Peaks(cell=around[at, best], power=powers[at, best], slow=slow, fast=fast)


def wandering(of: Seen, cells: np.ndarray, share: np.ndarray) -> np.ndarray:
    """How far peaks may move by losing to a cell beside them, (n,), in cells along either axis.

    To one whose power is less by no more than a `share` of theirs, (n,): where the peak would be
    read to lie from that cell. Of a tone between two bins that is the same place, of a peak on the
    flank of another it is not.
    """
    around, powers = _around(of, cells)
    own = [place[:, None] for place in _places(of, cells, cells)]
    n = around.shape[1]
    there = _places(of, around.reshape(-1, 2), np.repeat(cells, n, axis=0))
    apart = [abs(a.reshape(-1, n) - b) for a, b in zip(there, own, strict=True)]
    near = powers > powers[:, :1] * (1 - share[:, None])
    return np.asarray(np.where(near, np.maximum(*apart), 0.0).max(axis=1, initial=0.0))


def _around(of: Seen, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nine cells about each, (n, 9, 2), itself first, and their powers; -1 beyond the rows."""
    power = of.power.values
    n_velocity, n_rows = power.shape
    around = cells[:, None] + np.array([(v, r) for v in (0, -1, 1) for r in (0, -1, 1)])
    inside = (around[..., 1] >= 0) & (around[..., 1] < n_rows)
    around[..., 0] %= n_velocity
    around[..., 1] = around[..., 1].clip(0, n_rows - 1)
    return around, np.where(inside, power[around[..., 0], around[..., 1]], -1.0)


def _places(of: Seen, tops: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where peaks lie of which `tops` are the highest cells, as near as can be to other cells."""
    noise, n_velocity = of.chain.noise(of.radar), of.power.sizes["velocity"]
    slow, fast = between_bins(of.power.values, tops, noise)
    away = slow / (2 * np.pi) * n_velocity + n_velocity // 2 - near[:, 0]
    away = (away + n_velocity / 2) % n_velocity - n_velocity / 2  # velocities wrap
    return near[:, 0] + away, fast / (2 * np.pi) * noise.over_range.n_bins


def echoes_at(of: Seen, cells: np.ndarray) -> np.ndarray:
    """Complex spectrum of each channel at cells of the map, (n, channel)."""
    noise, chirp = of.chain.noise(of.radar), of.radar.frame.chirp
    over_velocity, over_range = noise.over_velocity, noise.over_range
    m, n = np.arange(over_velocity.n_points), np.arange(over_range.n_points)
    velocities, row = np.unique(cells[:, 0], return_inverse=True)  # what stands still shares one
    turns = np.outer(velocities - over_velocity.n_bins // 2, m) / over_velocity.n_bins
    slow = np.exp(-2j * np.pi * turns) * over_velocity.weights / over_velocity.weights.sum()
    fast = np.exp(-2j * np.pi * np.outer(cells[:, 1], n) / over_range.n_bins)
    fast = fast * amplitude_weights(over_range, chirp.sampling)
    sent = of.frame.transpose("chirp", "rx", "sample").values
    samples = channels(np.ascontiguousarray(sent), of.radar.frame)
    n_chirps, n_channels, n_samples = samples.shape
    rows = (slow @ samples.reshape(n_chirps, -1)).reshape(-1, n_channels, n_samples)
    return (rows[row] @ fast[..., None])[..., 0]
