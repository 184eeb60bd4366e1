"""Interference that comes in bursts: energy in a short part of one chirp.

What stands still is the same in every chirp
and is subtracted. What moves is smooth: a linear predictor, fitted to the quieter half of the
chirps, takes it out of every sample by those before, and leaves noise that is white. In white
noise the share of a chirp's energy in a stretch of L of its N samples has a beta law, of L and
N - L (half of both for real samples). So the chance of a false alarm has a bound, which the
kurtosis of some hundred samples has not so far out in its tails: there a single sample of
noise makes it 6 where 2 is the mean. The kurtosis is measured for the words of the finding.
"""

from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np
from scipy.special import betainccinv

_CHANCE = 1e-12  # of a false burst in a chirp of white noise: 1e-7 in 1e5 chirps
_FEWEST_CHIRPS = 4  # of one transmitter: fewer do not tell what stands still
_FEWEST_SAMPLES = 16
_GROUPS = 16  # of chirps, whose means' median is what stands still; bursts in 7 do not move it
_FITTED = 2**14  # samples that the predictor is fitted to: 1000 for each of its weights
_STEPS = 3.0  # of the converter: smaller bursts are how rounding looks
_OVER_QUIET = 10.0  # samples this far over the quiet ones are in a burst; noise: 5e-5 of them
ROUNDING = 1e-12  # -120 dB; float32 has -144 dB, a converter of 16 bits -98 dB
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
    n_chirps, n_rx, n_samples = samples.shape
    numbers = samples.view(np.float32)
    n_parts = numbers.shape[2] // n_samples
    nan = np.full(n_chirps, np.nan, np.float32)
    inverse = np.float32(1 / scale)
    kept = min(int(np.count_nonzero(~lost[slot::n_slots])) for slot in range(n_slots))
    if kept < _FEWEST_CHIRPS or n_samples < _FEWEST_SAMPLES:
        return Bursts(excess=nan, share=nan, kurtosis=nan)
    usable = np.flatnonzero(~lost)
    power, _ = _powers(numbers, _still(numbers, usable, n_slots, inverse, groups=_GROUPS), inverse)
    quiet = _quiet(power.sum(axis=1), usable, n_slots)
    # The median has told which chirps to trust; their mean is smooth, as the median is not.
    still = _still(numbers, quiet, n_slots, inverse, groups=1)
    power, mean_power = _powers(numbers, still, inverse)
    weight = np.zeros(n_rx, np.float32)
    typical = np.median(power[quiet], axis=0)
    alive = typical > ROUNDING * mean_power[~lost].mean(axis=0)
    weight[alive] = 1 / typical[alive]
    excess, share, kurtosis = nan.copy(), nan.copy(), nan.copy()
    if not alive.any():
        excess[~lost], share[~lost] = 0, 0
        return Bursts(excess=excess, share=share, kurtosis=kurtosis)
    taps = _predictor(samples, still.view(samples.dtype), quiet, np.flatnonzero(alive), inverse)
    n_whole = n_samples - taps.size
    lengths, limits = _limits(n_whole, n_parts)
    floor = _STEPS**2 * n_parts / 2 * float(weight.max()) * (step / scale) ** 2
    rounding = ROUNDING * float(np.sum(weight * mean_power[~lost].mean(axis=0)))
    taps_of_parts = np.stack([taps.real, taps.imag]).astype(np.float32)
    _scan(
        numbers,
        lost,
        still,
        inverse,
        weight,
        taps_of_parts,
        lengths,
        limits,
        max(floor, rounding),
        n_parts,
        excess,
        share,
        kurtosis,
    )
    return Bursts(excess=excess, share=share, kurtosis=kurtosis)


@lru_cache(maxsize=16)
def _limits(n_samples: int, n_parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Lengths of stretches, and the shares of the energy that noise exceeds by chance."""
    lengths = 2 ** np.arange(max(1, int(np.log2(n_samples / 8)) + 1))
    chance = _CHANCE / (lengths.size * n_samples)
    half = n_parts / 2
    return lengths, betainccinv(half * lengths, half * (n_samples - lengths), chance)


def _still(
    numbers: np.ndarray, chirps: np.ndarray, n_slots: int, inverse: np.float32, *, groups: int
) -> np.ndarray:
    """What stands still, (slot, rx, number): the median of the means of groups of chirps.

    A mean of all would carry a burst of 60 dB in one of 128 chirps into the others, 18 dB
    over the noise.
    """
    out = np.empty((n_slots, *numbers.shape[1:]), np.float32)
    for slot in range(n_slots):
        own = chirps[chirps % n_slots == slot]
        parts = np.array_split(own, min(groups, own.size))
        starts = np.cumsum([0, *(part.size for part in parts)])
        out[slot] = np.median(_means(numbers, own, starts, inverse), axis=0)
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _means(
    numbers: np.ndarray, chosen: np.ndarray, starts: np.ndarray, inverse: np.float32
) -> np.ndarray:
    """Means of groups of chirps, (group, rx, number)."""
    out = np.zeros((starts.size - 1, *numbers.shape[1:]), np.float32)
    for group in range(starts.size - 1):
        share = inverse / np.float32(starts[group + 1] - starts[group])
        for i in range(starts[group], starts[group + 1]):
            for k in range(numbers.shape[1]):
                for j in range(numbers.shape[2]):
                    out[group, k, j] += share * numbers[chosen[i], k, j]
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _powers(
    numbers: np.ndarray, still: np.ndarray, inverse: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares of what does not stand still, and of all, (chirp, rx)."""
    n_chirps, n_rx, n_numbers = numbers.shape
    moving = np.zeros((n_chirps, n_rx), np.float64)
    whole = np.zeros((n_chirps, n_rx), np.float64)
    for m in range(n_chirps):
        for k in range(n_rx):
            rest, every = np.float32(0), np.float32(0)
            for i in range(n_numbers):
                x = numbers[m, k, i] * inverse
                y = x - still[m % still.shape[0], k, i]
                every += x * x
                rest += y * y
            moving[m, k], whole[m, k] = rest / n_numbers, every / n_numbers
    return moving, whole


def _quiet(power: np.ndarray, usable: np.ndarray, n_slots: int) -> np.ndarray:
    """Chirps of which the least moves: half of those of each transmitter, ascending."""
    chosen = []
    for slot in range(n_slots):
        own = usable[usable % n_slots == slot]
        chosen.append(own[np.argsort(power[own])[: (own.size + 1) // 2]])
    return np.sort(np.concatenate(chosen))


def _predictor(
    samples: np.ndarray,
    still: np.ndarray,
    quiet: np.ndarray,
    alive: np.ndarray,
    inverse: np.float32,
) -> np.ndarray:
    """Weights of the samples before, (order,), that predict what moves, least squares.

    As many tones as weights are predicted without error, whatever their strength.
    """
    order = min(16, samples.shape[2] // 8)
    per_receiver = max(1, _FITTED // (samples.shape[2] * alive.size))
    chosen = quiet[:: -(-quiet.size // per_receiver)]
    rows = samples[np.ix_(chosen, alive)] * inverse
    rows -= still[np.ix_(chosen % len(still), alive)]
    rows = rows.astype(np.complex128 if np.iscomplexobj(rows) else np.float64)
    products = _products(rows.reshape(-1, samples.shape[2]), order)
    before, now = products[:-1, :-1], products[:-1, -1]
    # Rounding has -144 dB: weights that fit it would be huge.
    before = before + 1e-12 * np.trace(before).real * np.eye(order)
    return np.linalg.solve(before, now)[::-1]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _products(rows: np.ndarray, order: int) -> np.ndarray:
    """Sums over rows (row, sample) and n of conj(x[n + i]) x[n + j], (order + 1, order + 1).

    Only the first row is summed: along a diagonal, sums differ by their first and last terms.
    (A matrix product would take threads, and wait for them where the machine is busy.)
    """
    n_whole = rows.shape[1] - order
    out = np.zeros((order + 1, order + 1), rows.dtype)
    for row in rows:
        for lag in range(order + 1):
            total = row.dtype.type(0)
            for n in range(n_whole):
                total += np.conj(row[n]) * row[n + lag]
            out[0, lag] += total
            for i in range(order - lag):
                j = i + lag
                total += np.conj(row[i + n_whole]) * row[j + n_whole] - np.conj(row[i]) * row[j]
                out[i + 1, j + 1] += total
    for i in range(order + 1):
        for j in range(i):
            out[i, j] = np.conj(out[j, i])
    return out


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
            _whiten(parts, taps, n_parts, white)
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


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
def _whiten(parts: np.ndarray, taps: np.ndarray, n_parts: int, white: np.ndarray) -> None:
    """What the samples before do not predict: loops over samples, so that eight go at once."""
    order, n_whole = taps.shape[1], white.shape[1]
    white_x, white_y = white[0], white[1]
    for part in range(n_parts):
        for n in range(n_whole):
            white[part, n] = parts[part, n + order]
    for j in range(order):
        real, imaginary = taps[0, j], taps[1, j]
        start = order - 1 - j
        # Slices, since an index that might be negative keeps a loop one sample wide.
        x, y = parts[0, start : start + n_whole], parts[1, start : start + n_whole]
        if n_parts == 1:
            for n in range(n_whole):
                white_x[n] -= real * x[n]
        else:
            for n in range(n_whole):
                white_x[n] -= real * x[n] - imaginary * y[n]
                white_y[n] -= real * y[n] + imaginary * x[n]
