"""Echoes chirp by chirp: each is one tone in fast time, times a short series.

Nothing is assumed of what happens from chirp to chirp, so near field, weights and long frames
cost nothing; each scatterer is expanded anew in each chirp, some 30 ns, and a transform for each
chirp and receiver remains. Best for up to some thousand scatterers.
"""

from collections.abc import Iterator
from math import comb

import numba
import numpy as np
import scipy.fft

from dechirp.core.scratch import lent
from dechirp.core.threads import in_threads
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.kernels import direct
from dechirp.echoes.kernels.axes import FastTime
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.echoes.kernels.gridding import TAPS, spread_line
from dechirp.echoes.kernels.patches import WIDTH
from dechirp.echoes.kernels.series import (
    BLOCK,
    LANES,
    WORK,
    View,
    expand_back,
    expand_there,
    parts_of,
    shifts_of,
)
from dechirp.echoes.kernels.tones import (
    ECONOMISED,
    MOST_FIELDS,
    Paths,
    Waveform,
    left_out,
    tones,
    view,
)

_TOGETHER = 2**17
"""Points of a grid that are transformed together, 1 MB: some chirps."""


def add(
    out: np.ndarray,
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    fast: FastTime,
    transmitters: list[int],
    receivers: list[int],
    allowed: float,
    n_threads: int,
    known: np.ndarray | None = None,
) -> None:
    """Add what some pairs of antennas see of all scatterers to `out`.

    `allowed`: power of the error, that of an echo of amplitude 1 being 1. With `known`,
    (n_chirps, n_rx, n_times), to that instead, at the times of `fast` alone.
    """
    half_s = fast.half_s
    n_fields, hard = fields_needed(paths, sent, waveform, half_s, transmitters, receivers, allowed)
    if hard.any():
        _add_directly(out, paths.some(hard), sent, transmitters, receivers)
        paths = paths.some(~hard)
        if not len(paths.amplitudes):
            return
    active = np.flatnonzero(sent.weights[:, transmitters].any(axis=1))
    n_together = max(_TOGETHER // (len(receivers) * n_fields * fast.axis.n_points), 1)
    n_together = min(n_together, -(-len(active) // n_threads))
    jobs = [active[first : first + n_together] for first in range(0, len(active), n_together)]
    amplitudes = (paths.amplitudes * paths.tx_gains[transmitters])[:, None] * paths.rx_gains[
        receivers
    ]
    tx_m, rx_m = sent.tx_m[transmitters], sent.rx_m[receivers]
    weights = sent.weights[:, transmitters].astype(complex)
    n_terms = terms_needed(paths.path_m, waveform, half_s)
    kept = ECONOMISED[n_fields - 1][0]
    columns_at = fast.axis.places(fast.mixed_hz)
    s = (fast.times_s / half_s).astype(np.float32)

    def one(chirps: np.ndarray) -> None:
        n_points = fast.axis.n_points + WIDTH
        grid = lent("chirps", (len(chirps), len(receivers), n_fields, n_points))
        grid[:] = 0
        _spread(
            grid.view(np.float32).reshape(-1),
            fast.axis.n_points,
            paths.path_m,
            n_terms,
            amplitudes,
            waveform.times_s[chirps],
            weights[chirps],
            half_s,
            tx_m,
            rx_m,
            waveform.mid_frequency_hz,
            waveform.slope_hz_per_s,
            kept,
            columns_at,
            fast.axis.spread.polynomials,
        )
        grid[..., :WIDTH] += grid[..., -WIDTH:]
        lines = grid[..., :-WIDTH]
        lines = scipy.fft.ifft(lines, norm="forward", overwrite_x=True)[..., fast.kept]
        for place, rx in enumerate(receivers):
            if fast.between is None or known is not None:
                into = out if known is None else known
                _sum_fields(into[:, rx], chirps, lines[:, place], s, fast.over())
            else:
                target = np.zeros((len(chirps), len(s)), np.complex64)
                _sum_fields(target, np.arange(len(chirps)), lines[:, place], s, fast.over())
                fast.between.fill(out[:, rx], chirps, target)

    in_threads(n_threads, one, jobs)


def terms_needed(path_m: np.ndarray, waveform: Waveform, half_s: float) -> int:
    """Terms of paths about the middle of a chirp: the rest turns the phase by 1e-7 rad at most."""
    close_m = 1e-8 * SPEED_OF_LIGHT / abs(waveform.mid_frequency_hz)
    n_terms = len(path_m)
    latest_s = float(abs(waveform.times_s).max())
    sizes_m = np.abs(path_m).max(axis=(1, 2), initial=0.0)
    left_m = 0.0
    for k in range(n_terms - 1, 1, -1):
        left_m += half_s**k * sum(
            comb(j, k) * latest_s ** (j - k) * sizes_m[j] for j in range(k, n_terms)
        )
        if left_m > close_m:
            return k + 1
    return min(n_terms, 2)


def fields_needed(
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    half_s: float,
    transmitters: list[int],
    receivers: list[int],
    allowed: float,
) -> tuple[int, np.ndarray]:
    """Fields of the series in each chirp, and a mask of scatterers that need too many."""
    n, last = len(paths.amplitudes), len(waveform.times_s) - 1
    paths = paths.middling(transmitters, receivers)
    times_s = waveform.times_s[[last * part // 4 for part in range(5)]]
    near, close = _nearby(
        paths.path_m, np.concatenate([sent.tx_m[transmitters], sent.rx_m[receivers]]), times_s
    )
    pairs = [(tx, rx) for tx in transmitters for rx in receivers]
    near &= len(pairs) > 1
    # Each look by another pair: a scatterer may come straight towards one, and cross another.
    ends = [(tx, rx) for rx in _ends(sent.rx_m, receivers) for tx in _ends(sent.tx_m, transmitters)]

    def looks() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Which are looked at, a mask, and blocks of tones."""

        def look(mask: np.ndarray, time_s: float, pair: tuple[int, int]) -> np.ndarray:
            some = paths if mask.all() else paths.some(mask)
            return tones(view(some, sent, waveform, pair, time_s, half_s, one_chirp=True))

        everyone = np.ones(n, bool)
        for turn, time_s in enumerate(times_s):
            yield everyone, look(everyone, time_s, ends[turn % len(ends)])
            for pair in pairs if near.any() else []:
                yield near, look(near, time_s, pair)
        if close.any():
            for m, tx in zip(*np.nonzero(sent.weights[:, transmitters]), strict=True):
                for rx in receivers:
                    yield close, look(close, waveform.times_s[m], (transmitters[tx], rx))

    n_fields = 1
    for _, blocks in looks():
        while n_fields <= MOST_FIELDS and not left_out(blocks, n_fields).sum() <= allowed:
            n_fields += 1
        if n_fields > MOST_FIELDS:
            break
    else:
        return n_fields, np.zeros(n, bool)
    errors = np.zeros(n)
    for mask, blocks in looks():
        found = left_out(blocks, MOST_FIELDS)[: np.count_nonzero(mask)]
        errors[mask] = np.maximum(errors[mask], found)
    return MOST_FIELDS, ~(errors <= allowed / n)


def _ends(antennas_m: np.ndarray, used: list[int]) -> list[int]:
    """Two antennas, about as far apart as any; or the only one."""

    def farthest(one: int) -> int:
        return used[int(np.argmax(np.linalg.norm(antennas_m[used] - antennas_m[one], axis=1)))]

    first = farthest(used[0])
    return list(dict.fromkeys([first, farthest(first)]))


def _nearby(
    path_m: np.ndarray, antennas_m: np.ndarray, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Scatterers that antennas see differently; and those much closer between the times."""
    centre_m = (antennas_m.min(axis=0) + antennas_m.max(axis=0)) / 2
    radius_m = float(np.linalg.norm(antennas_m - centre_m, axis=1).max())
    powers = range(len(path_m))

    def nearest(some_m: np.ndarray, places_m: np.ndarray) -> np.ndarray:
        found = np.full(some_m.shape[2], np.inf)
        for t in times_s:
            at_m = sum(some_m[k] * t**k for k in powers)
            for place_m in places_m:
                np.minimum(found, np.linalg.norm(at_m - place_m[:, None], axis=0), out=found)
        return found

    nearest_m = nearest(path_m, centre_m[None])
    # Farther off, antennas see them under angles and at distances that differ by an eighth.
    near = nearest_m < 8 * radius_m
    nearest_m -= radius_m
    if near.any():
        nearest_m[near] = nearest(path_m[..., near], antennas_m)
    latest_s, apart_s = float(abs(times_s).max()), float(np.diff(times_s).max(initial=0))
    fastest = sum(k * latest_s ** (k - 1) * np.linalg.norm(path_m[k], axis=0) for k in powers if k)
    # A quarter closer: nearer, series soon need one field more.
    return near, np.asarray(fastest * apart_s / 2 > 0.25 * nearest_m)


def _add_directly(
    out: np.ndarray, paths: Paths, sent: Sent, transmitters: list[int], receivers: list[int]
) -> None:
    scatterers = Scatterers(
        paths.path_m.transpose(0, 2, 1),
        paths.amplitudes,
        paths.tx_gains[transmitters],
        paths.rx_gains,
    )
    sent = sent._replace(tx_m=sent.tx_m[transmitters], weights=sent.weights[:, transmitters])
    for rx in receivers:
        one = slice(rx, rx + 1)
        direct.add(
            out[:, one],
            scatterers._replace(rx_gains=scatterers.rx_gains[one]),
            sent._replace(rx_m=sent.rx_m[one]),
        )


_compiled = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}
)


@_compiled
def _spread(
    grid: np.ndarray,
    n_columns: int,
    path_m: np.ndarray,
    n_terms: int,
    amplitudes: np.ndarray,
    times_s: np.ndarray,
    weights: np.ndarray,
    half_s: float,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    mid_frequency_hz: float,
    slope_hz_per_s: float,
    kept: np.ndarray,
    columns_at: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Add all tones of some chirps to (n_chirps, n_rx, n_fields, n_columns + WIDTH) frequencies."""
    n = amplitudes.shape[2]
    block, work = np.empty(BLOCK), np.zeros(WORK)
    places, there, back = parts_of(work)
    columns, between = np.empty(LANES, np.int64), np.empty(LANES, np.float32)
    tones, values = np.empty(4 * LANES, np.float32), np.empty(2 * LANES * len(kept), np.float32)
    taps, one = np.empty(TAPS, np.float32), np.ones(1, np.float32)
    now_m = np.empty((n_terms, 3, n))
    # Copies: views of what all threads share would be counted in one place by all of them.
    amplitudes, rx_m = amplitudes.copy(), rx_m.copy()
    for m in range(len(times_s)):
        _about(path_m, times_s[m], now_m)
        for tx in range(len(tx_m)):
            if weights[m, tx] == 0:
                continue
            seen = View(
                now_m, amplitudes[tx, 0], tx_m[tx], rx_m[0], 0.0, half_s, mid_frequency_hz,
                slope_hz_per_s, True,
            )  # fmt: skip
            shifts = shifts_of(seen)
            for first in range(0, n, LANES):
                expand_there(seen, shifts, first, places, there)
                for rx in range(len(rx_m)):
                    expand_back(
                        rx_m[rx], amplitudes[tx, rx], first, n_terms, mid_frequency_hz,
                        slope_hz_per_s, half_s, True, places, there, back, block,
                    )  # fmt: skip
                    spread_line(
                        grid, 2 * (m * len(rx_m) + rx) * len(kept) * (n_columns + WIDTH),
                        n_columns, block, min(LANES, n - first), weights[m, tx], kept,
                        columns_at, polynomials, columns, between, tones, values, taps, one,
                    )  # fmt: skip


@_compiled
def _about(path_m: np.ndarray, mid_s: float, now_m: np.ndarray) -> None:
    """Fill `now_m`, (n_terms, 3, n): the first terms of paths about another time."""
    n = path_m.shape[2]
    for k in range(len(now_m)):
        for axis in range(3):
            row = now_m[k, axis]
            row[:] = 0.0
            share = 1.0
            for j in range(k, len(path_m)):
                term = path_m[j, axis]
                for i in range(np.uint64(n)):
                    row[i] += share * term[i]
                share *= mid_s * (j + 1) / (j + 1 - k)


@_compiled
def _sum_fields(
    out: np.ndarray, rows: np.ndarray, lines: np.ndarray, s: np.ndarray, over: np.ndarray
) -> None:
    """Add the sum over f of s^f times field f, (n_chirps, n_fields, n_times), to some rows."""
    n_fields = lines.shape[1]
    total = np.empty(len(s), np.complex64)
    for m in range(len(rows)):
        for j in range(len(s)):
            total[j] = over[j] * lines[m, n_fields - 1, j]
        for f in range(n_fields - 2, -1, -1):
            for j in range(len(s)):
                total[j] = s[j] * total[j] + over[j] * lines[m, f, j]
        for j in range(len(s)):
            out[rows[m], j] += total[j]
