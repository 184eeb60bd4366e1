"""Peaks: cells over threshold that no neighbour exceeds and no sidelobe explains."""

import warnings
from functools import lru_cache

import numba
import numpy as np

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.process.cfar.base import Noise
from dechirp.process.spectrum import Transform

# Beyond so many cells over threshold a map is no longer one of targets: at 1e-6 a map of
# 281,600 cells of noise has 0.3. The strongest are kept.
MOST_PEAKS = 2000
# What single precision leaves of the amplitude of a peak anywhere in a map, at most: a tone
# without noise left 1e-7 in its own row and column, and 1e-8 elsewhere.
ROUNDING = np.float32(2e-7)


def peaks(power: np.ndarray, threshold: np.ndarray, noise: Noise) -> np.ndarray:
    """Indices (velocity, range) of the peaks of a map, (n, 2), strongest first.

    A peak exceeds its threshold and its eight neighbours (velocity wraps round), and is no
    sidelobe of a stronger one: `highest`, then `clear_of_sidelobes`.
    """
    found = highest(power, power > threshold)
    return clear_of_sidelobes(power, found, threshold[found[:, 0], found[:, 1]], noise)


def highest(power: np.ndarray, over: np.ndarray) -> np.ndarray:
    """Cells of a mask that no neighbour exceeds, (n, 2), strongest first, 2,000 at most."""
    found = _local_maxima(power, over)
    order = np.argsort(-power[found[:, 0], found[:, 1]], kind="stable")[:MOST_PEAKS]
    if len(found) > MOST_PEAKS:
        finding = Finding(
            level="warning",
            setting="chain.cfar",
            got=f"{len(found)} peaks over threshold; the strongest {MOST_PEAKS} are kept",
            need=f"at most {MOST_PEAKS} in a frame",
            fix="Lower the false-alarm probability.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=6)
    return np.asarray(found[order])


def clear_of_sidelobes(
    power: np.ndarray, found: np.ndarray, threshold: np.ndarray, noise: Noise
) -> np.ndarray:
    """Those of the cells found, strongest first, that no sidelobe explains, (n, 2).

    A weaker one must stand out from the window's sidelobes of each stronger one by as much as
    from the noise: its amplitude less theirs exceeds that of its threshold, (n,). So must it from
    what rounding leaves of the stronger one, 134 dB below it: an echo without any noise would
    else be a hundred detections.
    """
    if len(found) < 2:
        return found
    keep = _outside_sidelobes(
        found,
        np.sqrt(power[found[:, 0], found[:, 1]]),
        np.sqrt(threshold),
        sidelobe_amplitude(noise.over_velocity),
        sidelobe_amplitude(noise.over_range),
        noise.over_velocity.n_bins,
        noise.over_range.n_bins,
    )
    return np.asarray(found[keep])


@lru_cache(maxsize=32)
def sidelobe_amplitude(transform: Transform) -> np.ndarray:
    """Highest amplitude so many bins or more from a peak, relative to the peak's cell.

    (n_bins // 2 + 1,): for a tone anywhere within half a bin of its cell, which is up to
    3.9 dB under the true peak; never rising, 1 up to the cell beside the peak.
    """
    fine = 8
    weights, n_bins = transform.weights, transform.n_bins
    response = abs(np.fft.rfft(weights, fine * n_bins)) / np.sum(weights)
    offsets = np.arange(-fine // 2, fine // 2 + 1)
    bins = np.arange(n_bins // 2 + 1)
    at = abs(bins[:, None] * fine - offsets)
    at = np.minimum(at, fine * n_bins - at)
    highest = (response[at] / response[abs(offsets)]).max(axis=1)
    return np.minimum(np.maximum.accumulate(highest[::-1])[::-1], 1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _local_maxima(power: np.ndarray, over: np.ndarray) -> np.ndarray:
    n_v, n_r = power.shape
    found = [(v, 0) for v in range(0)]  # empty, typed for the compiler
    for v in range(n_v):
        for start in range(0, n_r, 64):
            marks = over[v, start : start + 64]
            # Few cells are over threshold: most blocks are passed many cells at a time.
            n_over = np.int32(0)
            for i in range(marks.size):
                n_over += np.int32(marks[i])
            if n_over:
                for i in range(marks.size):
                    if marks[i] and _is_highest(power, v, start + i):
                        found.append((v, start + i))
    indices = np.empty((len(found), 2), np.int64)
    for i, cell in enumerate(found):
        indices[i, 0], indices[i, 1] = cell
    return indices


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _is_highest(power: np.ndarray, v: int, j: int) -> bool:
    n_v, n_r = power.shape
    for dv in range(-1, 2):
        for dj in range(-1, 2):
            if (dv == 0 and dj == 0) or not 0 <= j + dj < n_r:
                continue
            if dv != 0 and n_v == 1:
                continue  # round the end is the cell itself
            other = power[(v + dv) % n_v, j + dj]
            # Of equal neighbours the first counts, so that a plateau is one peak. Of two rows
            # each lies on both sides of the other: the upper one counts.
            first = (dv < 0 and (n_v > 2 or v > 0)) or (dv == 0 and dj < 0)
            if other > power[v, j] or (first and other == power[v, j]):
                return False
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _outside_sidelobes(
    found: np.ndarray,
    amplitude: np.ndarray,
    threshold: np.ndarray,
    over_velocity: np.ndarray,
    over_range: np.ndarray,
    n_velocity_bins: int,
    n_range_bins: int,
) -> np.ndarray:
    n = len(found)
    keep = np.ones(n, np.bool_)
    for i in range(1, n):
        for k in range(i):
            if not keep[k]:
                continue
            dv = abs(found[i, 0] - found[k, 0])
            dr = abs(found[i, 1] - found[k, 1])
            # Sidelobes wrap round both axes of a transform.
            dv, dr = min(dv, n_velocity_bins - dv), min(dr, n_range_bins - dr)
            lobe = amplitude[k] * (over_velocity[dv] * over_range[dr] + ROUNDING)
            if amplitude[i] < lobe + threshold[i]:
                keep[i] = False
                break
    return keep
