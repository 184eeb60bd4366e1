"""Chirps unlike their neighbours, as the first of a frame where a radar had not settled."""

import numba
import numpy as np
from scipy.ndimage import median_filter

from dechirp.process.health.quiet import ROUNDING

_FEWEST_CHANGES = 4  # of one transmitter: fewer have no median to speak of
_CHANGE = 20.0  # times the changes near a chirp, for it to be odd: 13 dB; noise gives 1 dB
_SCATTERS = 4.0
_LOCAL = 17  # changes whose median one is compared with: less than motion takes to begin


def unlike(
    samples: np.ndarray, lost: np.ndarray, *, n_slots: int, scale: float, step: float
) -> np.ndarray:
    """Power by which each chirp differs from both its neighbours, over a limit, (chirp,).

    Neighbours of the same transmitter. What moves changes by much the same from chirp to chirp
    all the time; a chirp of its own kind differs from both neighbours, and they from it alone.
    At the ends of a frame there is one. The limit is 20 times the median of changes near it,
    or exp(4 s) times if their logarithms scatter by s: of one echo that fluctuates from chirp
    to chirp, s is 1.2 and the chance to exceed 120 medians 1e-36. NaN where chirps are lost or
    too few, infinite of a chirp of zeros. Parameters are those of `bursts`.
    """
    out = np.full(len(samples), np.nan, np.float32)
    changes, power = _changes(samples.view(np.float32), lost, n_slots, np.float32(1 / scale))
    mean_power = float(power[~lost].mean()) if not lost.all() else 0.0
    # A step squared over 12 is the noise of rounding to steps.
    smallest = max(ROUNDING * mean_power, (step / scale) ** 2 / 12, 1e-300)
    for slot in range(n_slots):
        own = changes[slot::n_slots][:-1]
        known = np.isfinite(own)
        if np.count_nonzero(known) < _FEWEST_CHANGES:
            continue
        filled = np.where(known, own, np.median(own[known]))
        near = median_filter(filled, size=min(_LOCAL, filled.size), mode="mirror")
        ratio = np.maximum(own, smallest) / np.maximum(near, smallest)
        # A standard deviation by the median of absolute logarithms, which odd chirps leave be.
        scatter = 1.48 * float(np.median(np.abs(np.log(ratio[known]))))
        ratio /= max(_CHANGE, np.exp(min(_SCATTERS * scatter, 100.0)))
        both = np.minimum(ratio[:-1], ratio[1:])
        first = ratio[0] if ratio[1] < ratio[0] / 4 else 0.0
        last = ratio[-1] if ratio[-2] < ratio[-1] / 4 else 0.0
        out[slot::n_slots] = [first, *both, last]
    out[~lost & (power == 0) & (mean_power > 0)] = np.inf
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _changes(
    numbers: np.ndarray, lost: np.ndarray, n_slots: int, inverse: np.float32
) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares of the change to the transmitter's next chirp, and of each, (chirp,).

    A change is NaN if one of the two is lost, or if there is no next.
    """
    n_chirps, n_rx, n_numbers = numbers.shape
    changes, power = np.full(n_chirps, np.nan), np.zeros(n_chirps)
    for m in range(n_chirps):
        following = m + n_slots
        if following >= n_chirps or lost[following]:
            following = m
        for k in range(n_rx):
            change, every = np.float32(0), np.float32(0)
            for i in range(n_numbers):
                x = numbers[m, k, i] * inverse
                d = numbers[following, k, i] * inverse - x
                change += d * d
                every += x * x
            power[m] += every / (n_rx * n_numbers)
            if following > m and not lost[m]:
                changes[m] = (0.0 if k == 0 else changes[m]) + change / (n_rx * n_numbers)
    return changes, power
