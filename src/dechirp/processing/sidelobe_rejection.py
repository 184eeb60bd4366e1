"""Estimates of peaks beside echoes that a few tones do not describe, without their sidelobes.

`refine` subtracts point targets. Extended echoes, undetected echoes and mirror images remain, and
the sidelobes of unwindowed samples, 1 / (pi d) of their amplitude at d cells, reach a weak peak 13
cells beside an echo of 72 dB with 40 dB more than it should. Peaks with such a remainder are
estimated again along each axis, with the window of `windowed_tones` that has the least variance.
Other tones are subtracted there as if no velocity were aliased, without motion within a chirp and
growth. The variance of the sidelobes that remain comes from few directions: it is returned as
vectors over the channels. An echo beside the peak on one axis and up to half a cell on the other
shifts the frequency on that other axis too: `_shift_variance_gain`.
"""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.core.threads import run_in_threads, thread_count
from dechirp.processing.refine import SidelobeErrors, Tones
from dechirp.processing.tone_block_sums import sum_chirps_times_cosines_and_sines
from dechirp.processing.windowed_tones import (
    N_COMPONENTS,
    WindowedAxis,
    compute_window_set,
    estimate_with_best_window,
)
from dechirp.theory.detection import detection_threshold

# Half the main lobe of a Hann window, and half a cell.
_MAIN_LOBE_CELLS = 2.5
# Probability that noise beside a peak without neighbours is taken for an echo. All windows are then
# compared, and the unwindowed estimate is kept; errors of echoes that move are overstated above
# 60 dB, since what windows neglect of their motion counts as an echo.
_FALSE_REMAINDER_PROBABILITY = 1e-3
# Bins over which the remainder of an echo within half a cell spreads.
_BINS_OF_REMAINDER = 3
# Power that remains beside a tone, relative to it, up to which it describes its echo: only such
# tones are subtracted from the samples of others. Amplitudes of the rest contain sidelobes.
_MAX_REMAINDER_OF_DESCRIBED_ECHO = 0.01
# Other tones whose remains along one axis are subtracted from a peak's samples.
_MAX_OTHER_TONES = 32
# Samples read, in all peaks, from which a second thread pays: 2 ms. It takes the interpreter lock
# for 0.7 ms where other threads run Python, as in the studio.
_MIN_SAMPLES_FOR_THREADS = 2**24
# Numbers in a block of peaks: 32 MB.
_MAX_BLOCK_VALUES = 2**22


def estimate_tones_without_sidelobes(
    samples: np.ndarray,
    tones: Tones,
    noise_power: np.ndarray,
    remaining_power: np.ndarray,
    *,
    growth: float,
) -> tuple[Tones, SidelobeErrors | None, np.ndarray]:
    """Estimate tones with a remainder beside them again, with windows.

    Tones within the main lobe of a window keep the estimates from all samples together, unless the
    sidelobes in those exceed the windowed tone. Then each is a tone of its own only if the windowed
    samples have a maximum there: a target stays where it is under any window, a sidelobe does not.

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
    array (n,), bool
        Tones to keep: the others are sidelobes, or repeat a stronger one.
    """
    has_remainder = _significant_remainder_mask(remaining_power, noise_power, samples.shape[1])
    if not has_remainder.any():
        return tones, None, np.ones(len(tones.slow), bool)
    power = np.mean(np.abs(tones.amplitude) ** 2, axis=1)
    is_described = remaining_power.max(axis=1) < _MAX_REMAINDER_OF_DESCRIBED_ECHO * power
    n_chirps, n_channels, n_samples = samples.shape
    sidelobes = SidelobeErrors(
        np.zeros((len(tones.slow), 2 * N_COMPONENTS, n_channels), complex),
        *np.ones((3, len(tones.slow))),
    )
    slow, fast = tones.slow.copy(), tones.fast.copy()
    energy, amplitude = tones.energy.copy(), tones.amplitude.copy()
    all_rows = np.flatnonzero(has_remainder.any(axis=1))
    has_neighbour = _near_neighbour_mask(tones, n_chirps, n_samples)
    is_doubtful, is_kept = np.zeros(len(slow), bool), np.ones(len(slow), bool)
    size = max(1, _MAX_BLOCK_VALUES // (n_channels * 8 * max(n_samples, n_chirps)))
    for start in range(0, len(all_rows), size):
        rows = all_rows[start : start + size]
        along_fast = _estimate_along_fast_time(
            samples, tones, rows, noise_power, is_described, has_remainder[:, 0], growth
        )
        fast_now = tones.fast[rows] + along_fast.offset
        along_chirps = _estimate_along_slow_time(
            samples, tones, rows, noise_power, is_described, along_fast, fast_now, growth
        )
        sidelobes.components[rows] = np.concatenate(
            [along_fast.components, along_chirps.components], axis=1
        )
        for gain, along, across, axis, n_points in (
            (sidelobes.fast_variance_gain, along_fast, along_chirps, 1, n_samples),
            (sidelobes.slow_variance_gain, along_chirps, along_fast, 0, n_chirps),
        ):
            gain[rows] = along.variance_gain + _shift_variance_gain(
                across.components, remaining_power[rows, axis], noise_power[rows], n_points
            )
        is_windowed = (along_fast.window_index > 0) | (along_chirps.window_index > 0)
        windowed_power = np.mean(np.abs(along_chirps.amplitude) ** 2, axis=1)
        unwindowed_power = np.maximum(along_fast.unwindowed_power, along_chirps.unwindowed_power)
        is_buried = windowed_power < unwindowed_power
        is_doubtful[rows] = is_windowed & has_neighbour[rows] & is_buried
        is_windowed &= ~has_neighbour[rows] | is_buried
        is_kept[rows] = ~is_doubtful[rows] | (along_fast.has_maximum & along_chirps.has_maximum)
        windowed = rows[is_windowed]
        sidelobes.noise_gain[windowed] = along_chirps.noise_gain[is_windowed]
        slow[windowed] = (tones.slow[rows] + along_chirps.offset)[is_windowed]
        fast[windowed] = fast_now[is_windowed]
        amplitude[windowed] = along_chirps.amplitude[is_windowed]
        energy[windowed] = np.sum(np.abs(amplitude[windowed]) ** 2, axis=1) * n_chirps * n_samples
    new = Tones(slow=slow, fast=fast, energy=energy, amplitude=amplitude)
    is_kept &= ~_repeated_tone_mask(new, is_doubtful & is_kept, n_chirps, n_samples)
    return new, sidelobes, is_kept


def _repeated_tone_mask(
    tones: Tones, is_doubtful: np.ndarray, n_chirps: int, n_samples: int
) -> np.ndarray:
    """Return which doubtful tones have a stronger doubtful one within a cell, (n,)."""
    is_repeated = np.zeros(len(tones.slow), bool)
    rows = np.flatnonzero(is_doubtful)
    rows = rows[np.argsort(-tones.energy[rows], kind="stable")]
    for i, row in enumerate(rows):
        others = rows[:i][~is_repeated[rows[:i]]]
        apart = [
            abs(np.angle(np.exp(1j * (frequency[others] - frequency[row])))) * n / (2 * np.pi)
            for frequency, n in ((tones.slow, n_chirps), (tones.fast, n_samples))
        ]
        is_repeated[row] = np.any((apart[0] < 1) & (apart[1] < 1))
    return is_repeated


def _shift_variance_gain(
    components: np.ndarray, remaining_power: np.ndarray, noise_power: np.ndarray, n_points: int
) -> np.ndarray:
    """Return the variance of a frequency by echoes of nearly the same one, (n_peaks,).

    Relative to that of a lone tone in white noise, 6 sigma^2 / ((n^2 - 1) A^2). Echoes with another
    frequency on the other axis that contribute q A^2 to the peak (`components`) shift its maximum
    by sqrt(q) cos(phase) d, d cells apart along this axis, which the peak absorbs. Of their phase
    theta x, -1 < x < 1, theta = pi d, it does not absorb the curvature: q A^2 theta^4 / 45 remain
    along this axis, in few bins. So the highest `remaining_power` bounds d. Echoes more than half a
    cell apart are counted along this axis.
    """
    contributed = np.sum(np.abs(components) ** 2, axis=1).mean(axis=1)
    # Shares over 0.14 are half a cell or more; 1e9 stands for nothing contributed.
    least_power = np.maximum(1e-9 * remaining_power, np.finfo(float).tiny)
    share = _BINS_OF_REMAINDER * remaining_power / np.maximum(contributed, least_power)
    cells_apart = np.minimum((45 * share) ** 0.25 / np.pi, 0.5)
    shift_variance = (2 * np.pi / n_points * cells_apart) ** 2 / 2 * contributed
    return np.asarray(shift_variance * (n_points**2 - 1) / (6 * noise_power))


def _near_neighbour_mask(tones: Tones, n_chirps: int, n_samples: int) -> np.ndarray:
    """Return which tones have another one within the main lobe of a window, (n,).

    Unwindowed samples separate tones 1.5 cells apart, a window merges them: such tones keep their
    estimates from all samples together.
    """
    distances = [
        abs(np.angle(np.exp(1j * (frequency[:, None] - frequency)))) * n / (2 * np.pi)
        for frequency, n in ((tones.slow, n_chirps), (tones.fast, n_samples))
    ]
    is_near = (distances[0] < _MAIN_LOBE_CELLS) & (distances[1] < _MAIN_LOBE_CELLS)
    np.fill_diagonal(is_near, False)
    return np.asarray(is_near.any(axis=1))


def _significant_remainder_mask(
    remaining_power: np.ndarray, noise_power: np.ndarray, n_channels: int
) -> np.ndarray:
    """Return which remainders beside tones exceed the noise, (n, 2) along slow and fast time.

    The highest of 30 bins of noise, each the mean of n_channels exponentials, exceeds the limit
    with a probability of 0.001.
    """
    return np.asarray(remaining_power > _highest_noise_power(n_channels) * noise_power[:, None])


@lru_cache(maxsize=32)
def _highest_noise_power(n_channels: int) -> float:
    return detection_threshold(_FALSE_REMAINDER_PROBABILITY / 30, n_summed=n_channels) / n_channels


def _estimate_along_fast_time(
    samples: np.ndarray,
    tones: Tones,
    rows: np.ndarray,
    noise_power: np.ndarray,
    is_described: np.ndarray,
    has_remainder_along_slow_time: np.ndarray,
    growth: float,
) -> WindowedAxis:
    """Estimate tones from the samples at their Doppler frequency.

    Chirps are weighted by a Hann window where a remainder is beside the tone along slow time.
    """
    n_chirps, n_channels, n_samples = samples.shape
    windows = compute_window_set(n_chirps)
    index = has_remainder_along_slow_time[rows] * min(1, len(windows.weights) - 1)
    weights = windows.weights[index]
    numbers = samples.view(np.float32)
    at_doppler = np.empty((len(rows), n_channels, n_samples), np.complex128)

    # Those of the fastest tone, since its sidelobes are subtracted from the others.
    edges = _walk_block_edges(n_samples, n_chirps, float(abs(tones.slow[rows]).max()), growth)

    def fill(i: int) -> None:
        row = rows[i]
        at_doppler[i] = _sum_over_chirps(
            numbers, n_samples, tones.slow[row], growth, weights[i], edges
        )
        _subtract_other_tones(
            at_doppler[i],
            row,
            tones.amplitude,
            is_described,
            tones.slow,
            tones.slow[row],
            weights[i],
            tones.fast,
            0.1 * np.sqrt(noise_power[row]),
        )

    run_in_threads(_thread_count(len(rows) * samples.size), fill, range(len(rows)))
    return estimate_with_best_window(
        at_doppler, tones.fast[rows], noise_power[rows], windows.noise_gain[index]
    )


def _estimate_along_slow_time(
    samples: np.ndarray,
    tones: Tones,
    rows: np.ndarray,
    noise_power: np.ndarray,
    is_described: np.ndarray,
    along_fast: WindowedAxis,
    fast: np.ndarray,
    growth: float,
) -> WindowedAxis:
    """Estimate tones from the chirps at their beat frequency, with the window chosen for it."""
    n_chirps, n_channels, n_samples = samples.shape
    windows = compute_window_set(n_samples)
    weights = windows.weights[along_fast.window_index]
    numbers = samples.view(np.float32)
    at_beat = np.empty((len(rows), n_channels, n_chirps), np.complex128)

    # Those of the fastest tone, since its sidelobes are subtracted from the others.
    edges = _walk_block_edges(n_samples, n_chirps, float(abs(tones.slow[rows]).max()), growth)

    def fill(i: int) -> None:
        row = rows[i]
        at_beat[i] = _sum_over_samples(
            numbers, n_samples, fast[i], tones.slow[row] * growth, weights[i], edges
        )
        _subtract_other_tones(
            at_beat[i],
            row,
            tones.amplitude,
            is_described,
            tones.fast,
            fast[i],
            weights[i],
            tones.slow,
            0.1 * np.sqrt(noise_power[row]),
        )

    run_in_threads(_thread_count(len(rows) * samples.size), fill, range(len(rows)))
    return estimate_with_best_window(
        at_beat, tones.slow[rows], noise_power[rows], windows.noise_gain[along_fast.window_index]
    )


def _thread_count(n_samples_read: int) -> int:
    return thread_count() if n_samples_read >= _MIN_SAMPLES_FOR_THREADS else 1


def _walk_block_edges(n_samples: int, n_chirps: int, slow: float, growth: float) -> np.ndarray:
    """Return the edges of blocks of samples in which the walk through range cells is constant.

    One block where the walk changes the phase at the corners of the frame by less than 0.05 rad.
    """
    largest = abs(slow * growth) * n_chirps * n_samples / 4
    return _equal_block_edges(n_samples, min(max(math.ceil(largest / 0.05), 1), 64, n_samples))


@lru_cache(maxsize=128)
def _equal_block_edges(n_points: int, n_blocks: int) -> np.ndarray:
    edges = np.linspace(0, n_points, n_blocks + 1).round().astype(np.int64)
    edges.setflags(write=False)
    return edges


def _sum_over_chirps_in_numpy(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    growth: float,
    weights: np.ndarray,
    edges: np.ndarray,
) -> np.ndarray:
    """Plain twin of `_sum_over_chirps`: equal within single precision."""
    samples = numbers if numbers.shape[2] == n_samples else numbers.view(np.complex64)
    chirps = np.arange(len(samples))
    out = np.empty(samples.shape[1:], complex)
    for first, stop in pairwise(edges):
        walk = slow * growth * (first + stop - n_samples) / 2
        turns = weights * np.exp(-1j * (slow * chirps + walk * (chirps + 0.5 - len(chirps) / 2)))
        out[:, first:stop] = np.tensordot(turns, samples[:, :, first:stop], 1)
    return out


@kernel(plain=_sum_over_chirps_in_numpy, fastmath={"contract", "reassoc"})
def _sum_over_chirps(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    growth: float,
    weights: np.ndarray,
    edges: np.ndarray,
) -> np.ndarray:
    """Sum chirps times weights at a slow-time frequency, (channel, sample).

    Products with cosines and sines of re, im, re, im ... are summed apart, and joined at the end:
    the loop over samples then reads eight numbers at a time.
    """
    n_chirps, n_channels, n_numbers = numbers.shape
    per_sample = n_numbers // n_samples
    out = np.empty((n_channels, n_samples), np.complex128)
    cosines, sines = np.empty(n_chirps, np.float32), np.empty(n_chirps, np.float32)
    for part in range(edges.size - 1):
        first, stop = edges[part], edges[part + 1]
        walk = slow * growth * (first + stop - n_samples) / 2
        for m in range(n_chirps):
            phase = slow * m + walk * (m + 0.5 - n_chirps / 2)
            cosines[m], sines[m] = weights[m] * np.cos(phase), -weights[m] * np.sin(phase)
        by_cosine = np.empty((stop - first) * per_sample, np.float32)
        by_sine = np.empty_like(by_cosine)
        for k in range(n_channels):
            sum_chirps_times_cosines_and_sines(
                numbers, k, first * per_sample, 0, n_chirps, cosines, sines, by_cosine, by_sine
            )
            for n in range(stop - first):
                if per_sample == 2:
                    out[k, first + n] = complex(
                        by_cosine[2 * n] - by_sine[2 * n + 1], by_cosine[2 * n + 1] + by_sine[2 * n]
                    )
                else:
                    out[k, first + n] = complex(by_cosine[n], by_sine[n])
    return out


def _sum_over_samples_in_numpy(
    numbers: np.ndarray,
    n_samples: int,
    fast: float,
    walk_per_sample: float,
    weights: np.ndarray,
    edges: np.ndarray,
) -> np.ndarray:
    """Plain twin of `_sum_over_samples`: equal within single precision."""
    samples = numbers if numbers.shape[2] == n_samples else numbers.view(np.complex64)
    turns = weights * np.exp(-1j * fast * np.arange(n_samples))
    from_middle = np.arange(len(samples)) + 0.5 - len(samples) / 2
    out = np.zeros(samples.shape[:2], complex)
    for first, stop in pairwise(edges):
        walk = walk_per_sample * (first + stop - n_samples) / 2
        sums = samples[:, :, first:stop] @ turns[first:stop]
        out += np.exp(-1j * walk * from_middle)[:, None] * sums
    return np.ascontiguousarray(out.T)


@kernel(plain=_sum_over_samples_in_numpy, fastmath={"contract", "reassoc"})
def _sum_over_samples(
    numbers: np.ndarray,
    n_samples: int,
    fast: float,
    walk_per_sample: float,
    weights: np.ndarray,
    edges: np.ndarray,
) -> np.ndarray:
    """Sum samples times weights at a fast-time frequency, (channel, chirp).

    See `tone_block_sums.demodulated_block_sums` for the order of the numbers.
    """
    n_chirps, n_channels, n_numbers = numbers.shape
    per_sample = n_numbers // n_samples
    to_real, to_imaginary = np.empty(n_numbers, np.float32), np.empty(n_numbers, np.float32)
    for n in range(n_samples):
        cosine, sine = weights[n] * np.cos(fast * n), weights[n] * np.sin(fast * n)
        to_real[n * per_sample], to_imaginary[n * per_sample] = cosine, -sine
        if per_sample == 2:
            to_real[2 * n + 1], to_imaginary[2 * n + 1] = sine, cosine
    out = np.zeros((n_channels, n_chirps), np.complex128)
    for part in range(edges.size - 1):
        start, stop = edges[part] * per_sample, edges[part + 1] * per_sample
        walk = walk_per_sample * (edges[part] + edges[part + 1] - n_samples) / 2
        cosines, sines = to_real[start:stop], to_imaginary[start:stop]
        for m in range(n_chirps):
            turn = np.exp(-1j * walk * (m + 0.5 - n_chirps / 2))
            for k in range(n_channels):
                block = numbers[m, k, start:stop]
                real, imaginary = np.float32(0.0), np.float32(0.0)
                for i in range(block.size):
                    real += block[i] * cosines[i]
                    imaginary += block[i] * sines[i]
                out[k, m] += turn * complex(real, imaginary)
    return out


def _subtract_other_tones_in_numpy(
    values: np.ndarray,
    row: int,
    amplitude: np.ndarray,
    is_described: np.ndarray,
    across: np.ndarray,
    across_of_row: float,
    weights: np.ndarray,
    along: np.ndarray,
    negligible: float,
) -> None:
    """Plain twin of `_subtract_other_tones`: equal within 1e-9 of the tones."""
    n_points = values.shape[1]
    apart = abs(np.sin((along - along[row]) / 2)) * n_points
    relevance = abs(amplitude).max(axis=1) / np.maximum(1.0, apart)
    relevance[~is_described] = 0.0
    relevance[row] = 0.0
    others = np.flatnonzero(relevance > negligible)
    turns = np.exp(1j * np.outer(across[others] - across_of_row, np.arange(weights.size)))
    response = turns @ weights
    relevance[others] *= abs(response)
    strongest = np.argsort(-relevance[others], kind="stable")[:_MAX_OTHER_TONES]
    for other in strongest[relevance[others[strongest]] > negligible]:
        tone = np.exp(1j * along[others[other]] * np.arange(n_points))
        values -= np.multiply.outer(amplitude[others[other]] * response[other], tone)


@kernel(plain=_subtract_other_tones_in_numpy)
def _subtract_other_tones(
    values: np.ndarray,
    row: int,
    amplitude: np.ndarray,
    is_described: np.ndarray,
    across: np.ndarray,
    across_of_row: float,
    weights: np.ndarray,
    along: np.ndarray,
    negligible: float,
) -> None:
    """Subtract the other described tones from the values (channel, point) of a tone, in place.

    `across` are the frequencies along the other axis, which `weights` sum over. The strongest
    _MAX_OTHER_TONES of those above `negligible` are subtracted.
    """
    n_channels, n_points = values.shape
    relevance, response = np.zeros(along.size), np.zeros(along.size, np.complex128)
    for other in range(along.size):
        if other == row or not is_described[other]:
            continue
        for k in range(n_channels):
            relevance[other] = max(relevance[other], abs(amplitude[other, k]))
        apart = abs(np.sin((along[other] - along[row]) / 2)) * n_points
        relevance[other] /= max(1.0, apart)
        if relevance[other] <= negligible:  # the response is at most 1
            continue
        step, turn = np.exp(1j * (across[other] - across_of_row)), 1.0 + 0j
        for m in range(weights.size):
            response[other] += weights[m] * turn
            turn *= step
        relevance[other] *= abs(response[other])
    for _ in range(_MAX_OTHER_TONES):
        other = int(np.argmax(relevance))
        if relevance[other] <= negligible:
            break
        relevance[other] = 0.0
        step = np.exp(1j * along[other])
        for k in range(n_channels):
            tone = amplitude[other, k] * response[other]
            for n in range(n_points):
                values[k, n] -= tone
                tone *= step
