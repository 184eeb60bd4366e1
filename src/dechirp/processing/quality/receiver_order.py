"""Receiver order on a line, checked against the phases of echoes.

An echo reaches equally spaced receivers with equal phase steps. One beam therefore contains all
of it: its gain, |a^H x|^2 / (N |x|^2), is 1 in the right order and less in others. Not detected
are the reversed order, which mirrors angles and fits equally well; a swap that changes little, as
for echoes within some 15 degrees of one another; and any error where no order fits, because of
receiver phases or several echoes in a cell: indoors the right order often has a mean gain of only
0.8.
"""

from itertools import combinations, permutations

import numpy as np
import scipy

from dechirp.core.values import frozen_dataclass
from dechirp.processing.quality.beat_spectrum import NEAR_BINS, MeanSpectrum
from dechirp.radar.array import Array
from dechirp.theory.windows import window_weights

N_CELLS = 16
"""Number of strongest cells of a frame that are kept."""
_MIN_RECEIVERS = 4  # any order of three fits nearly every echo
_MIN_CHIRPS = 8  # fewer do not separate echoes from noise in velocity
_MAX_CHIRPS = 256  # more would only take time
_MIN_SNR = 100.0  # 20 dB over noise, which changes no gain by more than 1 %
_MIN_DIRECTIONS = 5  # directions
_SAME_DIRECTION_GAIN = 0.95  # beam gain 5 degrees off for four receivers
_FITTING_GAIN = 0.95
"""Gain that separates orders: the right one exceeds it, even with phase errors of 10 degrees; the
given one must be below it to be doubted. Two of four exchanged in the middle have 0.88."""
_MAX_LOSS_RATIO = 0.2  # loss of a better order over that of the given one
_MAX_CELLS = 200


def find_receiver_order_on_line(array: Array) -> np.ndarray | None:
    """Return the receivers in their order along a uniform line, (rx,); None if there is none."""
    positions = np.array(array.rx_m)
    if len(positions) < _MIN_RECEIVERS:
        return None
    from_middle = positions - positions.mean(axis=0)
    _, _, axes = np.linalg.svd(from_middle, full_matrices=False)
    positions_on_line = from_middle @ axes[0]
    order = np.argsort(positions_on_line)
    spacing = np.diff(positions_on_line[order])
    distance_from_line = np.linalg.norm(from_middle - positions_on_line[:, None] * axes[0], axis=1)
    is_even = np.all(np.abs(spacing - spacing.mean()) <= 0.05 * spacing.mean())
    if spacing.mean() <= 0 or not is_even or np.any(distance_from_line > 0.05 * spacing.mean()):
        return None
    return order


def strongest_echo_snapshots_and_snr(
    samples: np.ndarray,
    is_lost: np.ndarray,
    spectrum: MeanSpectrum,
    *,
    n_slots: int,
    largest_value: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the receiver snapshots of the strongest echoes, of the chirps of one transmitter.

    Returns
    -------
    snapshots : array (cell, rx), complex64
        Of unit energy in each cell; zero where there are fewer echoes.
    snr : array (cell,), float32
        Descending; zero where there are fewer.
    """
    n_rx, n_samples = samples.shape[1:]
    snapshots, snr = np.zeros((N_CELLS, n_rx), np.complex64), np.zeros(N_CELLS, np.float32)
    chirps = np.flatnonzero(~is_lost[::n_slots]) * n_slots
    # Lost chirps spread echoes in Doppler: the longest gapless part is used.
    parts = np.split(chirps, np.flatnonzero(np.diff(chirps) > n_slots) + 1)
    chirps = max(parts, key=len)[:_MAX_CHIRPS]
    bins = _strongest_beat_bins(spectrum)
    if chirps.size < _MIN_CHIRPS or not bins.size:
        return snapshots, snr
    range_taper = (window_weights("hann", n_samples) / largest_value).astype(np.float32)
    doppler_taper = window_weights("hann", chirps.size)[:, None].astype(np.float32)
    cells = np.empty((chirps.size, n_rx, bins.size), np.complex64)
    for k in range(n_rx):
        rows = samples[chirps[0] : chirps[-1] + 1 : n_slots, k] * range_taper
        cells[:, k] = scipy.fft.fft(scipy.fft.fft(rows, axis=1)[:, bins] * doppler_taper, axis=0)
    power = np.sum(np.abs(cells) ** 2, axis=1)
    noise = np.maximum(np.median(power, axis=0), power.max() * 1e-12)
    is_peak = (power >= np.roll(power, 1, axis=0)) & (power > np.roll(power, -1, axis=0))
    ratio = np.where(is_peak & (power > 0), power / np.maximum(noise, 1e-300), 0.0)
    best = np.argsort(ratio, axis=None)[::-1][:N_CELLS]
    velocity, column = np.unravel_index(best, ratio.shape)
    is_strong = ratio[velocity, column] > _MIN_SNR
    peak_cells = cells[velocity[is_strong], :, column[is_strong]]
    snapshots[: len(peak_cells)] = peak_cells / np.linalg.norm(peak_cells, axis=1, keepdims=True)
    snr[: len(peak_cells)] = ratio[velocity[is_strong], column[is_strong]]
    return snapshots, snr


def _strongest_beat_bins(spectrum: MeanSpectrum) -> np.ndarray:
    """Return the strongest beat frequencies that exceed both neighbours."""
    power = spectrum.power.sum(axis=0)
    is_peak = (power >= np.roll(power, 1)) & (power > np.roll(power, -1))
    bins = np.arange(power.size)
    # The leakage about 0 is no plane wave.
    is_peak &= np.minimum(bins, spectrum.n_samples - bins) >= NEAR_BINS
    bins = bins[is_peak]
    return bins[np.argsort(power[bins])[::-1][:N_CELLS]]


@frozen_dataclass
class BetterOrder:
    """Order of receivers that fits the echoes where the given one does not."""

    order: tuple[int, ...]
    """Receivers in their order along the line, by their numbers in the recording."""
    gain: float
    """Mean gain over cells."""
    given_gain: float
    n_cells: int


def find_better_receiver_order(
    cells: np.ndarray, snr: np.ndarray, line_order: np.ndarray
) -> BetterOrder | None:
    """Return an order that clearly fits cells (cell, rx) better; None if there is none.

    All orders of up to 6 receivers are tried; of more, those with two exchanged.

    Notes
    -----
    The result is None for fewer than 5 directions, or if the given order has a mean gain of 0.95:
    single echoes 20 dB over noise have 0.99 in the right order of a calibrated array. The other
    order must have 0.95 in 4 of 5 cells, and a fifth of the loss of the given one. Wrong receiver
    phases cannot cause this: they are equal for all directions, while those of a wrong order grow
    with the angle to either side.
    """
    distinct_cells = _cells_of_distinct_directions(cells, snr)
    if len(distinct_cells) < _MIN_DIRECTIONS:
        return None
    line_cells = distinct_cells[:, line_order]
    given_gain = _largest_beam_gain_per_cell(line_cells)
    if given_gain.mean() > _FITTING_GAIN:
        return None
    orders = _candidate_receiver_orders(len(line_order))
    gains = np.array([_largest_beam_gain_per_cell(line_cells[:, order]) for order in orders])
    is_better = np.mean((gains > _FITTING_GAIN) & (gains > given_gain), axis=1) >= 0.8
    is_better &= 1 - gains.mean(axis=1) < _MAX_LOSS_RATIO * (1 - given_gain.mean())
    if not is_better.any():
        return None
    best = int(np.argmax(np.where(is_better, gains.mean(axis=1), 0.0)))
    return BetterOrder(
        order=tuple(int(rx) for rx in line_order[orders[best]]),
        gain=float(gains[best].mean()),
        given_gain=float(given_gain.mean()),
        n_cells=len(distinct_cells),
    )


def _cells_of_distinct_directions(cells: np.ndarray, snr: np.ndarray) -> np.ndarray:
    """Return strong cells with distinct directions, the strongest first."""
    strongest = np.argsort(snr)[::-1]
    distinct: list[np.ndarray] = []
    for cell in strongest[snr[strongest] > _MIN_SNR][:_MAX_CELLS]:
        x = cells[cell]
        if all(abs(np.vdot(other, x)) ** 2 < _SAME_DIRECTION_GAIN for other in distinct):
            distinct.append(x)
    return np.array(distinct)


def _largest_beam_gain_per_cell(cells: np.ndarray) -> np.ndarray:
    """Return the largest beam gain, (cell,), of cells (cell, rx) of unit energy."""
    n_rx = cells.shape[1]
    # 16 beams to a beamwidth: the nearest loses 0.3 % at most.
    beams = scipy.fft.fft(cells, 16 * n_rx, axis=1)
    return np.max(np.abs(beams) ** 2, axis=1) / n_rx


def _candidate_receiver_orders(n_rx: int) -> list[list[int]]:
    """Return all orders other than the given one, without reversed duplicates."""
    if n_rx <= 6:
        all_orders = (list(order) for order in permutations(range(n_rx)) if order[0] < order[-1])
        return [order for order in all_orders if order != list(range(n_rx))]
    orders = []
    for first, second in combinations(range(n_rx), 2):
        order = list(range(n_rx))
        order[first], order[second] = second, first
        orders.append(order)
    return orders
