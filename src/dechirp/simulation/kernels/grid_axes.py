"""Grid axes of the non-uniform FFT: frequencies and times, as dense as the scene requires."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.kernels.band_interpolation import (
    MAX_OVERHANG,
    BandInterpolator,
    make_sparsest_interpolator,
)
from dechirp.simulation.kernels.base import Transmission
from dechirp.simulation.kernels.gridding import SpreadingKernel, make_spreading_kernel
from dechirp.simulation.kernels.simd import WIDTH
from dechirp.simulation.kernels.tones import ScattererPaths, Waveform


class GridAxis(NamedTuple):
    """Frequency grid along one axis, and the time grid of its transform."""

    spacing: float
    """Oversampling factor of the frequency grid."""
    n_points: int
    """Number of points, a multiple of 4."""
    step_s: float
    """Time step."""

    @property
    def spreading_kernel(self) -> SpreadingKernel:
        """Return the spreading kernel of the axis."""
        return make_spreading_kernel(self.spacing)

    def frequency_to_grid_scale_and_offset(self, mixer_hz: float = 0.0) -> np.ndarray:
        """Return scale and offset from frequencies, minus `mixer_hz`, to grid coordinates."""
        scale = self.n_points * self.step_s
        return np.array([scale, self.n_points // 2 - mixer_hz * scale])

    def deapodisation_factors(self) -> np.ndarray:
        """Return the factor at each time that compensates the spreading, (n_points,)."""
        return _deapodisation_factors(self.spacing, self.n_points)


@lru_cache(64)
def _deapodisation_factors(oversampling: float, n_points: int) -> np.ndarray:
    steps = np.arange(n_points) - n_points // 2
    is_inside = np.abs(steps) <= n_points / (2 * oversampling)
    weights = make_spreading_kernel(oversampling).fourier_transform(
        2 * np.pi * np.where(is_inside, steps, 0) / n_points
    )
    return np.asarray(is_inside * (1 - 2 * (steps % 2)) / weights, np.float32)


def make_slow_time_axis(doppler_band_hz: float, max_time_s: float, oversampling: float) -> GridAxis:
    """Make the grid for tones from -band / 2 to band / 2, at times within half_s of zero."""
    # One step more than the weights take: a scene at rest has no bandwidth.
    needed = oversampling**2 * doppler_band_hz * 2 * max_time_s + oversampling * (WIDTH + 3)
    n_points = next_fast_fft_size(max(needed, WIDTH * oversampling / (oversampling - 1) + 2))
    return GridAxis(oversampling, n_points, 2 * max_time_s / (n_points / oversampling - WIDTH - 2))


def next_fast_fft_size(at_least: float) -> int:
    """Return a multiple of 4, at least `at_least`, with an efficient FFT."""
    return 4 * int(scipy.fft.next_fast_len(int(np.ceil(at_least / 4))))


class FastTime(NamedTuple):
    """Fast-time grid: at every sample, or at fewer if the scene has a narrow band."""

    axis: GridAxis
    interpolator: BandInterpolator | None
    """Interpolator from the grid to the samples; None: the grid has every sample."""
    times_s: np.ndarray
    """Times from the middle of the window."""
    time_slice: slice
    """Slice of the grid points that `times_s` covers."""
    mixer_hz: float
    """Frequency subtracted from the beat frequencies."""
    max_doppler_hz: float
    """Bound on the Doppler frequency of all scatterers."""

    @property
    def half_s(self) -> float:
        """Return the largest distance of a time from the middle of the window."""
        return float(max(-self.times_s[0], self.times_s[-1]))

    def deapodisation_factors(self) -> np.ndarray:
        """Return the factor at each time that compensates the spreading."""
        return self.axis.deapodisation_factors()[self.time_slice]


def make_fast_time_grid(
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    oversampling: float,
    tolerance: float,
) -> FastTime:
    """Make the fast-time grid for all chirps, antennas and scatterers."""
    n, rate_hz = waveform.n_samples, waveform.sample_rate_hz
    low_hz, high_hz, max_doppler_hz = _beat_band_and_max_doppler_hz(paths, transmission, waveform)
    low, high = (low_hz - max_doppler_hz) / rate_hz, (high_hz + max_doppler_hz) / rate_hz
    interpolator = make_sparsest_interpolator(low, high, n_samples=n, tolerance=tolerance / 4)
    first, stop = -(n // 2), n - n // 2
    if interpolator is not None:
        first, stop = interpolator.required_known_sample_range(first, stop)
    step, mixer_hz = (
        (1, 0.0)
        if interpolator is None
        else (interpolator.step, interpolator.centre_frequency * rate_hz)
    )
    # At least as many points as a value is spread over.
    n_points = next_fast_fft_size(max(oversampling * max(2 * stop, -2 * first), WIDTH))
    axis = GridAxis(oversampling, n_points, step / rate_hz)
    time_slice = slice(axis.n_points // 2 + first, axis.n_points // 2 + stop)
    return FastTime(
        axis,
        interpolator,
        np.arange(first, stop) * axis.step_s,
        time_slice,
        mixer_hz,
        max_doppler_hz,
    )


def _beat_band_and_max_doppler_hz(
    paths: ScattererPaths, transmission: Transmission, waveform: Waveform
) -> tuple[float, float, float]:
    """Return least and largest delay times slope over all times, and the Doppler bound."""
    half_s = (1 + MAX_OVERHANG) * waveform.half_window_s
    latest_s = max(-waveform.times_s[0], waveform.times_s[-1]) + half_s
    antennas_m = np.concatenate([transmission.tx_m, transmission.rx_m])
    centre_m = (antennas_m.min(axis=0) + antennas_m.max(axis=0)) / 2
    array_radius_m = float(np.linalg.norm(antennas_m - centre_m, axis=1).max())
    nearest_m, farthest_m, fastest = _distance_and_speed_bounds(paths.path_m, centre_m, latest_s)
    near_m = max(nearest_m - array_radius_m - fastest * latest_s, 0.0)
    far_m = farthest_m + array_radius_m + fastest * latest_s
    ends = np.array([near_m, far_m]) * (2 * waveform.slope_hz_per_s / SPEED_OF_LIGHT)
    highest_hz = waveform.mid_frequency_hz + abs(waveform.slope_hz_per_s) * half_s
    doppler_hz = 2 * fastest / SPEED_OF_LIGHT * highest_hz
    return float(ends.min()), float(ends.max()), doppler_hz


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _distance_and_speed_bounds(
    path_terms_m: np.ndarray, centre_m: np.ndarray, max_time_s: float
) -> tuple[float, float, float]:
    """Return the least and largest distance at time zero, and a bound on the speed."""
    near_square, far_square = np.inf, 0.0
    for i in range(path_terms_m.shape[2]):
        x, y, z = path_terms_m[0, 0, i], path_terms_m[0, 1, i], path_terms_m[0, 2, i]
        square = (x - centre_m[0]) ** 2 + (y - centre_m[1]) ** 2 + (z - centre_m[2]) ** 2
        near_square, far_square = min(near_square, square), max(far_square, square)
    fastest = 0.0
    for k in range(1, len(path_terms_m)):
        largest = 0.0
        for i in range(path_terms_m.shape[2]):
            x, y, z = path_terms_m[k, 0, i], path_terms_m[k, 1, i], path_terms_m[k, 2, i]
            largest = max(largest, x * x + y * y + z * z)
        fastest += k * max_time_s ** (k - 1) * np.sqrt(largest)
    return np.sqrt(near_square), np.sqrt(far_square), fastest
