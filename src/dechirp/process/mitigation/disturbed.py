"""Which samples of a frame are in bursts of interference.

Chirps that have bursts are those that the health of a recording counts, by its law: the share of
a chirp's energy in a stretch of it exceeds what white noise reaches once in 1e12 chirps. In such a
chirp a burst is where the power over twice that of noise adds up to more than noise makes likely;
its ends are where it falls to that. Of noise, sums of e - 2, e exponential of mean 1, exceed x
from some sample on with a chance below exp(-0.797 x) (Lundberg's bound of an insurer's ruin).
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dechirp.process.health.bursts import bursts_beside
from dechirp.process.health.quiet import Quiet, quiet_half
from dechirp.process.health.survey import SILENT, survey
from dechirp.process.mitigation.base import lost_chirps
from dechirp.radar.frame import Frame

# Of a chirp, and a little more, so that the power of two below it is half of 240 samples as well.
_LONGEST = 0.55
_CHANCE = 1e-6  # of a stretch that is none in a chirp that has one
_OVER_NOISE = 2.0
_STRONG = 10.0  # over noise: 64 chirps with stronger ones would have some in their mean
# Of exponential powers exp(-2 t) / (1 - t) = 1; of squares of real numbers half of that t.
_DECAY = {2: 0.7968, 1: 0.3984}
_MEDIAN = {2: 0.693, 1: 0.455}  # of such powers, over their mean
_QUARTER = {2: 0.288, 1: 0.102}  # that of which a quarter is below
_APART = 20.0  # samples of noise, about, between two bursts: fewer are taken for one
_MORE = 2  # samples on each side, for the skirts of a burst
_MEASURED = 32  # chirps, whose median power is that of the noise
_LEAST_KEPT = 0.25  # of the chirps, undisturbed: the mean over fewer is noisy


@dataclass(frozen=True)
class Disturbed:
    """A frame with bursts."""

    is_burst: np.ndarray
    """(chirp, sample), bool, of all receivers alike."""
    still: np.ndarray
    """(slot, rx, sample), what stands still, in the unit of the samples."""
    taps: np.ndarray
    """(order,), weights of the samples before that predict what moves, the nearest first."""


def disturbed(samples: np.ndarray, frame: Frame) -> Disturbed | None:
    """Look for bursts in one frame, (chirp, rx, sample) complex64 or float32; None without any.

    Frames of fewer than four chirps of each transmitter, or of 16 samples, have none that could
    be told.
    """
    lost, n_parts = lost_chirps(samples), 2 if np.iscomplexobj(samples) else 1
    surveyed = survey(samples.view(np.float32), lost, n_parts)
    scale = surveyed.largest
    if scale < SILENT:
        return None
    unit = samples * np.float32(1 / scale)
    step = surveyed.step / scale
    quiet = quiet_half(unit, lost, n_slots=frame.n_slots, scale=1.0)
    if quiet is None or not quiet.weight.any():
        return None
    strong = _bursts(unit, lost, quiet, step, over_noise=_STRONG)
    if strong.any():
        # The quieter half has some of them as well: look again without those.
        filled, still = unit.copy(), quiet.still.view(unit.dtype)
        for chirp in np.flatnonzero(strong.any(axis=1)):
            filled[chirp, :, strong[chirp]] = still[chirp % len(still), :, strong[chirp]]
        quiet = quiet_half(filled, lost, n_slots=frame.n_slots, scale=1.0) or quiet
    is_burst = _bursts(unit, lost, quiet, step, over_noise=_OVER_NOISE)
    if not is_burst.any():
        return None
    still = np.float32(scale) * _undisturbed(unit, is_burst, lost, quiet.still)
    return Disturbed(is_burst=is_burst, still=still, taps=quiet.taps)


def _bursts(
    samples: np.ndarray, lost: np.ndarray, quiet: Quiet, step: float, *, over_noise: float
) -> np.ndarray:
    """Samples in bursts, (chirp, sample), where the power exceeds that of noise so many times."""
    told = bursts_beside(quiet, samples, lost, scale=1.0, step=step, longest=_LONGEST)
    n_parts = 2 if np.iscomplexobj(samples) else 1
    alive = np.flatnonzero(quiet.weight)
    still = quiet.still.view(samples.dtype)[:, alive]

    def unpredicted(chirp: int) -> np.ndarray:
        return _unpredicted(samples[chirp, alive] - still[chirp % len(still)], quiet.taps)

    # Medians leave bursts be, as long as those are in less than half of the quieter chirps.
    some = quiet.chirps[:: -(-quiet.chirps.size // _MEASURED)]
    noise = np.median([np.median(unpredicted(chirp), axis=1) for chirp in some], axis=0)
    # A step of the converter is the least that noise is taken for.
    least = np.maximum(n_parts / 2 * step**2, quiet.rounding / quiet.weight[alive])
    least = np.maximum(least, noise / _MEDIAN[n_parts])
    limit = np.log(samples.shape[2] / _CHANCE) / _DECAY[n_parts]
    found = np.zeros((len(samples), samples.shape[2]), bool)
    for chirp in np.flatnonzero(told.excess > 1).tolist():
        power = unpredicted(chirp)
        # Noise may differ from chirp to chirp; a burst leaves a quarter of one to measure it.
        noise = np.maximum(np.quantile(power, 0.25, axis=1) / _QUARTER[n_parts], least)
        energy = np.mean(power / noise[:, None], axis=0)
        _mark(energy - over_noise, limit, found[chirp])
    return found


def _unpredicted(moving: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """Power of what neither the samples before nor those behind predict, (rx, sample).

    The smaller of both: a burst spoils the prediction of what comes after it in either direction.
    """
    runs = sliding_window_view(moving, taps.size + 1, axis=1)
    after, before = np.full((2, *moving.shape), np.inf)
    after[:, taps.size :] = np.abs(runs @ np.r_[-taps[::-1], 1]) ** 2
    before[:, : runs.shape[1]] = np.abs(runs @ np.r_[1, -taps.conj()]) ** 2
    return np.minimum(after, before)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mark(excess: np.ndarray, limit: float, is_burst: np.ndarray) -> None:
    """Mark stretches whose sums exceed a limit, each as long as its sum still grows."""
    n = 0
    while n < excess.size:
        start, last, total, most = n, -1, 0.0, 0.0
        while n < excess.size:
            total += excess[n]
            if total > most:
                most, last = total, n
            if total <= max(0.0, most - _APART):
                break
            n += 1
        if most > limit:
            is_burst[max(start - _MORE, 0) : last + 1 + _MORE] = True
        # What comes after the sum was largest may be the start of another.
        n = max(last, start) + 1


def _undisturbed(
    samples: np.ndarray, is_burst: np.ndarray, lost: np.ndarray, still: np.ndarray
) -> np.ndarray:
    """Mean over the undisturbed chirps of each slot, (slot, rx, sample); what is given for few."""
    out = still.view(samples.dtype).copy()
    n_slots = len(out)
    good = ~is_burst & ~lost[:, None]
    for slot in range(n_slots):
        total = np.zeros(samples.shape[1:], np.result_type(samples.dtype, np.float64))
        for chirp in range(slot, len(samples), n_slots):
            total += samples[chirp] * good[chirp]
        n_good = good[slot::n_slots].sum(axis=0)
        enough = n_good >= max(1, _LEAST_KEPT * np.count_nonzero(~lost[slot::n_slots]))
        out[slot, :, enough] = (total[:, enough] / n_good[enough]).T
    return out
