"""Echoes as tones with series: what one pair of antennas sees of many scatterers in a run."""

from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.threads import in_threads, slices
from dechirp.echoes.kernels.base import Sent
from dechirp.echoes.kernels.economised import economised
from dechirp.echoes.kernels.series import (
    BLOCK,
    DOPPLER,
    IMAG,
    LANES,
    ORDER,
    RANGE,
    REAL,
    SERIES,
    WORK,
    View,
    expand,
    expand_block,
    shifts_of,
)

_compiled = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}
)

MOST_FIELDS = 6
"""Fields of a series at most; scatterers that need more are summed in another way."""

_STEPS = 128  # of errors, down to the 2^64th part of what is allowed


class Paths(NamedTuple):
    """Scatterers, laid out for vectors."""

    path_m: np.ndarray
    """(n_terms, 3, n)."""
    amplitudes: np.ndarray
    tx_gains: np.ndarray
    rx_gains: np.ndarray

    def some(self, chosen: np.ndarray | slice) -> "Paths":
        """Those that are chosen."""
        return Paths(*(np.ascontiguousarray(array[..., chosen]) for array in self))

    def middling(self, transmitters: list[int], receivers: list[int]) -> "Paths":
        """The same, as if each pair of antennas had the gains of some, root mean square."""
        tx, rx = self.tx_gains, self.rx_gains
        return self._replace(
            tx_gains=np.broadcast_to(np.sqrt(np.mean(tx[transmitters] ** 2, axis=0)), tx.shape),
            rx_gains=np.broadcast_to(np.sqrt(np.mean(rx[receivers] ** 2, axis=0)), rx.shape),
        )


class Waveform(NamedTuple):
    """A run of chirps as the transforms see it: about the middle of each sampling window."""

    mid_frequency_hz: float
    """At the sample in the middle of the window."""
    slope_hz_per_s: float
    sample_rate_hz: float
    n_samples: int
    times_s: np.ndarray
    """(n_chirps,): middles of the windows, on the clock of the paths."""

    @property
    def half_window_s(self) -> float:
        """From the middle of a window to its first sample; a step if there is one alone."""
        return max(self.n_samples // 2, 1) / self.sample_rate_hz


def view(
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    pair: tuple[int, int],
    mid_s: float,
    half_s: float,
    *,
    one_chirp: bool,
) -> View:
    """What a transmitter and a receiver see about `mid_s`, and over `half_s` to both sides."""
    tx, rx = pair
    return View(
        paths.path_m,
        paths.amplitudes * paths.tx_gains[tx] * paths.rx_gains[rx],
        np.ascontiguousarray(sent.tx_m[tx], float),
        np.ascontiguousarray(sent.rx_m[rx], float),
        float(mid_s),
        float(half_s),
        float(waveform.mid_frequency_hz),
        float(waveform.slope_hz_per_s),
        one_chirp,
    )


def tones(seen: View) -> np.ndarray:
    """Blocks as in `series`, (n_blocks, BLOCK)."""
    blocks = np.empty((-(-len(seen.amplitudes) // LANES), BLOCK))
    expand(seen, blocks)
    return blocks


class Survey(NamedTuple):
    """What the tones of many scatterers have in common."""

    low_hz: float
    """Lowest beat frequency."""
    high_hz: float
    fastest_hz: float
    """Largest Doppler frequency, without its sign."""
    power: float
    """Sum of the squares of the strengths."""
    errors: np.ndarray
    """(n,): power of what a series leaves out of each, at most."""


def survey(seen: View, n_fields: int, n_threads: int = 1) -> Survey:
    """Look at all tones, for series of so many fields."""
    errors = np.empty(len(seen.amplitudes))
    parts = slices(-(-len(errors) // LANES), n_threads)
    found = np.empty((len(parts), 4))
    left = ECONOMISED[n_fields - 1][1]

    def one(part: int) -> None:
        _survey(seen, left, parts[part].start, parts[part].stop, found[part], errors)

    in_threads(n_threads, one, range(len(parts)))
    low_hz, high_hz, fastest_hz = found[:, 0].min(), found[:, 1].max(), found[:, 2].max()
    return Survey(float(low_hz), float(high_hz), float(fastest_hz), found[:, 3].sum(), errors)


@_compiled
def _survey(
    seen: View, left: np.ndarray, first: int, stop: int, found: np.ndarray, errors: np.ndarray
) -> None:
    work, block, line = np.zeros(WORK), np.empty(BLOCK), np.empty(LANES)
    shifts = shifts_of(seen)
    low_hz, high_hz, fastest_hz, power = np.inf, -np.inf, 0.0, 0.0
    for b in range(first, stop):
        expand_block(seen, shifts, b * LANES, work, block)
        _errors(block, left, line)
        for i in range(LANES):
            low_hz, high_hz = min(low_hz, block[RANGE + i]), max(high_hz, block[RANGE + i])
            fastest_hz = max(fastest_hz, abs(block[DOPPLER + i]))
            power += block[REAL + i] ** 2 + block[IMAG + i] ** 2
        for i in range(min(LANES, len(errors) - b * LANES)):
            errors[b * LANES + i] = line[i]
    found[0], found[1], found[2], found[3] = low_hz, high_hz, fastest_hz, power


ECONOMISED = tuple(economised(n_fields, ORDER) for n_fields in range(1, MOST_FIELDS + 1))
"""How powers of s are kept in so many fields less one, and what is left out of each."""


def left_out(blocks: np.ndarray, n_fields: int, shorter: float = 1.0) -> np.ndarray:
    """Power of what so many fields leave out of each scatterer, at most, (n_blocks x LANES,).

    `shorter`: of a run by that factor shorter, about the same middle.
    """
    found = np.empty((len(blocks), LANES))
    _all_errors(blocks, ECONOMISED[n_fields - 1][1] * shorter ** np.arange(ORDER), found)
    return found.ravel()


def powers(blocks: np.ndarray) -> np.ndarray:
    """Power of each scatterer, (n_blocks, LANES)."""
    real, imag = blocks[:, REAL : REAL + LANES], blocks[:, IMAG : IMAG + LANES]
    return np.asarray(real * real + imag * imag)


def hardest(errors: np.ndarray, allowed: float) -> np.ndarray:
    """Which scatterers, few, must go so that the sum of the others' errors is allowed; a mask."""
    return np.asarray(~(errors <= _limit(errors, allowed)))


@_compiled
def _limit(errors: np.ndarray, allowed: float) -> float:
    """Limit up to which the errors add up to no more than is allowed: in steps of 1.4."""
    # Whatever is larger than all that is allowed goes, endless errors too.
    total = 0.0
    for i in range(len(errors)):
        if errors[i] <= allowed:
            total += errors[i]
    if total <= allowed:
        return allowed
    sums = np.zeros(_STEPS)
    for i in range(len(errors)):
        if errors[i] <= allowed:
            below = -2 * np.log2(max(errors[i] / allowed, 1e-38))
            sums[min(int(below), _STEPS - 1)] += errors[i]
    step = 0
    while step < _STEPS and total > allowed:
        total -= sums[step]
        step += 1
    return allowed * 2 ** (-step / 2)


@_compiled
def _errors(block: np.ndarray, left: np.ndarray, errors: np.ndarray) -> None:
    for i in range(LANES):
        errors[i] = 0.0
    for k in range(1, ORDER):
        share = left[k]
        if share != 0:
            real = np.uint64(SERIES + 2 * LANES * (k - 1))
            imag = real + np.uint64(LANES)
            for i in range(np.uint64(LANES)):
                g, h = block[real + i], block[imag + i]
                errors[i] += share * np.sqrt(g * g + h * h)
    for i in range(LANES):
        errors[i] *= errors[i] * (block[REAL + i] ** 2 + block[IMAG + i] ** 2)


@_compiled
def _all_errors(blocks: np.ndarray, left: np.ndarray, errors: np.ndarray) -> None:
    for b in range(len(blocks)):
        _errors(blocks[b], left, errors[b])
