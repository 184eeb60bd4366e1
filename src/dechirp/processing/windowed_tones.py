"""Estimates of tones along one axis, with the window that has the least variance.

For a window w of N points with spectrum W(0) = 1 the amplitude has the variance

    sigma^2 N sum w^2 / (sum w)^2 + sum_c P(c) |W(c)|^2,

with sigma^2 the noise in an unwindowed amplitude and P(c) the power of the remainder at c cells
from the peak; the window with the least variance is chosen. The second term is that of the
sidelobes. The frequency, the maximum of the windowed periodogram, has the variance (D. C. Rife and
R. R. Boorstyn, 1974, weighted)

    (N sigma^2 sum (w p)^2 + sum_c P(c) |sum w p exp(2 pi j c p / N)|^2) / (2 A^2 (sum w p^2)^2),

p counted from the middle of the window, A^2 the sum of the powers of the channels, and P(c) the
power in phase with the channels of the peak. Echoes within 1.5 cells are partly absorbed by the
peak, and count with the shift by an echo of the power that remains (`_NEAR_SHIFT_CELLS`).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.compiled_kernels import kernel
from dechirp.theory.windows import Window, window_weights

WINDOWS: tuple[Window, ...] = ("rectangular", "hann", "blackman-harris")
"""Windows to choose from: sidelobes of -13, -31 and -92 dB, noise bandwidths of 1, 1.5 and 2."""
# Axes of fewer points have no room for a window.
_MIN_POINTS = 16
# Cells of half a bin on each side of a peak that count as its own.
_OWN_CELLS = 1
# Cells of half a bin in which echoes are partly absorbed by the peak, and the shift in bins by an
# echo of the power that remains: one at 3/4 to 5/4 of a bin shifts the maximum by 0.41 to 0.2 bins
# times its amplitude ratio; of its amplitude 0.6 to 0.9 remain, in a Hann window 0.4 to 0.6.
_NEAR_CELLS, _NEAR_SHIFT_CELLS = 3, 0.6
# Power of a cell of the remainder, relative to the noise, from which it counts as an echo.
_MIN_EXCESS = 2.0
# Vectors that describe the sidelobes of a peak along one axis: echoes come from few directions.
N_COMPONENTS = 3
# Blocks of points in which the maximum of the periodogram is sought first.
_N_COARSE_BLOCKS = 32
# Share of the power of an echo that counts as in phase with a peak at least: that of one frame may
# vanish by chance in a cell of the spectrum, and not in the sidelobe. Squared errors of ranges over
# their variances were 1.38 and 1.51 without it, 10 and 8 cells beside echoes of 70 and 62 dB, and
# are 1.06 and 1.23.
_MIN_IN_PHASE_SHARE = 0.5


class WindowSet(NamedTuple):
    """Properties of the windows to choose from, for n points."""

    weights: np.ndarray
    """(window, point), sum 1."""
    place: np.ndarray
    """(window, point): points counted from the middle of the window."""
    noise_gain: np.ndarray
    """(window,): noise power in the mean relative to that without a window."""
    slope_noise: np.ndarray
    """(window,): n sum (w p)^2."""
    second_moment: np.ndarray
    """(window,): sum w p^2."""
    remainder_weights: np.ndarray
    """(window, point): window through which the remainder is seen. Hann for an unwindowed peak:
    sidelobes of a remainder are not echoes."""
    remainder_gain: np.ndarray
    """(window,): noise power through that window relative to that without a window."""
    response: np.ndarray
    """(window, cell): |W|^2 in cells of half a bin."""
    slope_response: np.ndarray
    """(window, cell): squared response of w p."""


class WindowedAxis(NamedTuple):
    """Estimates of peaks from samples along one axis, (n_peaks, ...) each."""

    offset: np.ndarray
    """(n_peaks,), rad per point: frequency relative to that of demodulation."""
    has_maximum: np.ndarray
    """(n_peaks,): the windowed periodogram has a maximum within a bin."""
    unwindowed_power: np.ndarray
    """(n_peaks,): noise and sidelobes in a channel without a window along this axis."""
    amplitude: np.ndarray
    """(n_peaks, channel)."""
    window_index: np.ndarray
    noise_gain: np.ndarray
    variance_gain: np.ndarray
    components: np.ndarray
    """(n_peaks, N_COMPONENTS, channel)."""


def estimate_with_best_window(
    values: np.ndarray, frequency: np.ndarray, noise_power: np.ndarray, noise_gain: np.ndarray
) -> WindowedAxis:
    """Estimate tones near given frequencies with the window of the least variance.

    `values` (n_peaks, channel, point) contain white noise of noise_power * noise_gain (n_peaks,)
    in their mean.
    """
    n_peaks, n_channels, n_points = values.shape
    windows = compute_window_set(n_points)
    n_windows = len(windows.weights)
    scale = np.sqrt(noise_power * noise_gain)  # single precision has no numbers below 1e-38
    demodulated = values * np.exp(-1j * frequency[:, None] * np.arange(n_points))[:, None]
    offset = np.empty((n_peaks, n_windows))
    amplitude = np.empty((n_peaks, n_windows, n_channels), np.complex128)
    variance, slope_variance = np.full((2, n_peaks, n_windows), np.inf)
    covariance = np.zeros((n_peaks, n_channels, n_channels), np.complex128)
    rows = np.arange(n_peaks)
    for w in range(n_windows):
        # Sidelobes only add to the noise: most peaks need no other window.
        rows = rows[variance[rows].min(axis=1) > windows.noise_gain[w]]
        if not rows.size:
            break
        remainder = np.zeros((len(rows), n_channels, 2 * n_points), np.complex64)
        for i, row in enumerate(rows):
            offset[row, w] = _estimate_with_window(
                demodulated[row],
                windows.weights[w],
                windows.place[w],
                windows.remainder_weights[w] / scale[row],
                amplitude[row, w],
                remainder[i],
            )
        spectrum = scipy.fft.fft(remainder, axis=2, overwrite_x=True)
        for i, row in enumerate(rows):
            variance[row, w], slope_variance[row, w] = _write_sidelobe_covariance(
                spectrum[i],
                amplitude[row, w],
                windows.noise_gain[w],
                windows.slope_noise[w],
                windows.remainder_gain[w],
                windows.response[w],
                windows.slope_response[w],
                variance[row].min(),
                covariance[row],
            )
    best = variance.argmin(axis=1)
    peaks = np.arange(n_peaks)
    variance_gain = np.ones(n_peaks)
    if n_points > 1:
        lone_second_moment = (n_points**2 - 1) / 12
        variance_gain = (
            slope_variance[peaks, best]
            / windows.second_moment[best] ** 2
            * lone_second_moment
            * noise_gain
        )
    return WindowedAxis(
        offset=np.nan_to_num(offset[peaks, best]),
        has_maximum=np.isfinite(offset[peaks, best]),
        unwindowed_power=variance[:, 0] * scale**2,
        amplitude=amplitude[peaks, best],
        window_index=best,
        noise_gain=windows.noise_gain[best] * noise_gain,
        variance_gain=variance_gain,
        components=_principal_components(covariance) * scale[:, None, None],
    )


def _estimate_with_window_in_numpy(
    values: np.ndarray,
    weights: np.ndarray,
    place: np.ndarray,
    remainder_weights: np.ndarray,
    amplitude: np.ndarray,
    remainder: np.ndarray,
) -> float:
    """Plain twin of `_estimate_with_window`."""
    n_points = values.shape[1]
    starts = np.arange(0, n_points, max(1, n_points // _N_COARSE_BLOCKS))
    ends = np.append(starts[1:], n_points)
    sums = np.add.reduceat(weights * values, starts, axis=1)
    middle = (place[starts] + place[ends - 1]) / 2
    curvature = float(weights @ place**2)
    coarse = _maximise_windowed_periodogram(
        sums, np.ones(len(starts)), middle, 0.0, n_points, curvature
    )
    if abs(coarse) >= 2 * np.pi / n_points:
        coarse = 0.0  # the maximum of an aliased echo
    offset = _maximise_windowed_periodogram(values, weights, place, coarse, n_points, curvature)
    has_maximum = abs(offset) < 2 * np.pi / n_points
    if not has_maximum:
        offset = 0.0
    turned = values * np.exp(-1j * offset * np.arange(n_points))
    amplitude[:] = turned @ weights
    remainder[:, :n_points] = remainder_weights * (turned - amplitude[:, None])
    return offset if has_maximum else np.nan


@kernel(plain=_estimate_with_window_in_numpy)
def _estimate_with_window(
    values: np.ndarray,
    weights: np.ndarray,
    place: np.ndarray,
    remainder_weights: np.ndarray,
    amplitude: np.ndarray,
    remainder: np.ndarray,
) -> float:
    """Return the offset of a tone of values (channel, point); write its amplitude and remainder.

    NaN without a maximum within a bin; amplitude and remainder are then those at the offset 0.
    The maximum is sought on sums of blocks, and then on all points. Sums of blocks alias echoes 32
    cells away onto the tone: their maximum is no start where it is more than a cell away. The
    remainder is weighted.
    """
    n_channels, n_points = values.shape
    size = max(1, n_points // _N_COARSE_BLOCKS)
    n_blocks = (n_points + size - 1) // size
    sums, middle = np.zeros((n_channels, n_blocks), np.complex128), np.empty(n_blocks)
    for block in range(n_blocks):
        start, stop = block * size, min((block + 1) * size, n_points)
        middle[block] = (place[start] + place[stop - 1]) / 2
        for k in range(n_channels):
            for n in range(start, stop):
                sums[k, block] += weights[n] * values[k, n]
    curvature = 0.0
    for n in range(n_points):
        curvature += weights[n] * place[n] ** 2
    coarse = _maximise_windowed_periodogram(
        sums, np.ones(n_blocks), middle, 0.0, n_points, curvature
    )
    if abs(coarse) >= 2 * np.pi / n_points:
        coarse = 0.0  # the maximum of an aliased echo
    offset = _maximise_windowed_periodogram(values, weights, place, coarse, n_points, curvature)
    has_maximum = abs(offset) < 2 * np.pi / n_points
    if not has_maximum:
        offset = 0.0
    turns = np.exp(-1j * offset * np.arange(n_points))
    for k in range(n_channels):
        total = 0j
        for n in range(n_points):
            total += weights[n] * (values[k, n] * turns[n])
        amplitude[k] = total
        for n in range(n_points):
            remainder[k, n] = remainder_weights[n] * (values[k, n] * turns[n] - total)
    return offset if has_maximum else np.nan


def _maximise_windowed_periodogram_in_numpy(
    values: np.ndarray,
    weights: np.ndarray,
    place: np.ndarray,
    offset: float,
    n_points: int,
    lone_curvature: float,
) -> float:
    """Plain twin of `_maximise_windowed_periodogram`."""
    if n_points == 1:
        return 0.0
    largest_step = np.pi / n_points
    places = np.stack([np.ones_like(place), place, place**2])
    for _ in range(8):
        turns = weights * np.exp(-1j * offset * place)
        zeroth, first, second = (turns * places) @ values.T
        power = float(np.sum(abs(zeroth) ** 2))
        if power == 0.0:
            return 0.0
        slope = float(np.sum(zeroth.conj() * first).imag) / power
        curvature = float(np.sum(abs(first) ** 2 - (zeroth.conj() * second).real))
        curvature = curvature / power - 2 * slope**2
        if curvature >= 0:
            curvature = -lone_curvature
        step = min(max(-slope / curvature, -largest_step), largest_step)
        offset += step
        if abs(step) < 1e-4 * largest_step:
            break
    return offset


@kernel(plain=_maximise_windowed_periodogram_in_numpy, fastmath={"contract", "reassoc"})
def _maximise_windowed_periodogram(
    values: np.ndarray,
    weights: np.ndarray,
    place: np.ndarray,
    offset: float,
    n_points: int,
    lone_curvature: float,
) -> float:
    """Return the frequency of the maximum near an offset, by Newton's method on the logarithm."""
    if n_points == 1:
        return 0.0
    largest_step = np.pi / n_points
    for _ in range(8):
        turns = weights * np.exp(-1j * offset * place)
        power, slope, curvature = 0.0, 0.0, 0.0
        for k in range(len(values)):
            zeroth, first, second = 0j, 0j, 0j
            for n in range(place.size):
                z = values[k, n] * turns[n]
                zeroth += z
                first += place[n] * z
                second += place[n] * place[n] * z
            power += zeroth.real**2 + zeroth.imag**2
            slope += (np.conj(zeroth) * first).imag
            curvature += first.real**2 + first.imag**2 - (np.conj(zeroth) * second).real
        if power == 0.0:
            return 0.0
        slope /= power
        curvature = curvature / power - 2 * slope**2
        if curvature >= 0:
            curvature = -lone_curvature
        step = min(max(-slope / curvature, -largest_step), largest_step)
        offset += step
        # The error after a step is about its square, see `refine._maximise_periodogram`.
        if abs(step) < 1e-4 * largest_step:
            break
    return offset


def _write_sidelobe_covariance_in_numpy(
    spectrum: np.ndarray,
    amplitude: np.ndarray,
    noise_gain: float,
    slope_noise: float,
    remainder_gain: float,
    response: np.ndarray,
    slope_response: np.ndarray,
    least_variance: float,
    covariance: np.ndarray,
) -> tuple[float, float]:
    """Plain twin of `_write_sidelobe_covariance`."""
    cells = np.arange(spectrum.shape[1])
    wide = spectrum.astype(complex)
    cell_power = np.mean(abs(wide) ** 2, axis=0)
    power = 1e-300 + np.sum(abs(amplitude) ** 2)
    in_phase = abs(amplitude.conj() @ wide) ** 2 / power
    in_phase = np.maximum(in_phase, _MIN_IN_PHASE_SHARE * cell_power)
    is_own = np.minimum(cells, cells.size - cells) <= _OWN_CELLS
    is_excess = ~is_own & (cell_power > _MIN_EXCESS * remainder_gain)
    share = np.where(is_excess, (1 - remainder_gain / cell_power) / (2 * remainder_gain), 0.0)
    variance = float(noise_gain + np.sum(share * response * cell_power))
    slope_variance = slope_noise + np.sum(share * slope_response * in_phase)
    if variance < least_variance:
        is_near = np.minimum(cells, cells.size - cells) <= _NEAR_CELLS
        least = np.where(is_near, response[min(_NEAR_CELLS, cells.size - 1)], 0.0)
        covariance[:] = (share * np.maximum(response, least) * wide) @ wide.conj().T
    return variance, float(slope_variance)


@kernel(plain=_write_sidelobe_covariance_in_numpy)
def _write_sidelobe_covariance(
    spectrum: np.ndarray,
    amplitude: np.ndarray,
    noise_gain: float,
    slope_noise: float,
    remainder_gain: float,
    response: np.ndarray,
    slope_response: np.ndarray,
    least_variance: float,
    covariance: np.ndarray,
) -> tuple[float, float]:
    """Return the variances of a tone through a window, relative to noise.

    That of the amplitude, and that of the frequency times 2 A^2 (sum w p^2)^2. The covariance of
    the sidelobes, (channel, channel), is written if the first is below `least_variance`.
    """
    n_channels, n_cells = spectrum.shape
    share = np.zeros(n_cells)
    cell_power, in_phase = np.zeros(n_cells), np.zeros(n_cells, np.complex128)
    power = 1e-300
    for k in range(n_channels):
        conjugate = np.conj(amplitude[k])
        power += conjugate.real**2 + conjugate.imag**2
        for c in range(n_cells):
            z = np.complex128(spectrum[k, c])
            cell_power[c] += (z.real**2 + z.imag**2) / n_channels
            in_phase[c] += conjugate * z
    variance, slope_variance = noise_gain, slope_noise
    for c in range(n_cells):
        is_own = min(c, n_cells - c) <= _OWN_CELLS
        if is_own or cell_power[c] <= _MIN_EXCESS * remainder_gain:
            continue
        # A tone contributes to 2 * remainder_gain cells of half a bin.
        share[c] = (1 - remainder_gain / cell_power[c]) / (2 * remainder_gain)
        variance += share[c] * response[c] * cell_power[c]
        in_phase_power = (in_phase[c].real ** 2 + in_phase[c].imag ** 2) / power
        in_phase_power = max(in_phase_power, _MIN_IN_PHASE_SHARE * cell_power[c])
        slope_variance += share[c] * slope_response[c] * in_phase_power
    if variance >= least_variance:
        return variance, slope_variance
    covariance[:] = 0.0
    near_response = response[min(_NEAR_CELLS, n_cells - 1)]
    for c in range(n_cells):
        gain = share[c] * response[c]
        if min(c, n_cells - c) <= _NEAR_CELLS:  # zeros of the response count for none
            gain = share[c] * max(response[c], near_response)
        if gain == 0.0:
            continue
        for k in range(n_channels):
            scaled = gain * np.complex128(spectrum[k, c])
            for j in range(n_channels):
                covariance[k, j] += scaled * np.conj(np.complex128(spectrum[j, c]))
    return variance, slope_variance


def _principal_components(covariance: np.ndarray) -> np.ndarray:
    """Return few vectors (n, components, channel) with about a covariance (n, channel, channel).

    The strongest directions, scaled to the power of all.
    """
    n_peaks, n_channels, _ = covariance.shape
    out = np.zeros((n_peaks, N_COMPONENTS, n_channels), complex)
    rows = np.flatnonzero(covariance.any(axis=(1, 2)))
    if not rows.size:
        return out
    values, directions = np.linalg.eigh(covariance[rows])
    values = np.maximum(values, 0.0)
    kept = values[:, -N_COMPONENTS:]
    kept = kept * (values.sum(axis=1) / kept.sum(axis=1))[:, None]
    components = np.sqrt(kept)[:, None] * directions[:, :, -N_COMPONENTS:]
    out[rows, : kept.shape[1]] = components.swapaxes(1, 2)
    return out


@lru_cache(maxsize=32)
def compute_window_set(n_points: int) -> WindowSet:
    """Compute the windows to choose from, and their properties; axes below 16 points have one."""
    names = WINDOWS if n_points >= _MIN_POINTS else WINDOWS[:1]
    weights = np.stack([np.asarray(window_weights(name, n_points)) for name in names])
    weights = weights / weights.sum(axis=1, keepdims=True)
    place = np.arange(n_points) - np.sum(weights * np.arange(n_points), axis=1, keepdims=True)
    noise_gain = n_points * np.sum(weights**2, axis=1)
    second_moment = np.sum(weights * place**2, axis=1)
    slope_response = np.abs(np.fft.fft(weights * place, 2 * n_points)) ** 2
    cells = np.arange(2 * n_points)
    is_near = np.minimum(cells, cells.size - cells) <= _NEAR_CELLS
    near_response = (second_moment * _NEAR_SHIFT_CELLS * 2 * np.pi / n_points) ** 2
    slope_response[:, is_near] = np.maximum(slope_response[:, is_near], near_response[:, None])
    seen_through = [max(index, min(1, len(names) - 1)) for index in range(len(names))]
    windows = WindowSet(
        weights=weights,
        place=place,
        noise_gain=noise_gain,
        slope_noise=n_points * np.sum((weights * place) ** 2, axis=1),
        second_moment=second_moment,
        remainder_weights=weights[seen_through],
        remainder_gain=noise_gain[seen_through],
        response=np.abs(np.fft.fft(weights, 2 * n_points)) ** 2,
        slope_response=slope_response,
    )
    for array in windows:
        array.setflags(write=False)
    return windows
