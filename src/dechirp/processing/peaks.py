"""Peaks of a map: cells over threshold that no neighbour exceeds and no sidelobe explains."""

from functools import lru_cache

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.spectrum import Transform

# Maps with more peaks do not show targets: at a false-alarm probability of 1e-6 a map of 281,600
# cells of noise has 0.3. The strongest peaks are kept.
MAX_PEAKS = 2000
# Largest rounding error of single precision in a map, relative to the amplitude of a peak: a tone
# without noise left 1e-7 in its own row and column, and 1e-8 elsewhere.
ROUNDING = np.float32(2e-7)


def find_peaks(power: np.ndarray, threshold: np.ndarray, noise: MapNoise) -> np.ndarray:
    """Find the peaks of a map, (n, 2) indices of velocity and range, strongest first.

    A peak exceeds its threshold and its eight neighbours (velocity wraps round), and is no
    sidelobe of a stronger one: `strongest_local_maxima_and_n_dropped`, then `reject_sidelobes`.
    """
    cells, _ = strongest_local_maxima_and_n_dropped(power, power > threshold)
    return reject_sidelobes(power, cells, threshold[cells[:, 0], cells[:, 1]], noise)


def strongest_local_maxima_and_n_dropped(
    power: np.ndarray, mask: np.ndarray
) -> tuple[np.ndarray, int]:
    """Find the cells of a mask that no neighbour exceeds.

    Returns
    -------
    array (n, 2)
        Indices of velocity and range, strongest first, 2,000 at most.
    int
        Number of weaker cells that are dropped.
    """
    cells = find_local_maxima(power, mask)
    order = np.argsort(-power[cells[:, 0], cells[:, 1]], kind="stable")[:MAX_PEAKS]
    return np.asarray(cells[order]), len(cells) - len(order)


def reject_sidelobes(
    power: np.ndarray, cells: np.ndarray, threshold: np.ndarray, noise: MapNoise
) -> np.ndarray:
    """Keep the cells, strongest first, that no sidelobe of a stronger one explains, (n, 2).

    The amplitude of a weaker peak, less the window's sidelobe of each stronger one, must exceed
    the amplitude of its threshold, (n,). The rounding error of the stronger peak, 134 dB below
    it, counts as a sidelobe: otherwise an echo without any noise would be a hundred detections.
    Real samples, whose maps contain half the bins, have the mirror image of each echo at the
    negative beat and Doppler frequencies: so its sidelobes count too.
    """
    if len(cells) < 2:
        return cells
    keep = _mask_of_peaks_above_sidelobes(
        cells,
        np.sqrt(power[cells[:, 0], cells[:, 1]]),
        np.sqrt(threshold),
        sidelobe_envelope(noise.doppler_transform),
        sidelobe_envelope(noise.range_transform),
        noise.doppler_transform.n_bins,
        noise.range_transform.n_bins,
        power.shape[1] < noise.range_transform.n_bins,
    )
    return np.asarray(cells[keep])


def image_levels(power: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the power of cells relative to that of the mirrored cells, (n,).

    An I/Q mixer of unequal branches turns samples z into z + b conj(z), |b| < 1: each echo of a
    complex map has an image of |b|^2 of its power at the negative beat and Doppler frequencies.
    """
    n_velocity, n_range = power.shape
    velocity, row = cells.T
    mirrored = (2 * (n_velocity // 2) - velocity) % n_velocity, -row % n_range
    return np.asarray(power[velocity, row] / np.maximum(power[mirrored], 1e-300))


@lru_cache(maxsize=32)
def sidelobe_envelope(transform: Transform) -> np.ndarray:
    """Return the highest sidelobe amplitude at a distance of k bins or more from a peak.

    (n_bins // 2 + 1,), relative to the peak's cell: for a tone anywhere within half a bin of its
    cell, which is up to 3.9 dB under the true peak; non-increasing, 1 up to the neighbour cell.
    """
    fine = 8
    weights, n_bins = transform.weights, transform.n_bins
    response = abs(np.fft.rfft(weights, fine * n_bins)) / np.sum(weights)
    offsets = np.arange(-fine // 2, fine // 2 + 1)
    bins = np.arange(n_bins // 2 + 1)
    distances = abs(bins[:, None] * fine - offsets)
    distances = np.minimum(distances, fine * n_bins - distances)
    highest = (response[distances] / response[abs(offsets)]).max(axis=1)
    return np.minimum(np.maximum.accumulate(highest[::-1])[::-1], 1.0)


def _find_local_maxima_in_numpy(power: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Plain twin of `find_local_maxima`: equal cells."""
    cells = np.argwhere(mask)
    n_v, n_r = power.shape
    velocity, row = cells.T
    levels = power[velocity, row]
    is_peak = np.ones(len(cells), bool)
    for dv in range(-1, 2) if n_v > 1 else (0,):
        for dr in (-1, 1) if dv == 0 else (-1, 0, 1):
            is_inside = (row + dr >= 0) & (row + dr < n_r)
            others = power[(velocity + dv) % n_v, np.clip(row + dr, 0, n_r - 1)]
            if dv == 0:
                is_before = np.full(len(cells), dr < 0)
            else:
                is_before = (dv < 0) & ((n_v > 2) | (velocity > 0))
            is_peak &= ~(is_inside & ((others > levels) | (is_before & (others == levels))))
    return cells[is_peak]


@kernel(plain=_find_local_maxima_in_numpy)
def find_local_maxima(power: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the cells of a mask (velocity, range) that no neighbour exceeds, (n, 2)."""
    n_v, n_r = power.shape
    cells = [(v, 0) for v in range(0)]  # empty, typed for the compiler
    for v in range(n_v):
        for start in range(0, n_r, 64):
            marks = mask[v, start : start + 64]
            # Few cells are over threshold: most blocks of 64 cells are skipped at once.
            n_over = np.int32(0)
            for i in range(marks.size):
                n_over += np.int32(marks[i])
            if n_over:
                for i in range(marks.size):
                    if marks[i] and _is_local_maximum(power, v, start + i):
                        cells.append((v, start + i))
    indices = np.empty((len(cells), 2), np.int64)
    for i, cell in enumerate(cells):
        indices[i, 0], indices[i, 1] = cell
    return indices


@kernel()
def _is_local_maximum(power: np.ndarray, velocity_row: int, range_row: int) -> bool:
    n_v, n_r = power.shape
    for dv in range(-1, 2):
        for dj in range(-1, 2):
            if (dv == 0 and dj == 0) or not 0 <= range_row + dj < n_r:
                continue
            if dv != 0 and n_v == 1:
                continue  # the wrapped neighbour is the cell itself
            other = power[(velocity_row + dv) % n_v, range_row + dj]
            # Of equal neighbours the first counts, so that a plateau is one peak. Of two rows
            # each lies on both sides of the other: the upper one counts.
            is_before = (dv < 0 and (n_v > 2 or velocity_row > 0)) or (dv == 0 and dj < 0)
            if other > power[velocity_row, range_row] or (
                is_before and other == power[velocity_row, range_row]
            ):
                return False
    return True


def _mask_of_peaks_above_sidelobes_in_numpy(
    cells: np.ndarray,
    amplitude: np.ndarray,
    threshold: np.ndarray,
    velocity_envelope: np.ndarray,
    range_envelope: np.ndarray,
    n_velocity_bins: int,
    n_range_bins: int,
    has_images: bool,
) -> np.ndarray:
    """Plain twin of `_mask_of_peaks_above_sidelobes`: equal apart from rounding."""
    keep = np.ones(len(cells), bool)
    images = (2 * (n_velocity_bins // 2), 0) - cells
    for i in range(1, len(cells)):
        for sources in (cells, images) if has_images else (cells,):
            dv, dr = abs(sources[:i] - cells[i]).T
            dv, dr = np.minimum(dv, n_velocity_bins - dv), np.minimum(dr, n_range_bins - dr)
            lobes = amplitude[:i] * (velocity_envelope[dv] * range_envelope[dr] + ROUNDING)
            keep[i] &= not np.any(keep[:i] & (amplitude[i] < lobes + threshold[i]))
    return keep


@kernel(plain=_mask_of_peaks_above_sidelobes_in_numpy)
def _mask_of_peaks_above_sidelobes(
    cells: np.ndarray,
    amplitude: np.ndarray,
    threshold: np.ndarray,
    velocity_envelope: np.ndarray,
    range_envelope: np.ndarray,
    n_velocity_bins: int,
    n_range_bins: int,
    has_images: bool,
) -> np.ndarray:
    n = len(cells)
    keep = np.ones(n, np.bool_)
    for i in range(1, n):
        for k in range(i):
            if not keep[k]:
                continue
            dv = abs(cells[i, 0] - cells[k, 0])
            dr = abs(cells[i, 1] - cells[k, 1])
            # Sidelobes wrap round both axes of a transform.
            dv, dr = min(dv, n_velocity_bins - dv), min(dr, n_range_bins - dr)
            level = velocity_envelope[dv] * range_envelope[dr]
            if has_images:
                dv = abs(cells[i, 0] + cells[k, 0] - 2 * (n_velocity_bins // 2))
                dr = cells[i, 1] + cells[k, 1]
                dv, dr = min(dv, n_velocity_bins - dv), min(dr, n_range_bins - dr)
                level = max(level, velocity_envelope[dv] * range_envelope[dr])
            lobe = amplitude[k] * (level + ROUNDING)
            if amplitude[i] < lobe + threshold[i]:
                keep[i] = False
                break
    return keep
