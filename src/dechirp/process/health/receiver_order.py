"""Receivers on a line in another order than the settings say, told by their echoes.

An echo reaches receivers at equal distances with equal phase steps. So one beam holds all of
it: its gain, |a^H x|^2 / (N |x|^2), is 1 in the right order and less in others. Not seen are
the reversed order, which mirrors angles and is as good; receivers whose exchange changes
little, as for echoes within some 15 degrees of one another; and anything where no order fits,
since phases of the receivers are wrong, or echoes share cells: indoors the right order often
has a mean gain of 0.8 only.
"""

from itertools import combinations, permutations

import numpy as np
import scipy.fft

from dechirp.core.values import value
from dechirp.process.health.beats import NEAR_BINS, Spectrum
from dechirp.radar.array import Array
from dechirp.theory.windows import taper

N_CELLS = 16
"""Cells of a frame that are kept, the strongest."""
_RECEIVERS = 4  # the fewest: any order of three fits nearly every echo
_CHIRPS = 8  # the fewest that part echoes from noise in velocity
_CHIRPS_USED = 256  # the most: more would only take time
_STRONG = 100.0  # 20 dB over noise: it turns no gain by more than 1 %
_DIFFERENT = 5  # directions
_SAME_DIRECTION = 0.95  # gain of a beam at another direction, 5 degrees off for four receivers
_FITS = 0.95
"""Gain that tells orders apart: the right one has more, even if phases are 10 degrees off; the
given one must have less to be doubted. Two of four exchanged in the middle have 0.88."""
_BETTER = 0.2  # what a better order may leave beside the beam, over what the given one leaves
_MOST_CELLS = 200


def line(array: Array) -> np.ndarray | None:
    """Receivers in their order along a line of equal spacing, (rx,); None if there is none."""
    positions = np.array(array.rx_m)
    if len(positions) < _RECEIVERS:
        return None
    from_middle = positions - positions.mean(axis=0)
    _, _, axes = np.linalg.svd(from_middle, full_matrices=False)
    along = from_middle @ axes[0]
    order = np.argsort(along)
    spacing = np.diff(along[order])
    beside = np.linalg.norm(from_middle - along[:, None] * axes[0], axis=1)
    even = np.all(np.abs(spacing - spacing.mean()) <= 0.05 * spacing.mean())
    if spacing.mean() <= 0 or not even or np.any(beside > 0.05 * spacing.mean()):
        return None
    return order


def strongest_cells(
    samples: np.ndarray, lost: np.ndarray, spectrum: Spectrum, *, n_slots: int, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """What each receiver sees of the strongest echoes, of the chirps of one transmitter.

    Returns
    -------
    seen : array (cell, rx), complex64
        Of unit energy in each cell; zero where there are fewer echoes.
    snr : array (cell,), float32
        Descending; zero where there are fewer.
    """
    n_rx, n_samples = samples.shape[1:]
    seen, snr = np.zeros((N_CELLS, n_rx), np.complex64), np.zeros(N_CELLS, np.float32)
    chosen = np.flatnonzero(~lost[::n_slots]) * n_slots
    # Lost chirps leave holes in slow time, which spread echoes: the longest whole part is used.
    parts = np.split(chosen, np.flatnonzero(np.diff(chosen) > n_slots) + 1)
    chosen = max(parts, key=len)[:_CHIRPS_USED]
    bins = _peaks(spectrum)
    if chosen.size < _CHIRPS or not bins.size:
        return seen, snr
    fast = (taper("hann", n_samples) / scale).astype(np.float32)
    slow = taper("hann", chosen.size)[:, None].astype(np.float32)
    cells = np.empty((chosen.size, n_rx, bins.size), np.complex64)
    for k in range(n_rx):
        rows = samples[chosen[0] : chosen[-1] + 1 : n_slots, k] * fast
        cells[:, k] = scipy.fft.fft(scipy.fft.fft(rows, axis=1)[:, bins] * slow, axis=0)
    power = np.sum(np.abs(cells) ** 2, axis=1)
    noise = np.maximum(np.median(power, axis=0), power.max() * 1e-12)
    is_peak = (power >= np.roll(power, 1, axis=0)) & (power > np.roll(power, -1, axis=0))
    ratio = np.where(is_peak & (power > 0), power / np.maximum(noise, 1e-300), 0.0)
    best = np.argsort(ratio, axis=None)[::-1][:N_CELLS]
    velocity, column = np.unravel_index(best, ratio.shape)
    found = ratio[velocity, column] > _STRONG
    of_cells = cells[velocity[found], :, column[found]]
    seen[: len(of_cells)] = of_cells / np.linalg.norm(of_cells, axis=1, keepdims=True)
    snr[: len(of_cells)] = ratio[velocity[found], column[found]]
    return seen, snr


def _peaks(spectrum: Spectrum) -> np.ndarray:
    """Beat frequencies that are higher than both neighbours, the strongest."""
    power = spectrum.power.sum(axis=0)
    is_peak = (power >= np.roll(power, 1)) & (power > np.roll(power, -1))
    bins = np.arange(power.size)
    # The leakage about 0 is no plane wave; mirrored bins of real samples are not there.
    is_peak &= np.minimum(bins, spectrum.n_samples - bins) >= NEAR_BINS
    bins = bins[is_peak]
    return bins[np.argsort(power[bins])[::-1][:N_CELLS]]


@value
class BetterOrder:
    """An order of receivers that fits the echoes where the given one does not."""

    order: tuple[int, ...]
    """Receivers as they lie along the line, by their numbers in the recording."""
    gain: float
    """Mean over cells."""
    given_gain: float
    n_cells: int


def better_order(seen: np.ndarray, snr: np.ndarray, line_order: np.ndarray) -> BetterOrder | None:
    """Another order that clearly fits better, of cells (cell, rx); None if there is none.

    All orders of up to 6 receivers are tried; of more, those with two exchanged.

    Notes
    -----
    Nothing is said on fewer than 5 directions, nor if the given order has a mean gain of 0.95:
    lone echoes 20 dB over noise have 0.99 in the right order of a calibrated array. The other
    order must have 0.95 in 4 of 5 cells, and leave a fifth of what the given one leaves beside
    the beam. Wrong phases of receivers cannot look like that: they are the same for all
    directions, while those of a wrong order grow with the angle to either side.
    """
    cells = _different(seen, snr)
    if len(cells) < _DIFFERENT:
        return None
    along = cells[:, line_order]
    given = _gain(along)
    if given.mean() > _FITS:
        return None
    orders = _orders(len(line_order))
    gains = np.array([_gain(along[:, order]) for order in orders])
    fits = np.mean((gains > _FITS) & (gains > given), axis=1) >= 0.8
    fits &= 1 - gains.mean(axis=1) < _BETTER * (1 - given.mean())
    if not fits.any():
        return None
    best = int(np.argmax(np.where(fits, gains.mean(axis=1), 0.0)))
    return BetterOrder(
        order=tuple(int(rx) for rx in line_order[orders[best]]),
        gain=float(gains[best].mean()),
        given_gain=float(given.mean()),
        n_cells=len(cells),
    )


def _different(seen: np.ndarray, snr: np.ndarray) -> np.ndarray:
    """Strong cells of which no two have the same direction, the strongest first."""
    strongest = np.argsort(snr)[::-1]
    chosen: list[np.ndarray] = []
    for cell in strongest[snr[strongest] > _STRONG][:_MOST_CELLS]:
        x = seen[cell]
        if all(abs(np.vdot(other, x)) ** 2 < _SAME_DIRECTION for other in chosen):
            chosen.append(x)
    return np.array(chosen)


def _gain(cells: np.ndarray) -> np.ndarray:
    """Largest gain of a beam, (cell,), of cells (cell, rx) of unit energy."""
    n_rx = cells.shape[1]
    # 16 beams to a beamwidth: the nearest loses 0.3 % at most.
    beams = scipy.fft.fft(cells, 16 * n_rx, axis=1)
    return np.max(np.abs(beams) ** 2, axis=1) / n_rx


def _orders(n_rx: int) -> list[list[int]]:
    """Orders other than the given one, each or its reverse."""
    if n_rx <= 6:
        every = (list(order) for order in permutations(range(n_rx)) if order[0] < order[-1])
        return [order for order in every if order != list(range(n_rx))]
    orders = []
    for first, second in combinations(range(n_rx), 2):
        order = list(range(n_rx))
        order[first], order[second] = second, first
        orders.append(order)
    return orders
