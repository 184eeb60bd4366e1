"""Interference bursts: energy in a short part of one chirp.

`background` removes static and moving echoes and leaves white noise. In white noise the share of
a chirp's energy in a stretch of L of its N samples has a beta distribution of L and N - L (half
of both for real samples), which bounds the false-alarm probability. The kurtosis of some hundred
samples has no such bound far out in its tails: there a single noise sample makes it 6 where 2 is
the mean. It is measured for the text of the finding.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.processing.quality.background import (
    Background,
    estimate_background,
    write_prediction_errors,
)

_FALSE_ALARM_PROBABILITY = 1e-12  # in a chirp of white noise: 1e-7 in 1e5 chirps
_MIN_STEPS = 3.0  # ADC steps: rounding resembles smaller bursts
_BURST_THRESHOLD = 10.0  # over the quiet samples; 5e-5 of the samples of noise exceed it
# Without NaN handling, which is not needed here, the maximum of eight values is vectorised.
_FAST = {"contract", "reassoc", "nnan", "nsz"}


@dataclass(frozen=True)
class ChirpBursts:
    """Burst measures of each chirp of a frame; NaN where chirps are lost or too few."""

    excess: np.ndarray
    """Energy of the strongest stretch over that reached by noise once in 1e12 chirps, (chirp,)."""
    share: np.ndarray
    """Share of samples in bursts, (chirp,); 0 without bursts."""
    kurtosis: np.ndarray
    """Largest kurtosis of all receivers, (chirp,); 2 of complex noise and 3 of real."""


def measure_bursts(
    samples: np.ndarray, is_lost: np.ndarray, *, n_slots: int, largest_value: float, adc_step: float
) -> ChirpBursts:
    """Measure bursts in samples (chirp, rx, sample) of one frame.

    Parameters
    ----------
    samples : array, complex64 or float32, contiguous
    is_lost : array (chirp,), bool
        Chirps to leave out.
    n_slots : int
        Number of chirps after which the same transmitter sends again.
    largest_value, adc_step : float
        Largest magnitude of a real or imaginary part; smallest difference of successive samples,
        a step of the converter.
    """
    background = estimate_background(samples, is_lost, n_slots=n_slots, largest_value=largest_value)
    if background is None:
        nan = np.full(len(samples), np.nan, np.float32)
        return ChirpBursts(excess=nan, share=nan, kurtosis=nan)
    return measure_bursts_over_background(
        background, samples, is_lost, largest_value=largest_value, adc_step=adc_step
    )


def measure_bursts_over_background(
    background: Background,
    samples: np.ndarray,
    is_lost: np.ndarray,
    *,
    largest_value: float,
    adc_step: float,
    max_share: float = 1 / 8,
) -> ChirpBursts:
    """Measure bursts with a known background.

    Stretches are up to `max_share` of a chirp: a burst half as long again is still detected, one
    of a whole chirp never is.
    """
    n_chirps, _, n_samples = samples.shape
    numbers = samples.view(np.float32)
    n_parts = numbers.shape[2] // n_samples
    excess, share, kurtosis = np.full((3, n_chirps), np.nan, np.float32)
    if not background.receiver_weight.any():
        excess[~is_lost], share[~is_lost] = 0, 0
        return ChirpBursts(excess=excess, share=share, kurtosis=kurtosis)
    lengths, limits = _stretch_lengths_and_energy_limits(
        n_samples - background.predictor.size, n_parts, max_share
    )
    floor = (
        _MIN_STEPS**2
        * n_parts
        / 2
        * float(background.receiver_weight.max())
        * (adc_step / largest_value) ** 2
    )
    _write_chirp_burst_measures(
        numbers,
        is_lost,
        background.static_samples,
        np.float32(1 / largest_value),
        background.receiver_weight,
        np.stack([background.predictor.real, background.predictor.imag]).astype(np.float32),
        lengths,
        limits,
        max(floor, background.rounding_power),
        n_parts,
        excess,
        share,
        kurtosis,
    )
    return ChirpBursts(excess=excess, share=share, kurtosis=kurtosis)


@lru_cache(maxsize=16)
def _stretch_lengths_and_energy_limits(
    n_samples: int, n_parts: int, max_share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths of stretches, and the energy shares that noise exceeds by chance."""
    lengths = 2 ** np.arange(max(1, int(np.log2(n_samples * max_share)) + 1))
    chance = _FALSE_ALARM_PROBABILITY / (lengths.size * n_samples)
    half = n_parts / 2
    return lengths, scipy.special.betainccinv(half * lengths, half * (n_samples - lengths), chance)


def _write_chirp_burst_measures_in_numpy(
    numbers: np.ndarray,
    is_lost: np.ndarray,
    static_samples: np.ndarray,
    inverse_scale: np.float32,
    weight: np.ndarray,
    predictor: np.ndarray,
    lengths: np.ndarray,
    limits: np.ndarray,
    floor: float,
    n_parts: int,
    excess: np.ndarray,
    share: np.ndarray,
    kurtosis: np.ndarray,
) -> None:
    kept, order = np.flatnonzero(~is_lost), predictor.shape[1]
    used = np.flatnonzero(weight)
    n_predicted = numbers.shape[2] // n_parts - order
    taps = predictor[0] if n_parts == 1 else predictor[0] + np.complex64(1j) * predictor[1]
    moving = numbers[np.ix_(kept, used)] * inverse_scale
    moving -= static_samples[np.ix_(kept % len(static_samples), used)]
    moving = moving if n_parts == 1 else moving.view(np.complex64)
    white = moving[..., order:].copy()
    for j in range(order):
        white -= taps[j] * moving[..., order - 1 - j :][..., :n_predicted]
    energies = weight[used, None] * (white.real**2 + white.imag**2)
    squares, fourth_powers = energies.sum(axis=2), (energies**2).sum(axis=2)
    ratio = np.divide(n_predicted * fourth_powers, squares**2, out=0 * squares, where=squares > 0)
    energy = energies.sum(axis=1)
    largest = ratio.max(axis=1, initial=0.0)
    kurtosis[kept] = largest
    excess[kept] = _largest_energy_shares_over_limit(energy, lengths, limits, floor)
    share[kept] = 0
    for row in np.flatnonzero(excess[kept] > 1):
        share[kept[row]] = _fraction_of_burst_samples(energy[row])


def _largest_energy_shares_over_limit(
    energy: np.ndarray, lengths: np.ndarray, limits: np.ndarray, floor: float
) -> np.ndarray:
    """Return `_largest_energy_share_over_limit` of each row of (chirp, sample)."""
    total, stretch_energy = energy.sum(axis=1), energy.copy()
    excess = np.zeros(len(energy))
    for length, limit in zip(lengths, limits, strict=True):
        n_starts = energy.shape[1] - length + 1
        if length > 1:
            half = length // 2
            stretch_energy[:, :n_starts] += stretch_energy[:, half : half + n_starts]
        highest = stretch_energy[:, :n_starts].max(axis=1)
        is_above_floor = highest > length * floor
        excess = np.maximum(excess, np.where(is_above_floor, highest / (total * limit), 0))
    return excess


@kernel(plain=_write_chirp_burst_measures_in_numpy, fastmath=_FAST)
def _write_chirp_burst_measures(
    numbers: np.ndarray,
    is_lost: np.ndarray,
    static_samples: np.ndarray,
    inverse_scale: np.float32,
    weight: np.ndarray,
    predictor: np.ndarray,
    lengths: np.ndarray,
    limits: np.ndarray,
    floor: float,
    n_parts: int,
    excess: np.ndarray,
    share: np.ndarray,
    kurtosis: np.ndarray,
) -> None:
    """Fill excess, share and kurtosis of each chirp.

    Receivers are summed, and count as one in the law: moving echoes are common to them.
    """
    n_chirps, n_rx, n_numbers = numbers.shape
    n_samples, order = n_numbers // n_parts, predictor.shape[1]
    n_predicted = n_samples - order
    parts = np.zeros((2, n_samples), np.float32)
    white = np.zeros((2, n_predicted), np.float32)
    energy = np.empty(n_predicted, np.float32)
    for m in range(n_chirps):
        if is_lost[m]:
            continue
        energy[:] = 0
        largest = 0.0
        for k in range(n_rx):
            if weight[k] == 0:
                continue
            static_row = static_samples[m % static_samples.shape[0], k]
            for part in range(n_parts):
                for n in range(n_samples):
                    i = n_parts * n + part
                    parts[part, n] = numbers[m, k, i] * inverse_scale - static_row[i]
            write_prediction_errors(parts, predictor, n_parts, white)
            squares, fourth_powers = np.float32(0), np.float32(0)
            for n in range(n_predicted):
                u = weight[k] * (white[0, n] * white[0, n] + white[1, n] * white[1, n])
                energy[n] += u
                squares += u
                fourth_powers += u * u
            if squares > 0:
                largest = max(largest, n_predicted * fourth_powers / (squares * squares))
        kurtosis[m] = largest
        excess[m] = _largest_energy_share_over_limit(energy, lengths, limits, floor)
        share[m] = _fraction_of_burst_samples(energy) if excess[m] > 1 else 0


@kernel(fastmath=_FAST)
def _largest_energy_share_over_limit(
    energy: np.ndarray, lengths: np.ndarray, limits: np.ndarray, floor: float
) -> float:
    """Return the largest share of the energy in a stretch, over the limit of its length."""
    total = np.float32(0)
    stretch_energy = energy.copy()
    for n in range(energy.size):
        total += energy[n]
    excess = 0.0
    for i in range(lengths.size):
        length = lengths[i]
        n_starts = energy.size - length + 1
        if i > 0:
            # Sums over twice the length add two adjacent sums of the length before.
            second_half = stretch_energy[length // 2 :]
            for n in range(n_starts):
                stretch_energy[n] += second_half[n]
        highest = np.float32(0)
        for n in range(n_starts):
            highest = max(highest, stretch_energy[n])
        if highest > length * floor:
            excess = max(excess, highest / (total * limits[i]))
    return excess


@kernel(plain=AS_WRITTEN)
def _fraction_of_burst_samples(energy: np.ndarray) -> float:
    # The median of noise is 0.69 of its mean, and more of receivers summed.
    threshold = _BURST_THRESHOLD * np.median(energy) / 0.69
    return np.count_nonzero(energy > threshold) / energy.size
