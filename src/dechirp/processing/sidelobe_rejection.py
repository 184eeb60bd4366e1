"""Estimates of peaks beside echoes that a few tones do not describe, without their sidelobes.

`refine` subtracts point targets. Extended echoes, undetected echoes and mirror images remain, and
the sidelobes of unwindowed samples, 1 / (pi d) of their amplitude at d cells, reach a weak peak 13
cells beside an echo of 72 dB with 40 dB more than it should. Peaks with such a remainder are
estimated again with a window on each axis. For a window w of N points with spectrum W(0) = 1 the
amplitude has the variance

    sigma^2 N sum w^2 / (sum w)^2 + sum_c P(c) |W(c)|^2,

with sigma^2 the noise in an unwindowed amplitude and P(c) the power of the remainder at c cells
from the peak; the window with the least variance is chosen. The second term, that of the sidelobes,
comes from few directions: it is returned as vectors over the channels. The frequency, the maximum
of the windowed periodogram, has the variance (D. C. Rife and R. R. Boorstyn, 1974, weighted)

    (N sigma^2 sum (w p)^2 + sum_c P(c) |sum w p exp(2 pi j c p / N)|^2) / (2 A^2 (sum w p^2)^2),

p counted from the middle of the window, A^2 the sum of the powers of the channels, and P(c) the
power in phase with the channels of the peak.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from dechirp.processing.refine import SidelobeErrors, Tones
from dechirp.theory.windows import Window, window_weights

WINDOWS: tuple[Window, ...] = ("rectangular", "hann", "blackman-harris")
"""Windows to choose from: sidelobes of -13, -31 and -92 dB, noise bandwidths of 1, 1.5 and 2."""
# Axes of fewer points have no room for a window.
_MIN_POINTS = 16
# Probability that noise beside a peak without neighbours is taken for an echo. It costs time only:
# all windows are then compared, and the unwindowed estimate is kept.
_FALSE_REMAINDER_PROBABILITY = 1e-3
# Cells on each side of a peak that count as its own; tones nearer than that are not separated.
_OWN_BINS = 1.5
# Power of a cell of the remainder, relative to the noise, from which it counts as an echo.
_MIN_EXCESS = 2.0
# Vectors that describe the sidelobes of a peak along one axis: echoes come from few directions.
_N_COMPONENTS = 3
# Power that remains beside a tone, relative to it, up to which it describes its echo: only such
# tones are subtracted from the samples of others. Amplitudes of the rest contain sidelobes.
_MAX_REMAINDER_OF_DESCRIBED_ECHO = 0.01
# Other tones whose remains along one axis are subtracted from a peak's samples.
_MAX_OTHER_TONES = 32
# Numbers in a block of peaks: 64 MB.
_MAX_BLOCK_VALUES = 2**22


class _WindowedAxis(NamedTuple):
    """Estimates of peaks from samples along one axis, (n_peaks, ...) each."""

    offset: np.ndarray
    """(n_peaks,), rad per point: frequency relative to that of demodulation."""
    amplitude: np.ndarray
    """(n_peaks, channel)."""
    window_index: np.ndarray
    noise_gain: np.ndarray
    variance_gain: np.ndarray
    components: np.ndarray
    """(n_peaks, _N_COMPONENTS, channel)."""


def estimate_tones_without_sidelobes(
    samples: np.ndarray,
    tones: Tones,
    noise_power: np.ndarray,
    remaining_power: np.ndarray,
    *,
    growth: float,
) -> tuple[Tones, SidelobeErrors | None]:
    """Estimate tones with a remainder beside them again, with windows.

    Parameters
    ----------
    samples : array (chirp, channel, sample), complex64 or float32
    tones : Tones
        All tones of the samples, from `refine.refine_tones_and_residuals`.
    noise_power : array (n,)
        E|w|^2 in one amplitude of a channel.
    remaining_power : array (n, 2)
        Highest power beside each tone, from the same.
    growth : float
        See `refine.refine_tones`.

    Returns
    -------
    Tones
        Those without a remainder above the noise are unchanged.
    SidelobeErrors or None
        Errors of all tones; None if there is no remainder.
    """
    has_remainder = _significant_remainder_mask(remaining_power, noise_power, samples.shape[1])
    if not has_remainder.any():
        return tones, None
    power = np.mean(np.abs(tones.amplitude) ** 2, axis=1)
    is_described = remaining_power.max(axis=1) < _MAX_REMAINDER_OF_DESCRIBED_ECHO * power
    n_chirps, n_channels, n_samples = samples.shape
    sidelobes = SidelobeErrors(
        np.zeros((len(tones.slow), 2 * _N_COMPONENTS, n_channels), complex),
        *np.ones((3, len(tones.slow))),
    )
    slow, fast = tones.slow.copy(), tones.fast.copy()
    energy, amplitude = tones.energy.copy(), tones.amplitude.copy()
    for along_slow in (False, True):
        rows_of_kind = np.flatnonzero(
            has_remainder.any(axis=1) & (has_remainder[:, 0] == along_slow)
        )
        size = max(1, _MAX_BLOCK_VALUES // (n_channels * (2 * n_samples + 2 * n_chirps)))
        slow_window: Window = "hann" if along_slow and n_chirps >= _MIN_POINTS else "rectangular"
        for start in range(0, len(rows_of_kind), size):
            rows = rows_of_kind[start : start + size]
            along_fast = _estimate_along_fast_time(
                samples, tones, rows, noise_power[rows], is_described, slow_window, growth
            )
            fast_now = tones.fast[rows] + along_fast.offset
            along_chirps = _estimate_along_slow_time(
                samples,
                tones,
                rows,
                noise_power[rows],
                is_described,
                along_fast,
                fast_now,
                growth,
            )
            sidelobes.components[rows] = np.concatenate(
                [along_fast.components, along_chirps.components], axis=1
            )
            is_windowed = (along_fast.window_index > 0) | (along_chirps.window_index > 0)
            sidelobes.fast_variance_gain[rows] = along_fast.variance_gain
            sidelobes.slow_variance_gain[rows] = along_chirps.variance_gain
            rows, along_fast, along_chirps, fast_now = (
                rows[is_windowed],
                _WindowedAxis(*(array[is_windowed] for array in along_fast)),
                _WindowedAxis(*(array[is_windowed] for array in along_chirps)),
                fast_now[is_windowed],
            )
            sidelobes.noise_gain[rows] = along_chirps.noise_gain
            slow[rows], fast[rows] = tones.slow[rows] + along_chirps.offset, fast_now
            amplitude[rows] = along_chirps.amplitude
            energy[rows] = np.sum(np.abs(amplitude[rows]) ** 2, axis=1) * n_chirps * n_samples
    return Tones(slow=slow, fast=fast, energy=energy, amplitude=amplitude), sidelobes


def _significant_remainder_mask(
    remaining_power: np.ndarray, noise_power: np.ndarray, n_channels: int
) -> np.ndarray:
    """Return which remainders beside tones exceed the noise, (n, 2) along slow and fast time.

    The highest of 30 bins of noise, each the mean of n_channels exponentials, exceeds the limit
    with a probability of 0.001.
    """
    limit = gammaincinv(n_channels, 1 - _FALSE_REMAINDER_PROBABILITY / 30) / n_channels
    return np.asarray(remaining_power > limit * noise_power[:, None])


def _estimate_along_fast_time(
    samples: np.ndarray,
    tones: Tones,
    rows: np.ndarray,
    noise_power: np.ndarray,
    is_described: np.ndarray,
    slow_window: Window,
    growth: float,
) -> _WindowedAxis:
    """Estimate tones from the samples at their Doppler frequency, weighted by a window."""
    n_chirps, n_channels, n_samples = samples.shape
    weights = np.broadcast_to(_unit_gain_weights(slow_window, n_chirps), (len(rows), n_chirps))
    at_doppler = np.empty((len(rows), n_channels, n_samples), np.complex128)
    for columns, walk in _walk_blocks(n_samples, tones.slow[rows], growth, n_chirps):
        demodulation = weights * np.exp(
            -1j
            * (tones.slow[rows, None] * np.arange(n_chirps) + walk[:, None] * _centred(n_chirps))
        )
        block = np.ascontiguousarray(samples[:, :, columns]).reshape(n_chirps, -1)
        at_doppler[:, :, columns] = _multiply(demodulation, block).reshape(
            len(rows), n_channels, -1
        )
    at_doppler -= _sum_of_other_tones(
        tones,
        rows,
        is_described,
        tones.slow,
        tones.slow[rows],
        weights,
        tones.fast,
        n_samples,
        noise_power,
    )
    at_doppler *= np.exp(-1j * tones.fast[rows, None] * np.arange(n_samples))[:, None]
    noise = noise_power * n_chirps * np.sum(weights**2, axis=1)
    estimates = _choose_window(at_doppler, noise)
    return estimates._replace(
        noise_gain=estimates.noise_gain * noise / noise_power,
        variance_gain=estimates.variance_gain * noise / noise_power,
    )


def _estimate_along_slow_time(
    samples: np.ndarray,
    tones: Tones,
    rows: np.ndarray,
    noise_power: np.ndarray,
    is_described: np.ndarray,
    along_fast: _WindowedAxis,
    fast: np.ndarray,
    growth: float,
) -> _WindowedAxis:
    """Estimate tones from the chirps at their beat frequency, with the window chosen for it."""
    n_chirps, n_channels, n_samples = samples.shape
    weights = np.stack([_unit_gain_weights(window, n_samples) for window in WINDOWS])[
        along_fast.window_index
    ]
    at_beat = np.zeros((len(rows), n_chirps, n_channels), np.complex128)
    for columns, walk in _walk_blocks(n_samples, tones.slow[rows], growth, n_chirps):
        demodulation = weights[:, columns] * np.exp(
            -1j * fast[:, None] * np.arange(n_samples)[columns]
        )
        block = np.ascontiguousarray(samples[:, :, columns]).reshape(n_chirps * n_channels, -1)
        part = _multiply(demodulation, block.T).reshape(len(rows), n_chirps, n_channels)
        at_beat += part * np.exp(-1j * walk[:, None] * _centred(n_chirps))[:, :, None]
    by_channel = np.ascontiguousarray(at_beat.swapaxes(1, 2))
    by_channel -= _sum_of_other_tones(
        tones, rows, is_described, tones.fast, fast, weights, tones.slow, n_chirps, noise_power
    )
    by_channel *= np.exp(-1j * tones.slow[rows, None] * np.arange(n_chirps))[:, None]
    noise = noise_power * n_samples * np.sum(weights**2, axis=1)
    estimates = _choose_window(by_channel, noise)
    return estimates._replace(
        noise_gain=estimates.noise_gain * noise / noise_power,
        variance_gain=estimates.variance_gain * noise / noise_power,
    )


def _walk_blocks(
    n_samples: int, slow: np.ndarray, growth: float, n_chirps: int
) -> list[tuple[slice, np.ndarray]]:
    """Return blocks of samples, and the growth of the slow-time frequencies in each, (n,).

    One block where the walk through range cells changes the phase at the corners of the frame by
    less than 0.05 rad.
    """
    largest = float(np.max(np.abs(slow), initial=0.0)) * abs(growth) * n_chirps * n_samples / 4
    n_blocks = int(np.clip(np.ceil(largest / 0.05), 1, min(64, n_samples)))
    edges = np.linspace(0, n_samples, n_blocks + 1).round().astype(int)
    return [
        (slice(first, stop), slow * growth * ((first + stop - n_samples) / 2))
        for first, stop in pairwise(edges)
    ]


def _multiply(factors: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return the product of complex factors and complex or real samples in single precision."""
    if samples.dtype == np.float32:
        return np.asarray(
            factors.real.astype(np.float32) @ samples
            + 1j * (factors.imag.astype(np.float32) @ samples)
        )
    return np.asarray(factors.astype(np.complex64) @ samples)


def _sum_of_other_tones(
    tones: Tones,
    rows: np.ndarray,
    is_described: np.ndarray,
    across: np.ndarray,
    across_of_rows: np.ndarray,
    weights: np.ndarray,
    along: np.ndarray,
    n_points: int,
    noise_power: np.ndarray,
) -> np.ndarray:
    """Return other described tones in the samples of each row, (rows, channel, n_points).

    `across` are the frequencies along the other axis, which `weights` (rows, m) sum over.
    """
    m = np.arange(weights.shape[1])
    out = np.zeros((len(rows), tones.amplitude.shape[1], n_points), np.complex128)
    largest = np.where(is_described, np.abs(tones.amplitude).max(axis=1), 0.0)
    n = np.arange(n_points)
    for i, row in enumerate(rows):
        apart = np.abs(np.sin((along - along[row]) / 2)) * n_points
        response = np.exp(1j * np.outer(across - across_of_rows[i], m)) @ weights[i]
        relevance = largest * np.abs(response) / np.maximum(1.0, apart)
        relevance[row] = 0.0
        others = np.flatnonzero(relevance > 0.1 * np.sqrt(noise_power[i]))
        others = others[np.argsort(-relevance[others], kind="stable")[:_MAX_OTHER_TONES]]
        if others.size:
            phases = np.exp(1j * np.outer(along[others], n))
            out[i] = (tones.amplitude[others].T * response[others]) @ phases
    return out


def _choose_window(samples: np.ndarray, noise: np.ndarray) -> _WindowedAxis:
    """Estimate tones near zero frequency with the window of the least variance.

    `samples` (n_peaks, channel, point) contain white noise of `noise` (n_peaks,) in their mean.
    """
    n_points = samples.shape[2]
    windows = WINDOWS if n_points >= _MIN_POINTS else WINDOWS[:1]
    estimates = [
        _estimate_with_window(samples, noise, window, index) for index, window in enumerate(windows)
    ]
    variances = np.stack(
        [
            noise * estimate.noise_gain
            + np.sum(np.abs(estimate.components) ** 2, axis=1).mean(axis=1)
            for estimate in estimates
        ]
    )
    best = variances.argmin(axis=0)
    peaks = np.arange(len(samples))
    return _WindowedAxis(
        *(np.stack(arrays)[best, peaks] for arrays in zip(*estimates, strict=True))
    )


def _estimate_with_window(
    samples: np.ndarray, noise: np.ndarray, window: Window, index: int
) -> _WindowedAxis:
    n_peaks, _, n_points = samples.shape
    weights = _unit_gain_weights(window, n_points)
    place = np.arange(n_points) - np.sum(weights * np.arange(n_points))
    offset = _maximise_windowed_periodogram(samples, weights, place)
    tone = np.exp(1j * offset[:, None] * np.arange(n_points))[:, None]
    amplitude = np.sum(weights * samples * tone.conj(), axis=2)
    second_moment = np.sum(weights * place**2)
    power = np.sum(np.abs(amplitude) ** 2, axis=1)
    noise_gain = float(n_points * np.sum(weights**2))
    slope_noise = float(n_points * np.sum((weights * place) ** 2))

    spectrum, response, slope_response, grid_bandwidth = _remainder_spectrum(
        samples * tone.conj() - amplitude[..., None], window
    )
    level = noise * noise_gain if index else noise * _noise_gain("hann", n_points)
    cell_power = np.mean(np.abs(spectrum) ** 2, axis=1)
    share = 1 - level[:, None] / np.maximum(cell_power, 1e-300)
    share = np.where(cell_power > _MIN_EXCESS * level[:, None], share, 0.0) / grid_bandwidth
    in_phase = np.abs(np.einsum("pk,pkc->pc", amplitude.conj(), spectrum)) ** 2
    in_phase /= np.maximum(power, 1e-300)[:, None]
    variance = noise * slope_noise + np.sum(share * in_phase * slope_response, axis=1)
    variance_of_lone_tone = noise * (n_points**2 - 1) / 12  # second moment of the unwindowed mean
    lone_second_moment = max((n_points**2 - 1) / 12, 1e-300)
    variance_gain = (
        (variance / second_moment**2)
        / np.maximum(variance_of_lone_tone / lone_second_moment**2, 1e-300)
        if n_points > 1
        else np.ones(n_peaks)
    )
    leaking = spectrum * np.sqrt(share * response)[:, None]
    return _WindowedAxis(
        offset=offset,
        amplitude=amplitude,
        window_index=np.full(n_peaks, index),
        noise_gain=np.full(n_peaks, noise_gain),
        variance_gain=np.asarray(variance_gain),
        components=_principal_components(leaking),
    )


def _remainder_spectrum(
    remainder: np.ndarray, window: Window
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return the spectrum of the remainder beside each peak, and the responses of a window there.

    (n_peaks, channel, cell) in cells of half a bin, without the peak's own; |W|^2 (cell,), the
    squared response of w p (cell,), and the number of cells to which one tone contributes. An
    unwindowed peak is seen through a Hann window: sidelobes of a remainder are not echoes.
    """
    n_points = remainder.shape[2]
    seen_through = "hann" if window == "rectangular" and n_points >= _MIN_POINTS else window
    spectrum = np.fft.fft(
        remainder * _unit_gain_weights(seen_through, n_points), 2 * n_points, axis=2
    )
    response, slope_response = _window_responses(window, n_points)
    bins = np.fft.fftfreq(2 * n_points, 0.5 / n_points)
    is_beside = np.abs(bins) > _OWN_BINS
    bandwidth = 2 * _noise_gain(seen_through, n_points)
    return spectrum[..., is_beside], response[is_beside], slope_response[is_beside], bandwidth


def _maximise_windowed_periodogram(
    samples: np.ndarray, weights: np.ndarray, place: np.ndarray
) -> np.ndarray:
    """Return the frequencies of the maxima near zero, (n_peaks,), by Newton's method on the log."""
    n_points = samples.shape[2]
    offset = np.zeros(len(samples))
    if n_points == 1:
        return offset
    moments = np.stack([weights, weights * place, weights * place**2], axis=1)
    largest_step = np.pi / n_points
    lone_curvature = np.sum(weights * place**2)
    for _ in range(8):
        turned = samples * np.exp(-1j * offset[:, None] * place)[:, None]
        zeroth, first, second = np.moveaxis(turned @ moments, 2, 0)
        power = np.maximum(np.sum(np.abs(zeroth) ** 2, axis=1), 1e-300)
        slope = np.sum((zeroth.conj() * first).imag, axis=1) / power
        curvature = np.sum(np.abs(first) ** 2 - (zeroth.conj() * second).real, axis=1) / power
        curvature -= 2 * slope**2
        curvature = np.where(curvature < 0, curvature, -lone_curvature)
        offset += np.clip(-slope / curvature, -largest_step, largest_step)
    return np.asarray(np.where(np.abs(offset) < 2 * largest_step, offset, 0.0))


def _principal_components(vectors: np.ndarray) -> np.ndarray:
    """Return few vectors (n, components, channel) with the covariance of many (n, channel, m).

    The strongest directions, scaled to the power of all.
    """
    covariance = np.asarray(np.matmul(vectors, vectors.conj().swapaxes(1, 2)))
    values, directions = np.linalg.eigh(covariance)
    values = np.maximum(values, 0.0)
    kept = values[:, -_N_COMPONENTS:]
    total, kept_total = values.sum(axis=1), kept.sum(axis=1)
    scale = np.where(kept_total > 0, total / np.where(kept_total > 0, kept_total, 1.0), 0.0)
    components = np.sqrt(kept * scale[:, None])[:, None] * directions[:, :, -_N_COMPONENTS:]
    out = np.zeros((len(vectors), _N_COMPONENTS, vectors.shape[1]), complex)
    out[:, : components.shape[2]] = components.swapaxes(1, 2)
    return out


def _centred(n: int) -> np.ndarray:
    """Return the middle of each point relative to the middle of all."""
    return np.arange(n) + 0.5 - n / 2


@lru_cache(maxsize=32)
def _unit_gain_weights(window: Window, n_points: int) -> np.ndarray:
    weights = np.asarray(window_weights(window, n_points))
    weights = weights / weights.sum()
    weights.setflags(write=False)
    return weights


def _noise_gain(window: Window, n_points: int) -> float:
    weights = _unit_gain_weights(window if n_points >= _MIN_POINTS else "rectangular", n_points)
    return float(n_points * np.sum(weights**2))


@lru_cache(maxsize=32)
def _window_responses(window: Window, n_points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return |W|^2 and the squared response of w p in cells of half a bin, (2 n_points,) each."""
    weights = _unit_gain_weights(window, n_points)
    place = np.arange(n_points) - np.sum(weights * np.arange(n_points))
    response, slope_response = (
        np.abs(np.fft.fft(values, 2 * n_points)) ** 2 for values in (weights, weights * place)
    )
    return response, slope_response
