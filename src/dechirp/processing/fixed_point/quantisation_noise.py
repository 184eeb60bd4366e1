"""Quantisation noise of fixed-point transforms, predicted and measured."""

from typing import Literal

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.processing.fixed_point.coefficients import INTEGER_BITS, integer_twiddle_factors
from dechirp.processing.fixed_point.fft import (
    FftResult,
    fft,
    turns_after_pair,
    twiddles_after_pair,
)
from dechirp.processing.fixed_point.word_lengths import WordLengths

__all__ = ["predict_quantisation_noise", "signal_to_quantisation_noise_over_bits"]

Signal = Literal["tone", "noise"]


@check_argument_types
def predict_quantisation_noise(
    shifts: np.ndarray, signal_power: np.ndarray, words: WordLengths
) -> np.ndarray:
    r"""Return the mean square error of the values of `fft`, in squares of the last bit.

    .. math:: v_j = 2 \cdot 4^{-s_j} v_{j-1} + 2 r_j

    after stage j, which adds two independent values, shifts them by s_j and rounds both parts
    of the result once. The mean square r of that error is 1/12 where the result is the product with
    a twiddle factor W. Where W is 1 or a quarter turn, in the first stage of a pair and for 1/4 +
    4/m of its m points in the second one, the result is a multiple of 2^-s and

    .. math:: r = e_{s-1} + 2 q (e_s - e_{s-1}), \quad e_s = (1 + 2 / 4^s) / 12, \quad e_0 = 0

    and 0 for s = 0, where q is the share of odd sums: 2 p (1 - p) of words of which a share p is
    odd, 1/2 at first and after a product. Halves (q of the sums for s = 1, else (1 - q) 2^(1-s))
    are rounded to even words; every second one of the other sums becomes odd. The signal times the
    mean square error of W is added in every second stage. (Welch, and Oppenheim and Weinstein, give
    the recursion for radix 2; they round the product, the shift and the sum one after the other,
    and take every q as 1/2.)

    Parameters
    ----------
    shifts : array (..., n_stages)
        As in `FftResult`.
    signal_power : array (...)
        Mean square of the exact values of the transform, in squares of its last bit.
    words : WordLengths
        Word lengths with convergent rounding.

    Returns
    -------
    array (...)

    Notes
    -----
    Accurate to 2 % for signals with random last bits, such as noise, and for tones off the bins
    averaged over many, from 12 bits on: with fewer, values near 0 are rounded to 0. Valid without
    overflows. Half-up and truncated words have an additional mean error.

    References
    ----------
    P. D. Welch, A fixed-point fast Fourier transform error analysis, IEEE Trans. Audio and
    Electroacoustics 17(2), 1969. A. V. Oppenheim, C. J. Weinstein, Effects of finite register
    length in digital filtering and the fast Fourier transform, Proc. IEEE 60(8), 1972.
    """
    if words.rounding != "convergent":
        raise InvalidSetting(
            "WordLengths.rounding",
            value=words.rounding,
            expected="convergent; the prediction excludes the mean error of the others",
            fix="measure it with signal_to_quantisation_noise",
        )
    n_stages = shifts.shape[-1]
    n = 2**n_stages
    factors = integer_twiddle_factors(n, words.twiddle_bits) / 2.0 ** (
        words.twiddle_bits - INTEGER_BITS
    )
    noise, odd_words = np.zeros(shifts.shape[:-1]), np.full(shifts.shape[:-1], 0.5)
    relative = 0.0
    for stage in range(n_stages):
        shift, quarter_turns = shifts[..., stage], 1.0
        if stage % 2:
            n_points = n >> (stage - 1)
            turns = turns_after_pair(n_points)
            exact = np.exp(-2j * np.pi * turns / n_points)
            error = twiddles_after_pair(factors, n_points) @ np.array([1, 1j]) - exact
            relative += np.mean(np.abs(error) ** 2)
            quarter_turns = np.mean(4 * turns % n_points == 0)
        odd_sums = 2 * odd_words * (1 - odd_words)
        shorter_error = _error_of_uniform_fraction(shift - 1)
        full_error = _error_of_uniform_fraction(shift)
        aligned = np.where(
            shift > 0, shorter_error + 2 * odd_sums * (full_error - shorter_error), 0.0
        )
        noise = 2 * 4.0**-shift * noise + 2 * (quarter_turns * aligned + (1 - quarter_turns) / 12)
        halves = np.where(shift == 1, odd_sums, (1 - odd_sums) * 2.0 ** (1 - shift))
        odd_of_aligned = np.where(shift > 0, (1 - halves) / 2, odd_sums)
        odd_words = quarter_turns * odd_of_aligned + (1 - quarter_turns) / 2
    return np.asarray(noise + relative * signal_power)


def _error_of_uniform_fraction(bits: np.ndarray) -> np.ndarray:
    """Return the mean square error of rounding a word with this many random fraction bits."""
    return np.where(bits > 0, (1 + 2 * 4.0**-bits) / 12, 0.0)


def signal_to_quantisation_noise(points: np.ndarray, result: FftResult) -> np.ndarray:
    """Return signal over quantisation noise of each transform, a ratio of powers, (...).

    `points` (..., n, 2) are the input of the transform; the signal is their transform in float64.
    """
    exact = np.fft.fft(points @ np.array([1, 1j]), axis=-1)
    words = result.points @ np.array([1, 1j]) * 2.0 ** result.shifts.sum(axis=-1)[..., None]
    error = np.sum(np.abs(words - exact) ** 2, axis=-1)
    with np.errstate(divide="ignore"):  # a transform may be exact
        return np.asarray(np.sum(np.abs(exact) ** 2, axis=-1) / error)


def make_full_scale_signal(
    signal: Signal, n_trials: int, n_points: int, bits: int, rng: np.random.Generator
) -> np.ndarray:
    """Return full-scale tones of random frequency and phase, or noise, (n_trials, n_points, 2).

    The amplitude of a tone is the largest word; noise is uniform in the disc of this radius.
    """
    largest_word = 2 ** (bits - 1) - 1
    amplitude = float(largest_word)
    if signal == "noise":
        amplitude = largest_word * np.sqrt(rng.uniform(size=(n_trials, n_points, 1)))
        phase = rng.uniform(0, 2 * np.pi, size=(n_trials, n_points))
    else:
        cycles, start = rng.uniform(size=(2, n_trials, 1))
        phase = 2 * np.pi * (cycles * np.arange(n_points) + start)
    points = amplitude * np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    return np.rint(points).astype(np.int64)


@check_argument_types
def signal_to_quantisation_noise_over_bits(
    bits: tuple[int, ...] = tuple(range(8, 25, 2)),
    *,
    n_points: int = 256,
    words: WordLengths | None = None,
    n_trials: int = 100,
    seed: int = 0,
) -> xr.Dataset:
    """Return the signal over quantisation noise of a transform for several word lengths.

    Parameters
    ----------
    bits : ints
        Bits of each part of a value, and of the twiddle factors.
    n_points : int
        A power of two.
    words : WordLengths, optional
        Scaling and rounding; the default words if omitted.
    n_trials, seed : int
        Number of tones and of noise signals at every length, and the seed.

    Returns
    -------
    Dataset over `bits` and `signal` (tone, noise), ratios of powers
        measured
            Mean signal over mean noise of all trials, in the scale of the samples.
        worst
            Ratio of the worst trial.
        predicted
            By `predict_quantisation_noise`; NaN for other roundings, and where words overflowed.
    """
    check_integer("n_trials", n_trials, at_least=1)
    check_integer("n_points", n_points, at_least=1)
    check_integer("number of bits", len(bits), at_least=1)
    base = words or WordLengths()
    check_integer("seed", seed, at_least=0)
    rng = np.random.default_rng(seed)
    signals: tuple[Signal, ...] = ("tone", "noise")
    ratios = np.full((3, len(bits), len(signals)), np.nan)
    for row, length in enumerate(bits):
        for column, signal in enumerate(signals):
            points = make_full_scale_signal(signal, n_trials, n_points, length, rng)
            trial_words = _with_twiddle_bits(base, length)
            result = fft(points, length, trial_words)
            trial_ratios = signal_to_quantisation_noise(points, result)
            power = np.mean(points.astype(float) ** 2, axis=(1, 2)) * 2 * n_points
            ratios[0, row, column] = power.sum() / (power / trial_ratios).sum()
            ratios[1, row, column] = trial_ratios.min()
            if base.rounding == "convergent" and not result.overflows.any():
                last_bit = 4.0 ** result.shifts.sum(axis=-1)  # squared, relative to that of samples
                noise = (
                    predict_quantisation_noise(result.shifts, power / last_bit, trial_words)
                    * last_bit
                )
                ratios[2, row, column] = power.sum() / noise.sum()
    names = ("measured", "worst", "predicted")
    return xr.Dataset(
        {name: (("bits", "signal"), values) for name, values in zip(names, ratios, strict=True)},
        coords={"bits": list(bits), "signal": list(signals)},
    )


def _with_twiddle_bits(words: WordLengths, bits: int) -> WordLengths:
    return WordLengths(twiddle_bits=bits, scaling=words.scaling, rounding=words.rounding)
