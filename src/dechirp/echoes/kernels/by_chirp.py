"""Echoes chirp by chirp: each is one tone in fast time, times a short series.

Nothing is assumed of what happens from chirp to chirp, so near field, weights and long frames
cost nothing; each scatterer is expanded anew in each chirp, some 30 ns, and a transform for each
chirp and receiver remains. Best for up to some thousand scatterers.
"""

import numba
import numpy as np
import scipy.fft

from dechirp.echoes.kernels import direct
from dechirp.echoes.kernels.axes import FastTime
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.echoes.kernels.gridding import spread_line
from dechirp.echoes.kernels.patches import WIDTH
from dechirp.echoes.kernels.series import BLOCK, LANES, WORK, View, expand_block, shifts_of
from dechirp.echoes.kernels.threads import in_threads
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
    n_fields, hard = fields_needed(paths, sent, waveform, transmitters, receivers, allowed)
    if hard.any():
        _add_directly(out, paths.some(hard), sent, transmitters, receivers)
        paths = paths.some(~hard)
        if not len(paths.amplitudes):
            return
    active = np.flatnonzero(sent.weights[:, transmitters].any(axis=1))
    n_together = max(_TOGETHER // (n_fields * fast.axis.n_points), 1)
    n_together = min(n_together, -(-len(active) * len(receivers) // n_threads))
    jobs = [
        (rx, active[first : first + n_together])
        for rx in receivers
        for first in range(0, len(active), n_together)
    ]
    gains = paths.amplitudes * paths.tx_gains[transmitters]
    tx_m, weights = sent.tx_m[transmitters], sent.weights[:, transmitters].astype(complex)
    kept = ECONOMISED[n_fields - 1][0]
    no_change = np.eye(12)[-1]
    columns_at = fast.axis.places(fast.mixed_hz)
    s = (fast.times_s / waveform.half_window_s).astype(np.float32)

    def one(job: tuple[int, np.ndarray]) -> None:
        rx, chirps = job
        grid = np.zeros((len(chirps), n_fields, fast.axis.n_points + WIDTH), np.complex64)
        _spread(
            grid.view(np.float32).reshape(-1),
            fast.axis.n_points,
            paths.path_m,
            gains * paths.rx_gains[rx],
            waveform.times_s[chirps],
            weights[chirps],
            waveform.half_window_s,
            tx_m,
            sent.rx_m[rx],
            waveform.mid_frequency_hz,
            waveform.slope_hz_per_s,
            kept,
            no_change,
            columns_at,
            fast.axis.spread.polynomials,
        )
        grid[:, :, :WIDTH] += grid[:, :, -WIDTH:]
        lines = grid[:, :, :-WIDTH]
        lines = scipy.fft.ifft(lines, norm="forward", overwrite_x=True)[:, :, fast.kept]
        if fast.between is None or known is not None:
            into = out if known is None else known
            _sum_fields(into[:, rx], chirps, lines, s, fast.over())
        else:
            target = np.zeros((len(chirps), len(s)), np.complex64)
            _sum_fields(target, np.arange(len(chirps)), lines, s, fast.over())
            fast.between.fill(out[:, rx], chirps, target)

    in_threads(n_threads, one, jobs)


def fields_needed(
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    transmitters: list[int],
    receivers: list[int],
    allowed: float,
) -> tuple[int, np.ndarray]:
    """Fields of the series in each chirp, and a mask of scatterers that need too many."""
    n, last = len(paths.amplitudes), len(waveform.times_s) - 1
    paths = paths.middling(transmitters, receivers)
    pair = transmitters[0], receivers[0]

    def look(some: Paths, time_s: float) -> np.ndarray:
        return tones(
            view(some, sent, waveform, pair, time_s, waveform.half_window_s, one_chirp=True)
        )

    times_s = waveform.times_s[[last * part // 4 for part in range(5)]]
    looks = [look(paths, time_s) for time_s in times_s]
    close = _come_closer(paths, sent, times_s)
    every = [look(paths.some(close), t) for t in waveform.times_s] if close.any() else []
    for n_fields in range(1, MOST_FIELDS + 1):
        if all(left_out(blocks, n_fields).sum() <= allowed for blocks in looks + every):
            return n_fields, np.zeros(n, bool)
    errors = np.max([left_out(blocks, MOST_FIELDS)[:n] for blocks in looks], axis=0)
    if every:
        n_close = int(np.count_nonzero(close))
        nearest = np.max([left_out(blocks, MOST_FIELDS)[:n_close] for blocks in every], axis=0)
        errors[close] = np.maximum(errors[close], nearest)
    return MOST_FIELDS, ~(errors <= allowed / n)


def _come_closer(paths: Paths, sent: Sent, times_s: np.ndarray) -> np.ndarray:
    """Which scatterers may be much closer between two of the times than at any of them."""
    centre_m = np.concatenate([sent.tx_m, sent.rx_m]).mean(axis=0)[:, None]
    powers = range(len(paths.path_m))
    nearest_m = np.min(
        [
            np.linalg.norm(sum(paths.path_m[k] * t**k for k in powers) - centre_m, axis=0)
            for t in times_s
        ],
        axis=0,
    )
    latest_s, apart_s = float(abs(times_s).max()), float(np.diff(times_s).max(initial=0))
    fastest = sum(
        k * latest_s ** (k - 1) * np.linalg.norm(paths.path_m[k], axis=0) for k in powers if k
    )
    # A quarter closer: nearer, series soon need one field more.
    return np.asarray(fastest * apart_s / 2 > 0.25 * nearest_m)


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
    amplitudes: np.ndarray,
    times_s: np.ndarray,
    weights: np.ndarray,
    half_s: float,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    mid_frequency_hz: float,
    slope_hz_per_s: float,
    kept: np.ndarray,
    before: np.ndarray,
    columns_at: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Add all tones of some chirps to (n_chirps, n_fields, n_columns + WIDTH) frequencies."""
    n = amplitudes.shape[1]
    work, block = np.zeros(WORK), np.empty(BLOCK)
    values = np.empty(2 * LANES * len(kept))
    for m in range(len(times_s)):
        first_float = 2 * m * len(kept) * (n_columns + WIDTH)
        for tx in range(len(tx_m)):
            if weights[m, tx] == 0:
                continue
            seen = View(
                path_m, amplitudes[tx], tx_m[tx], rx_m, times_s[m], half_s, mid_frequency_hz,
                slope_hz_per_s, True,
            )  # fmt: skip
            shifts = shifts_of(seen)
            for first in range(0, n, LANES):
                expand_block(seen, shifts, first, work, block)
                spread_line(
                    grid, first_float, n_columns, block, weights[m, tx], kept, before,
                    columns_at, polynomials, values,
                )  # fmt: skip


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
