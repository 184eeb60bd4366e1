"""Refinement of peak frequencies on the unwindowed samples, to the Cramer-Rao bound.

A window broadens the main lobe: the peak of a Hann-windowed map has 1.5 times the standard
deviation that the samples allow, on each axis. The maximum of the unwindowed periodogram is
the maximum-likelihood estimate of a lone tone in white noise and reaches the Cramer-Rao
bound (Rife & Boorstyn 1974); the sidelobes of other tones, which the window had kept away,
are subtracted as estimated, tone by tone and in turn (Li & Stoica 1996, RELAX).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.threads import run_in_threads, thread_count
from dechirp.processing.tone_block_sums import (
    block_edges,
    blockwise_demodulation_gain,
    blockwise_walk_gain,
    demodulated_block_sums,
    highest_power_beside,
    periodogram_moments,
    subtract_tone,
    walk_phase_pattern,
)

# Passes over all tones, each with the others subtracted.
_N_PASSES = 3
# Estimates of all tones with the walks of aliased ones, after the first; and the most turns of
# those, 62 m/s at 77 GHz and a repetition of 250 us.
_MAX_WALK_PASSES = 3
_MAX_ALIASED_TURNS = 8
# How far from a whole turn the walk of a single aliased echo may be, and the power beside it. Walks
# of cars and people, with several echoes in a few cells, are as near by chance in one of eight.
_MAX_FRACTION_OF_TURN = 0.06
_MAX_POWER_BESIDE_POINT = 1e-3
# Walk in range cells within the frame from which it is compensated within blocks of samples too. A
# walk of six cells costs 3.5 % of the amplitude there, one of 20 cells a third. Below, stronger
# echoes at rest beside it are subtracted exactly; above, with the error of the difference.
_MIN_CELLS_COMPENSATED_IN_BLOCKS = 6.0
# Tones nearer than this on both axes are not separated; nearer than the second, the change of an
# amplitude over chirps and channels contains the other one.
_MIN_SEPARABLE_BINS = 1.5
_CLOSE_BINS = 3.0
# Passes over the strongest 256 tones that are within 3 bins of another on both axes, until their
# amplitudes change by less than a tenth of their noise. At 2 bins three passes leave an error of
# 6e-5 bins, the Cramer-Rao bound at 76 dB. A thousand tones in 128 x 128 cells would take 8 s.
_MAX_PASSES = 10
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
    interval_ratio: float = 0.0,
) -> Tones:
    """Estimate the maximum-likelihood frequencies of tones near given ones.

    See `refine_tones_and_residuals` for the parameters.
    """
    return refine_tones_and_residuals(
        samples, slow, fast, noise_power, growth=growth, interval_ratio=interval_ratio
    )[0]


def refine_tones_and_residuals(
    samples: np.ndarray,
    slow: np.ndarray,
    fast: np.ndarray,
    noise_power: np.ndarray,
    *,
    growth: float = 0.0,
    interval_ratio: float = 0.0,
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
        estimated, up to about three cells that their frequencies do not show.
    interval_ratio : float
        Sample interval over repetition interval: targets move within a chirp too. Negative for
        samples in reversed order; 0 neglects that motion.

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
    rows, columns = block_edges(n_chirps), block_edges(n_samples)
    # A row of real numbers, two per complex sample: compiled code then reads eight at a time.
    numbers = np.ascontiguousarray(samples).view(np.float32)
    sums = np.empty((len(slow), samples.shape[1], len(rows) - 1, len(columns) - 1), np.complex128)

    walk_pattern = walk_phase_pattern(rows, columns, interval_ratio)
    walk = np.asarray(slow * growth, float)
    n_cells = abs(walk) * (n_chirps * n_samples / (2 * np.pi))
    walk_in_blocks = np.where(n_cells > _MIN_CELLS_COMPENSATED_IN_BLOCKS, walk, 0.0)

    def add(i: int) -> None:
        sums[i] = demodulated_block_sums(
            numbers, n_samples, slow[i], fast[i], walk_in_blocks[i], interval_ratio, rows, columns
        )
        sums[i] *= np.exp(-1j * walk[i] * walk_pattern)

    run_in_threads(thread_count(), add, range(len(slow)))
    return _estimate_tones_and_turns(
        sums, slow, fast, noise_power, rows, columns, walk, walk_in_blocks, growth, interval_ratio
    )


def _estimate_tones_and_turns(
    sums: np.ndarray,
    slow: np.ndarray,
    fast: np.ndarray,
    noise_power: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    walk: np.ndarray,
    walk_in_blocks: np.ndarray,
    growth: float,
    interval_ratio: float,
) -> tuple[Tones, np.ndarray]:
    """Estimate tones from block sums, with the walks of those whose velocities are aliased.

    A target faster by n half wavelengths a repetition has the same frequency, but walks n turns
    more. Those turns are compensated, and all tones estimated again.

    `sums` (n, channel, rows, columns), `rows` and `columns`: see `tone_block_sums`; `walk` (n,) is
    compensated in `sums`, rad per chirp and sample, `walk_in_blocks` (n,) also within blocks. The
    turns are added to `sums` and `walk` in place. For the other parameters and what is returned
    see `refine_tones_and_residuals`.
    """
    n_samples_each = int(rows[-1]) * int(columns[-1])
    walk_pattern = walk_phase_pattern(rows, columns, interval_ratio)
    # A tenth of the standard deviation that noise gives an amplitude.
    negligible = 0.1 * np.sqrt(noise_power / n_samples_each)
    turns, is_extended = np.zeros(len(slow)), np.zeros(len(slow), bool)
    for n_left in reversed(range(1 + _MAX_WALK_PASSES)):
        *estimates, residual_power, walk_error = _estimate_tones(
            sums,
            slow,
            fast,
            negligible,
            rows,
            columns,
            walk,
            walk_in_blocks,
            growth,
            interval_ratio,
        )
        if n_left == 0:
            break
        energy = estimates[2]
        remaining_turns = _turns_beyond_noise(
            walk_error, energy, noise_power, n_samples_each, growth
        )
        added_turns = np.round(remaining_turns)
        if n_left == 1:  # the last pass only takes turns back
            added_turns[:] = 0.0
        added_turns[abs(turns + added_turns) > _MAX_ALIASED_TURNS] = 0.0
        # Several echoes within a few cells leave a fraction of a turn, or power beside it.
        mean_power = energy / (n_samples_each * sums.shape[1])
        is_point = (abs(remaining_turns) < _MAX_FRACTION_OF_TURN) & (
            residual_power.max(axis=1) < _MAX_POWER_BESIDE_POINT * mean_power
        )
        is_extended |= (added_turns == 0) & (turns != 0) & ~is_point
        added_turns = np.where(is_extended, -turns, added_turns)
        if not added_turns.any():
            break
        turns += added_turns
        for i in np.flatnonzero(added_turns):
            walk[i] += added_turns[i] * 2 * np.pi * growth
            sums[i] *= np.exp(-2j * np.pi * added_turns[i] * growth * walk_pattern)
    return Tones(*estimates), residual_power


@kernel(plain=AS_WRITTEN)
def _estimate_tones(
    sums: np.ndarray,
    slow: np.ndarray,
    fast: np.ndarray,
    negligible: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    walk: np.ndarray,
    walk_in_blocks: np.ndarray,
    growth: float,
    interval_ratio: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Estimate frequencies, energies and amplitudes of tones, each with the others subtracted.

    See `_estimate_tones_and_turns`; `negligible` (n,) is the amplitude of tones too weak to be
    subtracted. Return arrays as of `Tones`, the power that remains beside the tones, (n, 2), and
    their walk beyond `walk`, (n,).
    """
    n_tones, n_rx = sums.shape[:2]
    n_samples = rows[-1] * columns[-1]
    # Offsets from the demodulation frequencies of the sums.
    d_slow, d_fast = np.zeros(n_tones), np.zeros(n_tones)
    amplitude = np.zeros((n_tones, n_rx), np.complex128)
    # Of each channel, relative to that of the tone: delays differ over the array.
    channel_fast, largest_slope = np.zeros((n_tones, n_rx)), np.zeros(n_tones)
    amplitude_growth, largest_change = np.zeros(n_tones), np.zeros(n_tones)
    largest, was_alone = np.zeros(n_tones), np.zeros(n_tones, np.bool_)
    remaining_power, walk_error = np.zeros((n_tones, 2)), np.zeros(n_tones)
    half = np.empty((n_tones, 4))
    for i in range(n_tones):
        _write_half_angle_sines_and_cosines(slow[i], fast[i], half[i])
    half_now = half.copy()
    n_passes = _N_PASSES if n_tones > 1 else 1
    is_changing = _close_tone_mask(half, rows[-1], columns[-1])
    for turn in range(_MAX_PASSES):
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
                    is_alone = False
                    walk_now = walk[k] + d_slow[k] * growth
                    _subtract_other_tone(
                        residual, amplitude[k], apart_slow, apart_fast,
                        channel_fast[k], largest_slope[k],
                        walk_now - walk_in_blocks[i], walk_now - walk[i],
                        amplitude_growth[k], largest_change[k],
                        negligible[i] * down, interval_ratio, rows, columns,
                    )  # fmt: skip
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
            gain = blockwise_demodulation_gain(d_slow[i], rows) * blockwise_demodulation_gain(
                d_fast[i], columns
            )
            walk_now = walk[i] + d_slow[i] * growth
            gain *= blockwise_walk_gain(walk_now - walk_in_blocks[i], rows, columns)
            moments = periodogram_moments(residual, rows, columns, d_slow[i], d_fast[i])
            largest[i], change = _write_amplitudes(moments[0], gain, amplitude[i])
            largest_slope[i] = _write_channel_frequencies(
                moments, amplitude[i], columns, negligible[i], channel_fast[i]
            )
            amplitude_growth[i], largest_change[i] = _estimate_amplitude_growth(
                moments, amplitude[i], rows, negligible[i]
            )
            walk_error[i] = _unexplained_walk(moments, rows, columns)
            is_changing[i] &= change > negligible[i]
            if turn >= n_passes - 1 or is_alone:
                subtract_tone(
                    residual, amplitude[i], d_slow[i], d_fast[i], channel_fast[i],
                    walk_now - walk_in_blocks[i], walk_now - walk[i], amplitude_growth[i],
                    interval_ratio, rows, columns,
                )  # fmt: skip
                remaining_power[i, 0], remaining_power[i, 1] = highest_power_beside(
                    residual, d_slow[i], d_fast[i], rows, columns
                )
    energy = np.zeros(n_tones)
    for i in range(n_tones):
        for k in range(n_rx):
            energy[i] += abs(amplitude[i, k]) ** 2 * n_samples
    return slow + d_slow, fast + d_fast, energy, amplitude, remaining_power, walk_error


@kernel(plain=AS_WRITTEN)
def _subtract_other_tone(
    residual: np.ndarray,
    amplitude: np.ndarray,
    apart_slow: float,
    apart_fast: float,
    channel_fast: np.ndarray,
    largest_slope: float,
    walk: float,
    walk_apart: float,
    amplitude_growth: float,
    largest_change: float,
    negligible: float,
    interval_ratio: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Subtract another tone from block sums, in place, unless it is too near to separate.

    Its change over channels and over chirps is left out below a negligible amplitude, and if the
    tone is so near that its own contains that of the other one. See `tone_block_sums.subtract_tone`
    for the other parameters.
    """
    bins = max(_bins_apart(apart_slow, rows[-1]), _bins_apart(apart_fast, columns[-1]))
    if bins < _MIN_SEPARABLE_BINS:
        return
    if bins < _CLOSE_BINS:
        largest_slope = largest_change = 0.0
    subtract_tone(
        residual, amplitude, apart_slow, apart_fast,
        channel_fast * (largest_slope > negligible),
        walk, walk_apart,
        amplitude_growth * (largest_change > negligible),
        interval_ratio, rows, columns,
    )  # fmt: skip


@kernel(plain=AS_WRITTEN)
def _write_amplitudes(values: np.ndarray, gain: float, out: np.ndarray) -> tuple[float, float]:
    """Write values over a gain, (channel,); return the largest magnitude and the largest change."""
    largest, change = 0.0, 0.0
    for k in range(out.size):
        change = max(change, abs(values[k] / gain - out[k]))
        out[k] = values[k] / gain
        largest = max(largest, abs(out[k]))
    return largest, change


@kernel(plain=AS_WRITTEN)
def _bins_apart(frequency: float, n_points: int) -> float:
    """Return the distance of a frequency, rad per point, from whole turns in bins."""
    return float(abs((frequency + np.pi) % (2 * np.pi) - np.pi) * n_points / (2 * np.pi))


@kernel(plain=AS_WRITTEN)
def _estimate_amplitude_growth(
    moments: np.ndarray, amplitude: np.ndarray, rows: np.ndarray, negligible: float
) -> tuple[float, float]:
    """Return the growth of a tone's amplitude per chirp, relative to its mean, and its change.

    The change is that from mid-frame to the end, root mean square over the channels. Zeros where
    noise explains them. `amplitude` (channel,).

    From the moments of orders 00 and 10. The echo of a target at 25 m that approaches at 75 m/s
    grows by 2.7 % within 4.5 ms: an echo 50 dB weaker, 20 cells away, then had 10 times the
    variance of its velocity.
    """
    power, product, power_of_amplitudes = 0.0, 0.0, 0.0
    for k in range(amplitude.size):
        power += abs(moments[0, k]) ** 2
        product += (np.conj(moments[0, k]) * moments[1, k]).real
        power_of_amplitudes += abs(amplitude[k]) ** 2
    mean_square = max(rows[-1] ** 2 * (1 - 1 / (rows.size - 1) ** 2) / 12, 1e-9)
    growth = product / max(power * mean_square, 1e-300)
    change = abs(growth) * rows[-1] / 2 * np.sqrt(power_of_amplitudes / amplitude.size)
    # As in `_write_channel_frequencies`.
    if change < 50 * negligible:
        return 0.0, 0.0
    return growth, change


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


@kernel(plain=AS_WRITTEN)
def _write_half_angle_sines_and_cosines(slow: float, fast: float, out: np.ndarray) -> None:
    """Write sine and cosine of half of each, from which those of half a difference follow."""
    out[0], out[1] = np.sin(slow / 2), np.cos(slow / 2)
    out[2], out[3] = np.sin(fast / 2), np.cos(fast / 2)


@kernel(plain=AS_WRITTEN)
def _close_tone_mask(half: np.ndarray, n_rows: int, n_columns: int) -> np.ndarray:
    """Return which of the first tones have another one close on both axes, (n,).

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
        m = periodogram_moments(sums, rows, columns, slow, fast)
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
