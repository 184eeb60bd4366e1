"""Grids of frequencies and of times along one axis, no denser than the scene needs."""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
import scipy.fft

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.kernels.base import Sent
from dechirp.echoes.kernels.between import OUTSIDE, Between, fewest_times
from dechirp.echoes.kernels.kaiser_bessel import Spreading, spreading
from dechirp.echoes.kernels.patches import WIDTH
from dechirp.echoes.kernels.tones import Paths, Waveform


class Axis(NamedTuple):
    """A grid of frequencies along one axis, and the grid of times that it transforms to."""

    spacing: float
    """By which it is finer than critical."""
    n_points: int
    """A multiple of 4."""
    step_s: float
    """Between two times."""

    @property
    def spread(self) -> Spreading:
        """The weights of neighbouring points."""
        return spreading(self.spacing)

    def places(self, mixed_hz: float = 0.0) -> np.ndarray:
        """Scale and offset from frequencies to coordinates; `mixed_hz` is taken off."""
        scale = self.n_points * self.step_s
        return np.array([scale, self.n_points // 2 - mixed_hz * scale])

    def over(self) -> np.ndarray:
        """By which the transform is multiplied at each time: undoes the spreading, (n_points,)."""
        return _over(self.spacing, self.n_points)


@lru_cache(64)
def _over(spacing: float, n_points: int) -> np.ndarray:
    steps = np.arange(n_points) - n_points // 2
    inside = np.abs(steps) <= n_points / (2 * spacing)
    weights = spreading(spacing).transform(2 * np.pi * np.where(inside, steps, 0) / n_points)
    return np.asarray(inside * (1 - 2 * (steps % 2)) / weights, np.float32)


def slow_axis(band_hz: float, half_s: float, spacing: float) -> Axis:
    """Grid for tones of -band / 2 to band / 2 at instants within half_s of time zero."""
    # One step more than the weights take, for a scene at rest has no band at all.
    needed = spacing**2 * band_hz * 2 * half_s + spacing * (WIDTH + 3)
    n_points = fast_size(max(needed, WIDTH * spacing / (spacing - 1) + 2))
    return Axis(spacing, n_points, 2 * half_s / (n_points / spacing - WIDTH - 2))


def fast_size(at_least: float) -> int:
    """A multiple of 4 that transforms well."""
    return 4 * int(scipy.fft.next_fast_len(int(np.ceil(at_least / 4))))


class FastTime(NamedTuple):
    """Fast time: at every sample, or at fewer where the scene fills a narrow band."""

    axis: Axis
    between: Between | None
    """None: at every sample."""
    times_s: np.ndarray
    """From the middle of the window."""
    kept: slice
    """Of the points of the grid, the times above."""
    mixed_hz: float
    """Taken off the beat frequencies."""
    most_doppler_hz: float
    """Doppler frequency that no scatterer exceeds."""

    @property
    def half_s(self) -> float:
        """From the middle of the window to the farthest of the times, which may be outside."""
        return float(max(-self.times_s[0], self.times_s[-1]))

    def over(self) -> np.ndarray:
        """By which the transform is multiplied at each time."""
        return self.axis.over()[self.kept]


def fast_time(
    paths: Paths, sent: Sent, waveform: Waveform, spacing: float, tolerance: float
) -> FastTime:
    """Fast time for all chirps, antennas and scatterers."""
    n, rate_hz = waveform.n_samples, waveform.sample_rate_hz
    low_hz, high_hz, most_hz = _band_hz(paths, sent, waveform)
    low, high = (low_hz - most_hz) / rate_hz, (high_hz + most_hz) / rate_hz
    between = fewest_times(low, high, n_samples=n, tolerance=tolerance / 4)
    first, stop = -(n // 2), n - n // 2
    if between is not None:
        first, stop = between.needed(first, stop)
    every, mixed_hz = (1, 0.0) if between is None else (between.every, between.tone * rate_hz)
    # No fewer points than a value is spread over, however few the samples.
    n_points = fast_size(max(spacing * max(2 * stop, -2 * first), WIDTH))
    axis = Axis(spacing, n_points, every / rate_hz)
    kept = slice(axis.n_points // 2 + first, axis.n_points // 2 + stop)
    return FastTime(axis, between, np.arange(first, stop) * axis.step_s, kept, mixed_hz, most_hz)


def _band_hz(paths: Paths, sent: Sent, waveform: Waveform) -> tuple[float, float, float]:
    """Least and largest of all delays times the slope, at all times and antennas; Doppler."""
    half_s = (1 + OUTSIDE) * waveform.half_window_s
    latest_s = max(-waveform.times_s[0], waveform.times_s[-1]) + half_s
    antennas_m = np.concatenate([sent.tx_m, sent.rx_m])
    centre_m = (antennas_m.min(axis=0) + antennas_m.max(axis=0)) / 2
    apart_m = float(np.linalg.norm(antennas_m - centre_m, axis=1).max())
    nearest_m, farthest_m, fastest = _extent(paths.path_m, centre_m, latest_s)
    near_m = max(nearest_m - apart_m - fastest * latest_s, 0.0)
    far_m = farthest_m + apart_m + fastest * latest_s
    ends = np.array([near_m, far_m]) * (2 * waveform.slope_hz_per_s / SPEED_OF_LIGHT)
    highest_hz = waveform.mid_frequency_hz + abs(waveform.slope_hz_per_s) * half_s
    doppler_hz = 2 * fastest / SPEED_OF_LIGHT * highest_hz
    return float(ends.min()), float(ends.max()), doppler_hz


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _extent(
    path_m: np.ndarray, centre_m: np.ndarray, latest_s: float
) -> tuple[float, float, float]:
    """Least and largest distance at time zero, and a speed that none exceeds until `latest_s`."""
    near, far = np.inf, 0.0
    for i in range(path_m.shape[2]):
        x, y, z = path_m[0, 0, i], path_m[0, 1, i], path_m[0, 2, i]
        square = (x - centre_m[0]) ** 2 + (y - centre_m[1]) ** 2 + (z - centre_m[2]) ** 2
        near, far = min(near, square), max(far, square)
    fastest = 0.0
    for k in range(1, len(path_m)):
        largest = 0.0
        for i in range(path_m.shape[2]):
            x, y, z = path_m[k, 0, i], path_m[k, 1, i], path_m[k, 2, i]
            largest = max(largest, x * x + y * y + z * z)
        fastest += k * latest_s ** (k - 1) * np.sqrt(largest)
    return np.sqrt(near), np.sqrt(far), fastest
