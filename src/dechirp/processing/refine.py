"""Refinement of peak frequencies on the unwindowed samples, to the Cramer-Rao bound.

A window broadens the main lobe: the peak of a Hann-windowed map has 1.5 times the standard
deviation that the samples allow, on each axis. The maximum of the unwindowed periodogram is
the maximum-likelihood estimate of a lone tone in white noise and reaches the Cramer-Rao
bound (Rife & Boorstyn 1974); the sidelobes of other tones, which the window had kept away,
are subtracted as estimated, tone by tone and in turn (Li & Stoica 1996, RELAX).
"""

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.threads import run_in_threads, thread_count

# Blocks per axis that demodulated samples are summed into: the phase of a tone 0.3 bins off changes
# by 7 degrees within a block, which costs 0.05 % of its amplitude.
N_BLOCKS = 16
N_PASSES = 3
# Estimates of all tones with the walks of aliased ones, after the first; and the most turns of
# those, 62 m/s at 77 GHz and a repetition of 250 us.
_MAX_WALK_PASSES = 3
_MAX_ALIASED_TURNS = 8
# How far from a whole turn the walk of a single aliased echo may be, and the power beside it. Walks
# of cars and people, with several echoes in a few cells, are as near by chance in one of eight.
_MAX_FRACTION_OF_TURN = 0.06
_MAX_POWER_BESIDE_POINT = 1e-3
# Passes over the strongest 256 tones that are within 3 bins of another on both axes, until their
# amplitudes change by less than a tenth of their noise. At 2 bins three passes leave an error of
# 6e-5 bins, the Cramer-Rao bound at 76 dB. A thousand tones in 128 x 128 cells would take 8 s.
MAX_PASSES = 10
_CLOSE_BINS = 3.0
_MAX_CLOSE_TONES = 256


@dataclass(frozen=True)
class Tones:
    """Frequencies and energies of tones, each array (n,)."""

    slow: np.ndarray
    """Radians per chirp."""
    fast: np.ndarray
    """Radians per sample."""
    energy: np.ndarray
    """Sum over channels of |amplitude|^2 times the number of samples of one channel."""
    amplitude: np.ndarray
    """(n, channel) complex: mean over the samples of one channel, demodulated; the phase is
    that at the first chirp and sample."""

    def select(self, tones: np.ndarray) -> "Tones":
        """Return the tones of given indices."""
        return Tones(self.slow[tones], self.fast[tones], self.energy[tones], self.amplitude[tones])


class SidelobeErrors(NamedTuple):
    """Errors of n peaks beyond those of white noise in unwindowed samples."""

    components: np.ndarray
    """(n, n_components, channel) complex: amplitudes that other echoes add to those of the peak,
    with unknown phases; the sum of their powers is the mean power of the sidelobes."""
    noise_gain: np.ndarray
    """(n,): noise power in an amplitude relative to that without windows."""
    slow_variance_gain: np.ndarray
    fast_variance_gain: np.ndarray
    """(n,): variance of each frequency relative to that of a lone tone in white noise."""

    @property
    def power(self) -> np.ndarray:
        """Mean power of the sidelobes in a channel, (n,)."""
        return np.asarray(np.sum(np.abs(self.components) ** 2, axis=1).mean(axis=1))

    def select(self, peaks: np.ndarray) -> "SidelobeErrors":
        """Return the sidelobes of peaks of given indices."""
        return SidelobeErrors(*(array[peaks] for array in self))


def average_sidelobe_errors(
    first: SidelobeErrors | None, second: SidelobeErrors | None
) -> SidelobeErrors | None:
    """Return the sidelobes of the mean of two independent amplitudes of each peak."""
    known = first or second
    if known is None:
        return None
    n_peaks, _, n_channels = known.components.shape
    none = SidelobeErrors(np.zeros((n_peaks, 0, n_channels), complex), *np.ones((3, n_peaks)))
    first, second = first or none, second or none
    return SidelobeErrors(
        np.concatenate([first.components, second.components], axis=1) / 2,
        *((a + b) / 2 for a, b in zip(first[1:], second[1:], strict=True)),
    )


class RefinedPeaks(NamedTuple):
    """Peaks of one map with refined frequencies, as those of rising ramps."""

    tones: Tones
    snr: np.ndarray
    """(n,): after integration over all samples of the map."""
    amplitude_noise: np.ndarray
    """(n,): E|w|^2 in the amplitude of a channel."""
    sidelobes: SidelobeErrors | None = None
    """Errors beyond those of white noise; None for none."""

    def select(self, peaks: np.ndarray) -> "RefinedPeaks":
        """Return the peaks of given indices."""
        return RefinedPeaks(
            tones=self.tones.select(peaks),
            snr=self.snr[peaks],
            amplitude_noise=self.amplitude_noise[peaks],
            sidelobes=None if self.sidelobes is None else self.sidelobes.select(peaks),
        )


def refine_tones(
    samples: np.ndarray,
    slow: np.ndarray,
    fast: np.ndarray,
    noise_power: np.ndarray,
    *,
    growth: float = 0.0,
) -> Tones:
    """Estimate the maximum-likelihood frequencies of tones near given ones.

    See `refine_tones_and_residuals` for the parameters.
    """
    return refine_tones_and_residuals(samples, slow, fast, noise_power, growth=growth)[0]


def refine_tones_and_residuals(
    samples: np.ndarray,
    slow: np.ndarray,
    fast: np.ndarray,
    noise_power: np.ndarray,
    *,
    growth: float = 0.0,
) -> tuple[Tones, np.ndarray]:
    """Estimate the maximum-likelihood frequencies of tones, and the power that remains beside them.

    Parameters
    ----------
    samples : array (chirp, channel, sample), complex64 or float32
        Channels may differ in phase and amplitude.
    slow, fast : arrays (n,), rad per chirp and rad per sample
        Frequencies within half a bin of the truth, strongest tone first.
    noise_power : array (n,)
        Noise in one sample near each tone; sidelobes far below it are not subtracted.
    growth : float
        Growth of slow-time frequencies from sample to sample, relative to their mean: the walk
        through range cells within the frame, see `processing.range_walk`. That of aliased tones is
        estimated.

    Returns
    -------
    Tones
        At the maximum of the periodogram, the other tones subtracted.
    array (n, 2)
        Highest power beside each tone after subtraction of all tones, along slow and fast time:
        mean of |amplitude|^2 over the channels, in whole bins up to 8 away. Echoes farther away
        are aliased into these bins, as they are in the sidelobes that reach the tone.

    Notes
    -----
    One pass over the samples for each tone, then 16 x 16 sums; tones nearer than 1.5 bins on both
    axes are not separated.
    """
    n_chirps, _, n_samples = samples.shape
    rows, columns = _block_edges(n_chirps), _block_edges(n_samples)
    # A row of real numbers, two per complex sample: compiled code then reads eight at a time.
    numbers = np.ascontiguousarray(samples).view(np.float32)
    sums = np.empty((len(slow), samples.shape[1], len(rows) - 1, len(columns) - 1), np.complex128)

    centres = np.outer(_block_centres(n_chirps), _block_centres(n_samples))
    walk = np.asarray(slow * growth, float)

    def add(i: int) -> None:
        sums[i] = _demodulated_block_sums(numbers, n_samples, slow[i], fast[i], rows, columns)
        # Over a walk of eight cells the phase error in a block is at most 0.8 rad, of the sum 3 %.
        sums[i] *= np.exp(-1j * walk[i] * centres)

    run_in_threads(thread_count(), add, range(len(slow)))
    n_samples_each = n_chirps * n_samples
    # A tenth of the standard deviation that noise gives an amplitude.
    negligible = 0.1 * np.sqrt(noise_power / n_samples_each)

    def estimate() -> tuple[np.ndarray, ...]:
        return _estimate_tones(sums, slow, fast, negligible, rows, columns, walk, growth)

    *estimates, residual_power, walk_error = estimate()
    turns, is_extended = np.zeros(len(slow)), np.zeros(len(slow), bool)
    for n_left in reversed(range(_MAX_WALK_PASSES)):  # the last one only takes turns back
        rest = _turns_beyond_noise(walk_error, estimates[2], noise_power, n_samples_each, growth)
        more = np.round(rest) * (n_left > 0)
        more[abs(turns + more) > _MAX_ALIASED_TURNS] = 0.0
        # Several echoes within a few cells leave a fraction of a turn, or power beside it.
        mean_power = estimates[2] / (n_samples_each * samples.shape[1])
        is_point = (abs(rest) < _MAX_FRACTION_OF_TURN) & (
            residual_power.max(axis=1) < _MAX_POWER_BESIDE_POINT * mean_power
        )
        is_extended |= (more == 0) & (turns != 0) & ~is_point
        more = np.where(is_extended, -turns, more)
        if not more.any():
            break
        turns += more
        for i in np.flatnonzero(more):
            walk[i] += more[i] * 2 * np.pi * growth
            sums[i] *= np.exp(-2j * np.pi * more[i] * growth * centres)
        *estimates, residual_power, walk_error = estimate()
    return Tones(*estimates), residual_power


@lru_cache(maxsize=64)
def _block_edges(n_points: int) -> np.ndarray:
    edges = np.linspace(0, n_points, min(n_points, N_BLOCKS) + 1).round().astype(np.int64)
    edges.setflags(write=False)
    return edges


@lru_cache(maxsize=64)
def _block_centres(n_points: int) -> np.ndarray:
    """Return the middle of each block relative to the middle of all."""
    edges = _block_edges(n_points)
    centres = np.asarray((edges[1:] + edges[:-1] - n_points) / 2)
    centres.setflags(write=False)
    return centres


def _demodulated_block_sums_in_numpy(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    fast: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """Plain twin of `_demodulated_block_sums`: equal within 1e-6 of the largest sum."""
    n_chirps, _, n_numbers = numbers.shape
    samples = numbers if n_numbers == n_samples else numbers.view(np.complex64)
    turned = samples * np.exp(-1j * fast * np.arange(n_samples)).astype(np.complex64)
    sums = np.add.reduceat(turned, columns[:-1], axis=2, dtype=complex)
    sums *= np.exp(-1j * slow * np.arange(n_chirps))[:, None, None]
    return np.ascontiguousarray(np.add.reduceat(sums, rows[:-1], axis=0).transpose(1, 0, 2))


@kernel(plain=_demodulated_block_sums_in_numpy, fastmath={"contract", "reassoc"})
def _demodulated_block_sums(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    fast: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """Sum blocks of samples times exp(-i (slow m + fast n)), (rx, rows, columns).

    One pass over the samples takes little more than the time to read them: the real part is
    the product of re, im, re, im ... with cos, sin, cos, sin ..., the imaginary part that
    with -sin, cos, -sin, cos ...; real samples have neither im nor every other factor.
    """
    _, n_rx, n_numbers = numbers.shape
    per_sample = n_numbers // n_samples
    to_real = np.empty(n_numbers, np.float32)
    to_imaginary = np.empty(n_numbers, np.float32)
    for n in range(n_samples):
        cosine, sine = np.cos(fast * n), np.sin(fast * n)
        to_real[n * per_sample], to_imaginary[n * per_sample] = cosine, -sine
        if per_sample == 2:
            to_real[2 * n + 1], to_imaginary[2 * n + 1] = sine, cosine
    out = np.zeros((n_rx, len(rows) - 1, len(columns) - 1), np.complex128)
    for row in range(len(rows) - 1):
        for m in range(rows[row], rows[row + 1]):
            turn = np.exp(-1j * slow * m)
            for k in range(n_rx):
                for column in range(len(columns) - 1):
                    start, stop = columns[column] * per_sample, columns[column + 1] * per_sample
                    block = numbers[m, k, start:stop]
                    cosines, sines = to_real[start:stop], to_imaginary[start:stop]
                    real, imaginary = np.float32(0.0), np.float32(0.0)
                    for i in range(block.size):
                        real += block[i] * cosines[i]
                        imaginary += block[i] * sines[i]
                    out[k, row, column] += turn * complex(real, imaginary)
    return out


@kernel(plain=AS_WRITTEN)
def _estimate_tones(
    sums: np.ndarray,
    slow: np.ndarray,
    fast: np.ndarray,
    negligible: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    walk: np.ndarray,
    growth: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Estimate frequencies, energies and amplitudes of tones, each with the others subtracted.

    The power that remains beside them, see `refine_tones_and_residuals`, and the walk beyond that
    compensated in the sums, `walk`, both in rad per chirp and sample.
    """
    n_tones, n_rx = sums.shape[:2]
    n_samples = rows[-1] * columns[-1]
    # Offsets from the demodulation frequencies of the sums.
    d_slow, d_fast = np.zeros(n_tones), np.zeros(n_tones)
    amplitude = np.zeros((n_tones, n_rx), np.complex128)
    # Of each channel, relative to that of the tone: delays differ over the array.
    channel_fast, largest_slope = np.zeros((n_tones, n_rx)), np.zeros(n_tones)
    largest, was_alone = np.zeros(n_tones), np.zeros(n_tones, np.bool_)
    remaining_power, walk_error = np.zeros((n_tones, 2)), np.zeros(n_tones)
    half = np.empty((n_tones, 4))
    for i in range(n_tones):
        _write_half_angle_sines_and_cosines(slow[i], fast[i], half[i])
    half_now = half.copy()
    n_passes = N_PASSES if n_tones > 1 else 1
    is_changing = _close_tone_mask(half, rows[-1], columns[-1])
    for turn in range(MAX_PASSES):
        for i in range(n_tones):
            if turn >= n_passes and not is_changing[i]:
                continue
            residual, is_alone = sums[i].copy(), True
            for k in range(n_tones):
                # In the first pass, weaker tones are unknown.
                if k == i or (turn == 0 and k > i):
                    continue
                apart_slow = slow[k] + d_slow[k] - slow[i]
                apart_fast = fast[k] + d_fast[k] - fast[i]
                # 2,000 tones have 4e6 pairs: their sines would take most of the time.
                sine_slow = half_now[k, 0] * half[i, 1] - half_now[k, 1] * half[i, 0]
                sine_fast = half_now[k, 2] * half[i, 3] - half_now[k, 3] * half[i, 2]
                down = _min_attenuation_by_mean(sine_slow, rows[-1]) * _min_attenuation_by_mean(
                    sine_fast, columns[-1]
                )
                if largest[k] > negligible[i] * down:
                    _subtract_separable_tone(
                        residual, amplitude[k], apart_slow, apart_fast,
                        channel_fast[k] * (largest_slope[k] > negligible[i] * down),
                        walk[k] + d_slow[k] * growth, walk[k] + d_slow[k] * growth - walk[i],
                        rows, columns,
                    )  # fmt: skip
                    is_alone = False
            is_unchanged = turn > 0 and is_alone and was_alone[i]
            was_alone[i] = is_alone
            if is_unchanged:  # neither this tone nor its neighbours have changed
                continue
            d_slow[i], d_fast[i] = _maximise_periodogram(
                residual, rows, columns, d_slow[i], d_fast[i]
            )
            _write_half_angle_sines_and_cosines(
                slow[i] + d_slow[i], fast[i] + d_fast[i], half_now[i]
            )
            gain = _blockwise_demodulation_gain(d_slow[i], rows) * _blockwise_demodulation_gain(
                d_fast[i], columns
            )
            moments = _periodogram_moments(residual, rows, columns, d_slow[i], d_fast[i])
            largest[i] = 0.0
            change = 0.0
            for k in range(n_rx):
                change = max(change, abs(moments[0, k] / gain - amplitude[i, k]))
                amplitude[i, k] = moments[0, k] / gain
                largest[i] = max(largest[i], abs(amplitude[i, k]))
            largest_slope[i] = _write_channel_frequencies(
                moments, amplitude[i], columns, negligible[i], channel_fast[i]
            )
            walk_error[i] = _unexplained_walk(moments, rows, columns)
            is_changing[i] &= change > negligible[i]
            if turn >= n_passes - 1 or is_alone:
                _subtract_tone_at(residual, amplitude[i], d_slow[i], d_fast[i], rows, columns)
                remaining_power[i, 0], remaining_power[i, 1] = _highest_power_beside(
                    residual, d_slow[i], d_fast[i], rows, columns
                )
    energy = np.zeros(n_tones)
    for i in range(n_tones):
        for k in range(n_rx):
            energy[i] += abs(amplitude[i, k]) ** 2 * n_samples
    return slow + d_slow, fast + d_fast, energy, amplitude, remaining_power, walk_error


@kernel(plain=AS_WRITTEN)
def _unexplained_walk(moments: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> float:
    """Return the walk of a tone from its moments of orders 00 and 11, rad per chirp and sample."""
    mean_square = rows[-1] ** 2 * (1 - 1 / (rows.size - 1) ** 2) / 12
    mean_square *= columns[-1] ** 2 * (1 - 1 / (columns.size - 1) ** 2) / 12
    power, product = 0.0, 0.0
    for k in range(moments.shape[1]):
        power += abs(moments[0, k]) ** 2
        product += (np.conj(moments[0, k]) * moments[4, k]).imag
    return product / max(power * mean_square, 1e-300)


def _turns_beyond_noise(
    walk_error: np.ndarray,
    energy: np.ndarray,
    noise_power: np.ndarray,
    n_samples: int,
    growth: float,
) -> np.ndarray:
    """Return the turns per chirp that the walks of tones show beyond their frequencies, (n,).

    A target faster by n half wavelengths a repetition has the same frequency, but walks n turns
    more. 0 where the walk is within seven standard deviations of that of the frequency, by the
    Cramer-Rao bound sqrt(noise_power / (2 energy)) 12 / n_samples; and for tones below 40 dB: half
    a cell of unknown walk leaves a tenth of the amplitude beside them, below noise 8 cells away.
    """
    if not growth:
        return np.zeros(len(walk_error))
    is_noise = 2 * energy * (walk_error * n_samples / 12) ** 2 <= 49 * noise_power
    is_weak = energy < 1e4 * noise_power
    return np.where(is_noise | is_weak, 0.0, walk_error / (2 * np.pi * growth))


def _subtract_tone_at_in_numpy(
    sums: np.ndarray,
    amplitude: np.ndarray,
    slow: float,
    fast: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Plain twin of `_subtract_tone_at`."""
    tone = np.multiply.outer(
        _tone_block_moments(slow, rows)[0], _tone_block_moments(fast, columns)[0]
    )
    sums -= amplitude[:, None, None] * tone


@kernel(plain=_subtract_tone_at_in_numpy)
def _subtract_tone_at(
    sums: np.ndarray,
    amplitude: np.ndarray,
    slow: float,
    fast: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Subtract a tone at an offset from the demodulation frequencies from block sums, in place."""
    over_rows, over_columns = (
        _tone_block_moments(slow, rows)[0],
        _tone_block_moments(fast, columns)[0],
    )
    for k in range(amplitude.size):
        for a in range(over_rows.size):
            for b in range(over_columns.size):
                sums[k, a, b] -= amplitude[k] * over_rows[a] * over_columns[b]


def _highest_power_beside_in_numpy(
    sums: np.ndarray, slow: float, fast: float, rows: np.ndarray, columns: np.ndarray
) -> tuple[float, float]:
    """Plain twin of `_highest_power_beside`."""
    turn_rows = np.exp(-0.5j * slow * (rows[1:] + rows[:-1] - 1))
    turn_columns = np.exp(-0.5j * fast * (columns[1:] + columns[:-1] - 1))
    turned = sums * turn_rows[:, None] * turn_columns
    scale = 1.0 / (float(rows[-1]) * columns[-1]) ** 2
    return (
        _highest_bin_power(turned.sum(axis=2)) * scale,
        _highest_bin_power(turned.sum(axis=1)) * scale,
    )


@kernel(plain=_highest_power_beside_in_numpy)
def _highest_power_beside(
    sums: np.ndarray, slow: float, fast: float, rows: np.ndarray, columns: np.ndarray
) -> tuple[float, float]:
    """Return the highest power in whole bins beside an offset, along slow and along fast time."""
    n_channels, n_rows, n_columns = sums.shape
    row_sums = np.zeros((n_channels, n_rows), np.complex128)
    column_sums = np.zeros((n_channels, n_columns), np.complex128)
    turn_rows = np.exp(-0.5j * slow * (rows[1:] + rows[:-1] - 1))
    turn_columns = np.exp(-0.5j * fast * (columns[1:] + columns[:-1] - 1))
    for k in range(n_channels):
        for a in range(n_rows):
            for b in range(n_columns):
                row_sums[k, a] += sums[k, a, b] * turn_columns[b]
                column_sums[k, b] += sums[k, a, b] * turn_rows[a]
        for a in range(n_rows):
            row_sums[k, a] *= turn_rows[a]
        for b in range(n_columns):
            column_sums[k, b] *= turn_columns[b]
    scale = 1.0 / (float(rows[-1]) * columns[-1]) ** 2
    return _highest_bin_power(row_sums) * scale, _highest_bin_power(column_sums) * scale


def _highest_bin_power_in_numpy(values: np.ndarray) -> float:
    """Plain twin of `_highest_bin_power`."""
    power = np.mean(abs(np.fft.fft(values, axis=1)) ** 2, axis=0)
    return float(power[1:].max(initial=0.0))


@kernel(plain=_highest_bin_power_in_numpy)
def _highest_bin_power(values: np.ndarray) -> float:
    """Return the highest mean power over channels of the transform of (channel, block)."""
    n_channels, n = values.shape
    turns = np.exp(-2j * np.pi * np.arange(n) / n)
    highest = 0.0
    for j in range(1, n):
        power = 0.0
        for k in range(n_channels):
            total, turn = 0j, 0
            for b in range(n):
                total += values[k, b] * turns[turn]
                turn += j
                if turn >= n:
                    turn -= n
            power += total.real**2 + total.imag**2
        highest = max(highest, power / n_channels)
    return highest


@kernel(plain=AS_WRITTEN)
def _write_half_angle_sines_and_cosines(slow: float, fast: float, out: np.ndarray) -> None:
    """Write sine and cosine of half of each, from which those of half a difference follow."""
    out[0], out[1] = np.sin(slow / 2), np.cos(slow / 2)
    out[2], out[3] = np.sin(fast / 2), np.cos(fast / 2)


@kernel(plain=AS_WRITTEN)
def _close_tone_mask(half: np.ndarray, n_rows: int, n_columns: int) -> np.ndarray:
    """Return which of the first tones have another one within _CLOSE_BINS on both axes, (n,).

    `half` (n, 4): see `_write_half_angle_sines_and_cosines`.
    """
    is_close = np.zeros(len(half), np.bool_)
    limit_slow, limit_fast = (
        np.sin(min(np.pi * _CLOSE_BINS / n_rows, np.pi / 2)),
        np.sin(min(np.pi * _CLOSE_BINS / n_columns, np.pi / 2)),
    )
    for i in range(min(len(half), _MAX_CLOSE_TONES)):
        for k in range(i):
            sine_slow = half[k, 0] * half[i, 1] - half[k, 1] * half[i, 0]
            sine_fast = half[k, 2] * half[i, 3] - half[k, 3] * half[i, 2]
            if abs(sine_slow) <= limit_slow and abs(sine_fast) <= limit_fast:
                is_close[i] = is_close[k] = True
    return is_close


@kernel(plain=AS_WRITTEN)
def _min_attenuation_by_mean(half_step_sine: float, n_points: int) -> float:
    """Return the least attenuation of a tone by the mean of n points.

    `half_step_sine` is that of half its phase step from point to point.
    """
    return max(1.0, n_points * abs(half_step_sine))


def _subtract_separable_tone_in_numpy(
    sums: np.ndarray,
    amplitude: np.ndarray,
    apart_slow: float,
    apart_fast: float,
    channel_fast: np.ndarray,
    walk: float,
    walk_apart: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Plain twin of `_subtract_separable_tone`."""
    n_chirps, n_samples = int(rows[-1]), int(columns[-1])
    bins_slow = abs(math.remainder(apart_slow, math.tau)) * n_chirps / math.tau
    bins_fast = abs(math.remainder(apart_fast, math.tau)) * n_samples / math.tau
    if max(bins_slow, bins_fast) < 1.5:
        return
    row_sums, row_moments = _tone_block_moments(apart_slow, rows)
    from_row, from_column = _block_centres(n_chirps)[:, None], _block_centres(n_samples)
    row_moments = (1j * walk * row_moments)[:, None]
    turn = np.exp((1j * walk_apart * from_row) * from_column)
    if max(bins_slow, bins_fast) < _CLOSE_BINS:
        channel_fast = np.zeros_like(channel_fast)
    for k, shift in enumerate(channel_fast.tolist()):
        column_sums, column_moments = _tone_block_moments(apart_fast + shift, columns)
        tone = row_sums[:, None] + from_column * row_moments
        tone *= column_sums + (1j * walk * from_row) * column_moments
        tone += row_moments * column_moments
        sums[k] -= amplitude[k] * cmath.exp(-0.5j * shift * (n_samples - 1)) * turn * tone


@kernel(plain=_subtract_separable_tone_in_numpy)
def _subtract_separable_tone(
    sums: np.ndarray,
    amplitude: np.ndarray,
    apart_slow: float,
    apart_fast: float,
    channel_fast: np.ndarray,
    walk: float,
    walk_apart: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Subtract another tone from block sums, in place, unless it is too near to separate.

    `channel_fast` are its frequencies in the channels relative to `apart_fast`, see
    `_write_channel_frequencies`. Those of a tone within 3 bins would contain the other one.
    `walk`, rad per chirp and sample, is that of the tone, `walk_apart` the difference from that
    compensated in the sums at the middle of each block. Where that changes the phase at the
    corners of the frame by 0.1 rad, the error of a target 80 dB below is 0.015 bins; without it
    0.25.

    In a block with the middle (r, c), the walk w turns the phase at (r + p, c + q) by
    w (r c + r q + c p + p q). The last three terms, at most 0.2 rad for each cell that the tone
    walks within the frame, are added to first order by the moments of p and q: without them a tone
    16, 32, ... bins away, whose block sums vanish, leaves a tone at the frequency sought.
    """
    bins_slow = abs((apart_slow + np.pi) % (2 * np.pi) - np.pi) * rows[-1] / (2 * np.pi)
    bins_fast = abs((apart_fast + np.pi) % (2 * np.pi) - np.pi) * columns[-1] / (2 * np.pi)
    if max(bins_slow, bins_fast) < 1.5:
        return
    is_close = max(bins_slow, bins_fast) < _CLOSE_BINS
    row_sums, row_moments = _tone_block_moments(apart_slow, rows)
    from_row = (rows[1:] + rows[:-1] - rows[-1]) / 2
    from_column = (columns[1:] + columns[:-1] - columns[-1]) / 2
    turns = np.empty((from_row.size, from_column.size), np.complex128)
    for a in range(from_row.size):
        for b in range(from_column.size):
            angle = walk_apart * from_row[a] * from_column[b]
            turns[a, b] = complex(np.cos(angle), np.sin(angle))
    tone = np.empty_like(turns)
    subtracted_shift = np.nan
    for k in range(amplitude.size):
        shift = 0.0 if is_close else channel_fast[k]
        if shift != subtracted_shift:
            subtracted_shift = shift
            column_sums, column_moments = _tone_block_moments(apart_fast + shift, columns)
            for a in range(from_row.size):
                row_sum, row_moment = row_sums[a], 1j * walk * row_moments[a]
                slope = 1j * walk * from_row[a]
                for b in range(from_column.size):
                    column_sum, column_moment = column_sums[b], column_moments[b]
                    block_sum = (row_sum + from_column[b] * row_moment) * (
                        column_sum + slope * column_moment
                    ) + row_moment * column_moment
                    tone[a, b] = block_sum * turns[a, b]
        value = amplitude[k] * np.exp(-0.5j * shift * (columns[-1] - 1))
        for a in range(from_row.size):
            for b in range(from_column.size):
                sums[k, a, b] -= value * tone[a, b]


@kernel(plain=AS_WRITTEN)
def _write_channel_frequencies(
    moments: np.ndarray,
    amplitude: np.ndarray,
    columns: np.ndarray,
    negligible: float,
    out: np.ndarray,
) -> float:
    """Write the frequencies of a tone in the channels relative to that of all, rad per sample.

    Zeros where noise explains them. Return the largest amplitude times its frequency and half the
    number of samples, the most by which frequencies change a response before its attenuation.

    From the moments of orders 00 and 01 at the frequency of all channels. Delays differ over the
    array: for eight elements at half a wavelength of 77 GHz and 60 degrees, by 0.02 cells of 0.3 m.
    With one frequency, a channel at its end keeps 0.01 / d of a tone d cells away: at 48 cells,
    10 dB over the noise from an echo 84 dB over it, which moves directions.
    """
    n_blocks = columns.size - 1
    mean_square = max(columns[-1] ** 2 * (1 - 1 / n_blocks**2) / 12, 1e-9)
    largest_slope = 0.0
    for k in range(out.size):
        power = max(abs(moments[0, k]) ** 2, 1e-300)
        out[k] = (np.conj(moments[0, k]) * moments[2, k]).imag / (power * mean_square)
        largest_slope = max(largest_slope, abs(amplitude[k] * out[k]) * columns[-1] / 2)
    # Noise makes 1.2 standard deviations of an amplitude; 5 are half of one at 3 cells.
    if largest_slope < 50 * negligible:
        out[:] = 0.0
        return 0.0
    return largest_slope


def _tone_block_moments_in_numpy(
    frequency: float, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Plain twin of `_tone_block_moments`."""
    half = math.remainder(frequency, math.tau) / 2
    lengths = edges[1:] - edges[:-1]
    # The quotients below lose half of the digits where half a step is 1e-8.
    if abs(half) < 1e-5:
        turns = np.exp(1j * half * (edges[1:] + edges[:-1] - 1))
        return lengths * turns, 1j * half / 6 * lengths * (lengths**2 - 1) * turns
    ends = np.exp(2j * half * edges) / (2j * math.sin(half) * cmath.exp(1j * half))
    sums = ends[1:] - ends[:-1]
    return sums, lengths * (ends[1:] + ends[:-1]) / 2 + 0.5j / math.tan(half) * sums


@kernel(plain=_tone_block_moments_in_numpy)
def _tone_block_moments(frequency: float, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum exp(i frequency n), and (n - n0) exp(i frequency n), over each block, (blocks,).

    n0 is the middle of the block.
    """
    sums = np.empty(edges.size - 1, np.complex128)
    moments = np.empty(edges.size - 1, np.complex128)
    half = frequency / 2 - np.pi * np.round(frequency / (2 * np.pi))
    is_still, sine, cosine = abs(half) < 1e-9, np.sin(half), np.cos(half)
    # A loop: `np.diff` and sums of arrays take 3 s more to compile.
    for k in range(sums.size):
        length = edges[k + 1] - edges[k]
        response, slope = float(length), 0.0
        if not is_still:
            response = np.sin(half * length) / sine
            slope = (length * np.cos(half * length) - response * cosine) / (2 * sine)
        turn = np.exp(1j * half * (edges[k + 1] + edges[k] - 1))
        sums[k], moments[k] = response * turn, -1j * slope * turn
    return sums, moments


def _blockwise_demodulation_gain_in_numpy(frequency: float, edges: np.ndarray) -> float:
    """Plain twin of `_blockwise_demodulation_gain`."""
    centres = (edges[1:] + edges[:-1] - 1) / 2
    return float(
        np.sum(_tone_block_moments(frequency, edges)[0] * np.exp(-1j * frequency * centres)).real
    )


@kernel(plain=_blockwise_demodulation_gain_in_numpy)
def _blockwise_demodulation_gain(frequency: float, edges: np.ndarray) -> float:
    """Return the sum of a unit tone demodulated block by block: a little less than N."""
    gain = 0.0
    tones = _tone_block_moments(frequency, edges)[0]
    for k in range(tones.size):
        centre = (edges[k + 1] + edges[k] - 1) / 2
        gain += (tones[k] * np.exp(-1j * frequency * centre)).real
    return gain


def _periodogram_moments_in_numpy(
    sums: np.ndarray, rows: np.ndarray, columns: np.ndarray, slow: float, fast: float
) -> np.ndarray:
    """Plain twin of `_periodogram_moments`."""
    p, q = (rows[1:] + rows[:-1] - 1) / 2, (columns[1:] + columns[:-1] - 1) / 2
    turn_p, turn_q = np.exp(-1j * slow * p), np.exp(-1j * fast * q)
    p, q = p - (rows[-1] - 1) / 2, q - (columns[-1] - 1) / 2
    powers_p, powers_q = turn_p * (np.ones_like(p), p, p * p), turn_q * (np.ones_like(q), q, q * q)
    moments = powers_p @ sums @ powers_q.T
    return np.stack([moments[:, i, j] for i, j in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))])


@kernel(plain=_periodogram_moments_in_numpy, fastmath={"contract", "reassoc"})
def _periodogram_moments(
    sums: np.ndarray, rows: np.ndarray, columns: np.ndarray, slow: float, fast: float
) -> np.ndarray:
    """Sum p^i q^j y exp(-i (slow p + fast q)): orders 00 10 01 20 11 02, (6, rx).

    p and q count from the middle of the aperture; a factor of unit modulus, the phase of the
    middle, is restored, so that order 00 has the phase of the periodogram.
    """
    p = (rows[1:] + rows[:-1] - 1) / 2
    q = (columns[1:] + columns[:-1] - 1) / 2
    turn_p, turn_q = np.exp(-1j * slow * p), np.exp(-1j * fast * q)
    p, q = p - (rows[-1] - 1) / 2, q - (columns[-1] - 1) / 2
    out = np.zeros((6, sums.shape[0]), np.complex128)
    for k in range(sums.shape[0]):
        for a in range(p.size):
            row_sum, row_sum_q, row_sum_qq = 0j, 0j, 0j
            for b in range(q.size):
                z = sums[k, a, b] * turn_q[b]
                row_sum += z
                row_sum_q += q[b] * z
                row_sum_qq += q[b] * q[b] * z
            row_sum *= turn_p[a]
            row_sum_q *= turn_p[a]
            out[0, k] += row_sum
            out[1, k] += p[a] * row_sum
            out[2, k] += row_sum_q
            out[3, k] += p[a] * p[a] * row_sum
            out[4, k] += p[a] * row_sum_q
            out[5, k] += row_sum_qq * turn_p[a]
    return out


@kernel(plain=AS_WRITTEN)
def _maximise_periodogram(
    sums: np.ndarray, rows: np.ndarray, columns: np.ndarray, slow: float, fast: float
) -> tuple[float, float]:
    """Find the offset of the nearest maximum of the summed periodogram, by Newton's method.

    The logarithm is maximised, which is concave over the whole main lobe: the periodogram is
    only within 0.44 bins, and noise may put the start of a tone on the wrong side of its cell. The
    noise of many channels flattens the flanks: where the curve is not concave, steps use the
    curvature of a lone tone, (N^2 - 1) / 12. Offsets beyond one bin, in noise or beside a tone
    too near to separate, become 0.
    """
    bin_slow, bin_fast = 2 * np.pi / rows[-1], 2 * np.pi / columns[-1]
    for _ in range(12):
        m = _periodogram_moments(sums, rows, columns, slow, fast)
        power, up_slow, up_fast, ss, sf, ff = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(m.shape[1]):
            conjugate = np.conj(m[0, k])
            power += abs(m[0, k]) ** 2
            up_slow += (conjugate * m[1, k]).imag
            up_fast += (conjugate * m[2, k]).imag
            ss += abs(m[1, k]) ** 2 - (conjugate * m[3, k]).real
            sf += (np.conj(m[1, k]) * m[2, k] - conjugate * m[4, k]).real
            ff += abs(m[2, k]) ** 2 - (conjugate * m[5, k]).real
        if power == 0:
            return 0.0, 0.0
        ss -= 2 * up_slow**2 / power
        sf -= 2 * up_slow * up_fast / power
        ff -= 2 * up_fast**2 / power
        if rows[-1] == 1:
            ss = -1.0  # one chirp has no Doppler frequency: the start value remains
        determinant = ss * ff - sf * sf
        step_slow = -(ff * up_slow - sf * up_fast) / determinant
        step_fast = -(ss * up_fast - sf * up_slow) / determinant
        is_hill = ss < 0 and determinant > 0
        if not is_hill or abs(step_slow) > bin_slow / 2 or abs(step_fast) > bin_fast / 2:
            step_slow = 12 / max(rows[-1] ** 2 - 1, 1) * up_slow / power
            step_fast = 12 / max(columns[-1] ** 2 - 1, 1) * up_fast / power
        slow += step_slow
        fast += step_fast
        if abs(slow) > bin_slow or abs(fast) > bin_fast:
            return 0.0, 0.0
        # The error after a step is about its square: 1e-9 of a bin, 70 dB under noise at 110 dB.
        if abs(step_slow) < 3e-5 * bin_slow and abs(step_fast) < 3e-5 * bin_fast:
            break
    return slow, fast
