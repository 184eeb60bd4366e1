"""The quieter half of the chirps of a frame: what stands still in it, and what predicts the rest.

What stands still is the same in every chirp and is subtracted. What moves is smooth: a linear
predictor, fitted to the quieter half of the chirps, takes it out of every sample by those
before, and leaves noise that is white.
"""

from dataclasses import dataclass

import numba
import numpy as np

FEWEST_CHIRPS = 4  # of one transmitter: fewer do not tell what stands still
FEWEST_SAMPLES = 16
_GROUPS = 16  # of chirps, whose means' median is what stands still; bursts in 7 do not move it
_FITTED = 2**14  # samples that the predictor is fitted to: 1000 for each of its weights
_FAINTEST = 1e-36  # of full power; one over less would leave float32
ROUNDING = 1e-12
"""-120 dB; float32 has -144 dB, a converter of 16 bits -98 dB."""


@dataclass(frozen=True)
class Quiet:
    """What is known of a frame from the quieter half of its chirps, all over a scale."""

    chirps: np.ndarray
    """(n,), those of which the least moves, ascending."""
    still: np.ndarray
    """(slot, rx, number), what stands still: of complex samples two numbers each."""
    weight: np.ndarray
    """(rx,), one over the power of what moves; 0 of receivers in which nothing does."""
    rounding: float
    """Power of rounding errors, as `weight` weighs it."""
    taps: np.ndarray
    """(order,), weights of the samples before that predict what moves, the nearest first; none
    where nothing moves."""


def quiet_half(
    samples: np.ndarray, lost: np.ndarray, *, n_slots: int, scale: float
) -> Quiet | None:
    """What the quieter half of one frame tells; None where chirps or samples are too few.

    Parameters
    ----------
    samples : array (chirp, rx, sample), complex64 or float32, contiguous
    lost : array (chirp,), bool
        Chirps to leave out.
    n_slots : int
        After so many chirps the same transmitter sends again.
    scale : float
        Largest number.
    """
    n_rx, n_samples = samples.shape[1:]
    kept = min(int(np.count_nonzero(~lost[slot::n_slots])) for slot in range(n_slots))
    if kept < FEWEST_CHIRPS or n_samples < FEWEST_SAMPLES:
        return None
    numbers, inverse = samples.view(np.float32), np.float32(1 / scale)
    usable = np.flatnonzero(~lost)
    still = standing(numbers, usable, n_slots, inverse)
    power, _ = _powers(numbers, still, inverse)
    quiet = _quieter(power.sum(axis=1), usable, n_slots)
    # The median has told which chirps to trust; their mean is smooth, as the median is not.
    still = standing(numbers, quiet, n_slots, inverse, groups=1)
    power, mean_power = _powers(numbers, still, inverse)
    whole = mean_power[~lost].mean(axis=0)
    weight = np.zeros(n_rx, np.float32)
    typical = np.median(power[quiet], axis=0)
    alive = typical > np.maximum(ROUNDING * whole, _FAINTEST)
    weight[alive] = 1 / typical[alive]
    taps = np.zeros(0)
    if alive.any():
        of_rx = np.flatnonzero(alive)
        taps = _predictor(samples, still.view(samples.dtype), quiet, of_rx, inverse)
    rounding = ROUNDING * float(np.sum(weight * whole))
    return Quiet(chirps=quiet, still=still, weight=weight, rounding=rounding, taps=taps)


def standing(
    numbers: np.ndarray,
    chirps: np.ndarray,
    n_slots: int,
    inverse: np.float32,
    *,
    groups: int = _GROUPS,
) -> np.ndarray:
    """What stands still, (slot, rx, number): the median of the means of groups of chirps.

    A mean of all would carry a burst of 60 dB in one of 128 chirps into the others, 18 dB
    over the noise.
    """
    out = np.empty((n_slots, *numbers.shape[1:]), np.float32)
    for slot in range(n_slots):
        own = chirps[chirps % n_slots == slot]
        parts = np.array_split(own, max(1, min(groups, own.size)))  # zeros of a slot without any
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


def _quieter(power: np.ndarray, usable: np.ndarray, n_slots: int) -> np.ndarray:
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
    # Rounding has -144 dB: weights that fit it would be huge. Of nothing but zeros, all are 0.
    before = before + (1e-12 * np.trace(before).real + 1e-300) * np.eye(order)
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


# Without "not a number", which never comes here, eight samples go at once.
@numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nnan", "nsz"}
)
def whiten(parts: np.ndarray, taps: np.ndarray, n_parts: int, white: np.ndarray) -> None:
    """What the samples before do not predict, to white (part, sample): a pass for each weight."""
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
