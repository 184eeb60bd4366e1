"""Interference that comes in bursts: energy in a short part of one chirp.

Where `quiet` has taken out what stands still and what moves, noise is left that is white. In
white noise the share of a chirp's energy in a stretch of L of its N samples has a beta law, of
L and N - L (half of both for real samples). So the chance of a false alarm has a bound, which the
kurtosis of some hundred samples has not so far out in its tails: there a single sample of
noise makes it 6 where 2 is the mean. The kurtosis is measured for the words of the finding.
"""

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
from scipy.special import betainccinv

from dechirp.process.health.quiet import Quiet, quiet_half, whiten

_CHANCE = 1e-12  # of a false burst in a chirp of white noise: 1e-7 in 1e5 chirps
_STEPS = 3.0  # of the converter: smaller bursts are how rounding looks
_OVER_QUIET = 10.0  # samples this far over the quiet ones are in a burst; noise: 5e-5 of them
# Without "not a number", which never comes here, the largest of eight is found at once.
_FAST = {"contract", "reassoc", "nnan", "nsz"}


@dataclass(frozen=True)
class Bursts:
    """Of each chirp of a frame; NaN where chirps are lost or too few."""

    excess: np.ndarray
    """(chirp,), energy of the strongest stretch over what noise reaches once in 1e12 chirps."""
    share: np.ndarray
    """(chirp,), samples in bursts over all; 0 where there is none."""
    kurtosis: np.ndarray
    """(chirp,), 2 of complex noise and 3 of real, of the receiver where it is largest."""


def bursts(
    samples: np.ndarray, lost: np.ndarray, *, n_slots: int, scale: float, step: float
) -> Bursts:
    """Look for bursts in samples (chirp, rx, sample) of one frame.

    Parameters
    ----------
    samples : array, complex64 or float32, contiguous
    lost : array (chirp,), bool
        Chirps to leave out.
    n_slots : int
        After so many chirps the same transmitter sends again.
    scale, step : float
        Largest number; smallest difference of samples in turn, a step of the converter.
    """
    quiet = quiet_half(samples, lost, n_slots=n_slots, scale=scale)
    if quiet is None:
        nan = np.full(len(samples), np.nan, np.float32)
        return Bursts(excess=nan, share=nan, kurtosis=nan)
    return bursts_beside(quiet, samples, lost, scale=scale, step=step)


def bursts_beside(
    quiet: Quiet,
    samples: np.ndarray,
    lost: np.ndarray,
    *,
    scale: float,
    step: float,
    longest: float = 1 / 8,
) -> Bursts:
    """The same, with what is known of the quieter chirps.

    In stretches of up to `longest` of a chirp: a burst half as long again is still found, one of
    a whole chirp never is.
    """
    n_chirps, _, n_samples = samples.shape
    numbers = samples.view(np.float32)
    n_parts = numbers.shape[2] // n_samples
    excess, share, kurtosis = np.full((3, n_chirps), np.nan, np.float32)
    if not quiet.weight.any():
        excess[~lost], share[~lost] = 0, 0
        return Bursts(excess=excess, share=share, kurtosis=kurtosis)
    lengths, limits = _limits(n_samples - quiet.taps.size, n_parts, longest)
    floor = _STEPS**2 * n_parts / 2 * float(quiet.weight.max()) * (step / scale) ** 2
    _scan(
        numbers,
        lost,
        quiet.still,
        np.float32(1 / scale),
        quiet.weight,
        np.stack([quiet.taps.real, quiet.taps.imag]).astype(np.float32),
        lengths,
        limits,
        max(floor, quiet.rounding),
        n_parts,
        excess,
        share,
        kurtosis,
    )
    return Bursts(excess=excess, share=share, kurtosis=kurtosis)


@lru_cache(maxsize=16)
def _limits(n_samples: int, n_parts: int, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of stretches, and the shares of the energy that noise exceeds by chance."""
    lengths = 2 ** np.arange(max(1, int(np.log2(n_samples * longest)) + 1))
    chance = _CHANCE / (lengths.size * n_samples)
    half = n_parts / 2
    return lengths, betainccinv(half * lengths, half * (n_samples - lengths), chance)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _scan(
    numbers: np.ndarray,
    lost: np.ndarray,
    still: np.ndarray,
    inverse: np.float32,
    weight: np.ndarray,
    taps: np.ndarray,
    lengths: np.ndarray,
    limits: np.ndarray,
    floor: float,
    n_parts: int,
    excess: np.ndarray,
    share: np.ndarray,
    kurtosis: np.ndarray,
) -> None:
    """Fill excess, share and kurtosis of each chirp.

    Receivers are summed, and count as one in the law: what moves is common to them.
    """
    n_chirps, n_rx, n_numbers = numbers.shape
    n_samples, order = n_numbers // n_parts, taps.shape[1]
    n_whole = n_samples - order
    parts = np.zeros((2, n_samples), np.float32)
    white = np.zeros((2, n_whole), np.float32)
    energy = np.empty(n_whole, np.float32)
    for m in range(n_chirps):
        if lost[m]:
            continue
        energy[:] = 0
        largest = 0.0
        for k in range(n_rx):
            if weight[k] == 0:
                continue
            behind = still[m % still.shape[0], k]
            for part in range(n_parts):
                for n in range(n_samples):
                    i = n_parts * n + part
                    parts[part, n] = numbers[m, k, i] * inverse - behind[i]
            whiten(parts, taps, n_parts, white)
            squares, fourth = np.float32(0), np.float32(0)
            for n in range(n_whole):
                u = weight[k] * (white[0, n] * white[0, n] + white[1, n] * white[1, n])
                energy[n] += u
                squares += u
                fourth += u * u
            if squares > 0:
                largest = max(largest, n_whole * fourth / (squares * squares))
        kurtosis[m] = largest
        excess[m] = _strongest_stretch(energy, lengths, limits, floor)
        share[m] = _share_over_quiet(energy) if excess[m] > 1 else 0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _strongest_stretch(
    energy: np.ndarray, lengths: np.ndarray, limits: np.ndarray, floor: float
) -> float:
    """Largest share of the energy in a stretch, over the limit of its length."""
    total = np.float32(0)
    within = energy.copy()
    for n in range(energy.size):
        total += energy[n]
    excess = 0.0
    for i in range(lengths.size):
        length = lengths[i]
        n_starts = energy.size - length + 1
        if i > 0:
            # Sums over twice the length are two of those before, side by side.
            beside = within[length // 2 :]
            for n in range(n_starts):
                within[n] += beside[n]
        highest = np.float32(0)
        for n in range(n_starts):
            highest = max(highest, within[n])
        if highest > length * floor:
            excess = max(excess, highest / (total * limits[i]))
    return excess


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _share_over_quiet(energy: np.ndarray) -> float:
    # The median of noise is 0.69 of its mean, and more of receivers summed.
    threshold = _OVER_QUIET * np.median(energy) / 0.69
    return np.count_nonzero(energy > threshold) / energy.size
