"""What rounding leaves of a transform: signal over quantisation noise, by theory and measured."""

from typing import Literal

import numpy as np
import xarray as xr

from dechirp.core.checks import whole
from dechirp.core.errors import InvalidSetting
from dechirp.process.fixed_point.coefficients import POINT, twiddles
from dechirp.process.fixed_point.fft import Transformed, fft
from dechirp.process.fixed_point.words import WordLengths

Signal = Literal["tone", "noise"]


def quantisation_noise(
    shifts: np.ndarray, signal_power: np.ndarray, words: WordLengths
) -> np.ndarray:
    r"""Mean square error of each number that `fft` gives, in squares of its last bit.

    .. math:: v_j = 2 \cdot 4^{-s_j} v_{j-1} + 2 r(s_j)

    after stage j, which adds two independent numbers, shifts them by s_j and rounds both parts of
    the result once: with an error of mean square r = (1 + 2 / 4^s) / 12 where it is a multiple of
    2^-s, as where W is 1 or -i (1/8 for s = 1, 0 for none), and 1/12 elsewhere. To that comes the
    signal times the mean square error of W, of which half of the signal passes a stage. (Welch
    has the recursion, and Oppenheim and Weinstein; they round the product, the shift and the sum
    one after the other.)

    Parameters
    ----------
    shifts : array (..., n_stages)
        As of `Transformed`.
    signal_power : array (...)
        Mean square of the numbers that the transform should give, in squares of its last bit.
    words : WordLengths
        With convergent rounding.

    Returns
    -------
    array (...)

    Notes
    -----
    For signals whose last bits are random, which noise is, and tones off the bins in the mean
    over many, from 12 bits on: numbers near 0 are rounded to 0. Up to 7 % too large under block
    scaling, as a halving leaves more even numbers than odd ones to the next. Holds without
    overflows. Half-up and truncated words have a mean error besides.

    References
    ----------
    P. D. Welch, A fixed-point fast Fourier transform error analysis, IEEE Trans. Audio and
    Electroacoustics 17(2), 1969. A. V. Oppenheim, C. J. Weinstein, Effects of finite register
    length in digital filtering and the fast Fourier transform, Proc. IEEE 60(8), 1972.
    """
    if words.rounding != "convergent":
        raise InvalidSetting(
            "WordLengths.rounding",
            got=words.rounding,
            need="convergent: others have a mean error, which this law leaves out",
            fix="Measure it, with quantisation_ratio.",
        )
    n_stages = shifts.shape[-1]
    n = 2**n_stages
    turns = twiddles(n, words.twiddle_bits) / 2.0 ** (words.twiddle_bits - POINT)
    exact = np.exp(-2j * np.pi * np.arange(n // 2) / n)
    error = np.abs(turns @ np.array([1, 1j]) - exact) ** 2
    noise = np.zeros(shifts.shape[:-1])
    relative = 0.0
    for stage in range(n_stages):
        step = n >> (stage + 1)
        used = np.arange(0, n // 2, step)
        quarter_turns = np.mean(4 * used % n == 0)
        less = 4.0 ** -shifts[..., stage]
        aligned = np.where(shifts[..., stage] > 0, (1 + 2 * less) / 12, 0.0)
        noise = 2 * less * noise + 2 * (quarter_turns * aligned + (1 - quarter_turns) / 12)
        relative += error[used].mean() / 2
    return np.asarray(noise + relative * signal_power)


def quantisation_ratio(points: np.ndarray, found: Transformed) -> np.ndarray:
    """Signal over quantisation noise of each transform, a ratio of powers, (...).

    `points` (..., n, 2) are what was transformed; the signal is their transform in float64.
    """
    exact = np.fft.fft(points @ np.array([1, 1j]), axis=-1)
    words = found.points @ np.array([1, 1j]) * 2.0 ** found.shifts.sum(axis=-1)[..., None]
    error = np.sum(np.abs(words - exact) ** 2, axis=-1)
    with np.errstate(divide="ignore"):  # a transform may be exact
        return np.asarray(np.sum(np.abs(exact) ** 2, axis=-1) / error)


def full_scale(
    signal: Signal, n_trials: int, n_points: int, bits: int, rng: np.random.Generator
) -> np.ndarray:
    """Words of full scale, (n_trials, n_points, 2): tones, of any frequency and phase, or noise.

    The amplitude of a tone is the largest word; noise is even between both largest.
    """
    most = 2 ** (bits - 1) - 1
    if signal == "noise":
        return rng.integers(-most, most, size=(n_trials, n_points, 2), endpoint=True)
    cycles, start = rng.uniform(size=(2, n_trials, 1))
    phase = 2 * np.pi * (cycles * np.arange(n_points) + start)
    return np.rint(most * np.stack([np.cos(phase), np.sin(phase)], axis=-1)).astype(np.int64)


def ratios_over_bits(
    bits: tuple[int, ...] = tuple(range(8, 25, 2)),
    *,
    n_points: int = 256,
    words: WordLengths | None = None,
    n_trials: int = 100,
    seed: int = 0,
) -> xr.Dataset:
    """Signal over quantisation noise of a transform for several word lengths.

    Parameters
    ----------
    bits : ints
        Of each part of a number, and of the twiddle factors.
    n_points : int
        A power of two.
    words : WordLengths, optional
        Scaling and rounding; the default's without it.
    n_trials, seed : int
        Of tones and of noise, each, at every length.

    Returns
    -------
    Dataset over `bits` and `signal` (tone, noise), ratios of powers
        measured
            Mean signal over mean noise of all trials, in the scale of the samples.
        worst
            Of the worst trial.
        predicted
            By `quantisation_noise`; NaN for roundings that it does not know, and where words
            overflowed.
    """
    whole("n_trials", n_trials, at_least=1)
    whole("n_points", n_points, at_least=1)
    whole("number of bits", len(bits), at_least=1)
    base = words or WordLengths()
    rng = np.random.default_rng(seed)
    signals: tuple[Signal, ...] = ("tone", "noise")
    made = np.full((3, len(bits), len(signals)), np.nan)
    for place, length in enumerate(bits):
        for column, signal in enumerate(signals):
            points = full_scale(signal, n_trials, n_points, length, rng)
            one = _with_twiddles(base, length)
            found = fft(points, length, one)
            each = quantisation_ratio(points, found)
            power = np.mean(points.astype(float) ** 2, axis=(1, 2)) * 2 * n_points
            made[0, place, column] = power.sum() / (power / each).sum()
            made[1, place, column] = each.min()
            if base.rounding == "convergent" and not found.overflows.any():
                last_bit = 4.0 ** found.shifts.sum(axis=-1)  # its square, in those of samples
                noise = quantisation_noise(found.shifts, power / last_bit, one) * last_bit
                made[2, place, column] = power.sum() / noise.sum()
    names = ("measured", "worst", "predicted")
    return xr.Dataset(
        {name: (("bits", "signal"), of) for name, of in zip(names, made, strict=True)},
        coords={"bits": list(bits), "signal": list(signals)},
    )


def _with_twiddles(words: WordLengths, bits: int) -> WordLengths:
    return WordLengths(twiddle_bits=bits, scaling=words.scaling, rounding=words.rounding)
