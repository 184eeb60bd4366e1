"""The beat signal of very many scatterers, by non-uniform transforms.

Each echo is a tone times a short series: in fast time, for each chirp on its own (`by_chirp`),
or in fast and slow time, for a run of chirps (`by_run`). Tones of all scatterers are spread
onto a grid of frequencies, and transforms make samples of it. Which of the two, runs of which
length, and how long the series are, is chosen by counting what they cost; scatterers whose
series in a run are longer, the nearest and fastest, are summed chirp by chirp, or as a product
if they are few.

With n scatterers and N samples, runs take O(n + N log N), and chirps O(n chirps + N log N).
"""

from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.scratch import lent
from dechirp.core.threads import in_threads, slices
from dechirp.echoes.kernels import by_chirp, by_run, direct, product
from dechirp.echoes.kernels.axes import FastTime, fast_time, slow_axis
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.echoes.kernels.tones import (
    Paths,
    Waveform,
    hardest,
    left_out,
    powers,
    survey,
    tones,
    view,
)

GROUP = 2**17
"""Scatterers that are summed at once: their tones and series hold 17 MB."""

LARGEST = 2**23
"""Points of a grid, 64 MB."""

CACHED = 2**18
"""Points of a grid that a core's own cache holds, 2 MB."""

_SERIES = 1 / 4
"""Of the tolerance: what shortened series may leave out. Interpolation takes a quarter."""

_FEWEST = 16
"""Samples of a chirp, below which echoes are summed directly: all of few samples lie near the
edges of the window, where the error of a transform is ten times its mean."""

FEW = 150
"""Scatterers that a product sums faster than transforms of their own would."""

_LOOK = 1024
"""Scatterers that the costs are counted from: some of very many."""


def add(
    out: np.ndarray,
    scatterers: Scatterers,
    sent: Sent,
    *,
    tolerance: float = 1e-5,
    n_threads: int = 1,
) -> None:
    """Sum the echoes into `out`, (n_chirps, n_rx, n_samples), complex.

    `tolerance`: root mean square of the error over that of the echoes, from 2e-6; below,
    single precision does not reach. Amplitudes must not vary from chirp to chirp.
    """
    if not len(scatterers.amplitudes) or not sent.weights.any():
        return
    if out.shape[2] < _FEWEST:
        direct.add(out, scatterers, sent)
        return
    middle_s = sent.adc_start_s + out.shape[2] // 2 / sent.sample_rate_hz
    waveform = Waveform(
        sent.start_frequency_hz + sent.slope_hz_per_s * middle_s,
        sent.slope_hz_per_s,
        sent.sample_rate_hz,
        out.shape[2],
        sent.starts_s + middle_s,
    )
    for paths in _groups(scatterers):
        _add_group(out, paths, sent, waveform, tolerance, n_threads)


def _groups(scatterers: Scatterers) -> list[Paths]:
    """Scatterers from near to far: neighbours on the grid follow each other."""
    # In steps of a 16,000th of the farthest: whole numbers of two bytes sort in linear time.
    steps = np.empty(len(scatterers.amplitudes), np.int16)
    _range_steps(steps, np.asarray(scatterers.path_m[0], float))
    order = np.argsort(steps, kind="stable")
    path_m = np.empty((len(scatterers.path_m), 3, len(order)))
    _gather(path_m, np.asarray(scatterers.path_m, float), order)
    paths = Paths(
        path_m,
        np.asarray(scatterers.amplitudes, float)[order],
        np.asarray(scatterers.tx_gains, float)[:, order],
        np.asarray(scatterers.rx_gains, float)[:, order],
    )
    if len(order) <= GROUP:
        return [paths]
    return [paths.some(slice(at, at + GROUP)) for at in range(0, len(order), GROUP)]


_compiled = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}
)


@_compiled
def _range_steps(steps: np.ndarray, at_m: np.ndarray) -> None:
    farthest = 1e-300
    for i in range(len(steps)):
        x, y, z = at_m[i, 0], at_m[i, 1], at_m[i, 2]
        farthest = max(farthest, x * x + y * y + z * z)
    for i in range(len(steps)):
        x, y, z = at_m[i, 0], at_m[i, 1], at_m[i, 2]
        steps[i] = int(np.sqrt((x * x + y * y + z * z) / farthest) * 16383)


@_compiled
def _gather(out: np.ndarray, path_m: np.ndarray, order: np.ndarray) -> None:
    for k in range(len(path_m)):
        for i in range(len(order)):
            for axis in range(3):
                out[k, axis, i] = path_m[k, order[i], axis]


class Plan(NamedTuple):
    """How echoes are summed."""

    n_runs: int
    """0: chirp by chirp."""
    n_fields: int
    """Of the series in a run."""


def _add_group(
    out: np.ndarray,
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    tolerance: float,
    n_threads: int,
) -> None:
    fast = fast_time(paths, sent, waveform, 1.5 if tolerance >= 9e-6 else 2.0, tolerance)
    plan = cheapest(paths, sent, waveform, fast, tolerance, n_threads)
    if plan.n_runs == 0:
        txs, rxs = _used(sent)
        amplitudes = _strengths(paths.middling(txs, rxs), sent, waveform)
        allowed = (_SERIES * tolerance) ** 2 * float(np.sum(amplitudes**2))
        by_chirp.add(out, paths, sent, waveform, fast, txs, rxs, allowed, n_threads)
        return
    jobs = [(run, rx) for run in slices(len(out), plan.n_runs) for rx in range(len(sent.rx_m))]
    within = 1 if len(jobs) % n_threads == 0 or len(jobs) > 2 * n_threads else n_threads

    def one(job: tuple[slice, int]) -> None:
        run, rx = job
        _add_run(
            out[run, rx], paths, sent, waveform, run, rx, fast, plan.n_fields, tolerance, within
        )

    in_threads(n_threads // within, one, jobs)


def _add_run(
    out: np.ndarray,
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    run: slice,
    rx: int,
    fast: FastTime,
    n_fields: int,
    tolerance: float,
    n_threads: int,
) -> None:
    """Add what one receiver sees in a run to (n_chirps, n_samples)."""
    times_s = waveform.times_s[run]
    mid_s = float(times_s[0] + times_s[-1]) / 2
    half_s = by_run.half_duration_s(times_s, fast.half_s)
    shorter = waveform._replace(times_s=times_s)
    part = sent._replace(starts_s=sent.starts_s[run], weights=sent.weights[run])
    target = out
    if fast.between is not None:
        target = lent("known", (len(out), len(fast.times_s)))
        target[:] = 0
    for tx in (int(tx) for tx in np.flatnonzero(part.weights.any(axis=0))):
        seen = view(paths, sent, waveform, (tx, rx), mid_s, half_s, one_chirp=False)
        look = survey(seen, n_fields, n_threads)
        allowed = (_SERIES * tolerance) ** 2 * look.power
        hard = hardest(look.errors, allowed)
        if hard.any():
            few, alone = _seen_by(paths.some(hard), rx), part._replace(rx_m=sent.rx_m[[rx]])
            if len(few.amplitudes) <= FEW:
                _add_few(target[:, None], few, alone, waveform, fast, tx, tolerance, n_threads)
            else:
                by_chirp.add(
                    out[:, None], few, alone, shorter, fast, [tx], [0], allowed, n_threads,
                    target[:, None],
                )  # fmt: skip
        by_run.add(
            target, seen, look, hard, part.weights[:, tx], n_fields, shorter, fast, tolerance,
            n_threads,
        )  # fmt: skip
    between = fast.between
    if between is not None:

        def fill(some: slice) -> None:
            between.fill(out, np.arange(some.start, some.stop), target[some])

        in_threads(n_threads, fill, slices(len(out), n_threads))


def _add_few(
    known: np.ndarray,
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    fast: FastTime,
    tx: int,
    tolerance: float,
    n_threads: int,
) -> None:
    """Add some scatterers as a product to (n_chirps, 1, n_times), at the times of `fast`."""
    middle_s = sent.adc_start_s + waveform.n_samples // 2 / waveform.sample_rate_hz
    at_times = sent._replace(
        tx_m=sent.tx_m[[tx]],
        weights=sent.weights[:, [tx]],
        adc_start_s=middle_s + fast.times_s[0],
        sample_rate_hz=1 / fast.axis.step_s,
    )
    few = Scatterers(
        paths.path_m.transpose(0, 2, 1), paths.amplitudes, paths.tx_gains[[tx]], paths.rx_gains
    )
    mixer = np.exp(-2j * np.pi * (fast.mixed_hz * fast.times_s % 1)).astype(np.complex64)

    def one(some: slice) -> None:
        part = at_times._replace(starts_s=sent.starts_s[some], weights=at_times.weights[some])
        echoes = lent("few", known[some].shape)
        echoes[:] = 0
        product.add(echoes, few, part, tolerance=tolerance)
        echoes *= mixer
        known[some] += echoes

    in_threads(n_threads, one, slices(len(known), n_threads))


def _seen_by(paths: Paths, rx: int) -> Paths:
    return paths._replace(rx_gains=paths.rx_gains[[rx]])


def _used(sent: Sent) -> tuple[list[int], list[int]]:
    """Transmitters that ever send, and all receivers."""
    return np.flatnonzero(sent.weights.any(axis=0)).tolist(), list(range(len(sent.rx_m)))


def _strengths(paths: Paths, sent: Sent, waveform: Waveform) -> np.ndarray:
    """Amplitudes of the echoes, about: on the first pair of antennas, amid the chirps."""
    mid_s = waveform.times_s[len(waveform.times_s) // 2]
    at_m = sum(paths.path_m[k] * mid_s**k for k in range(len(paths.path_m)))
    there, back = (
        np.linalg.norm(at_m - antenna_m[:, None], axis=0)
        for antenna_m in (sent.tx_m[0], sent.rx_m[0])
    )
    return np.asarray(paths.amplitudes * paths.tx_gains[0] * paths.rx_gains[0] / (there * back))


def cheapest(
    paths: Paths,
    sent: Sent,
    waveform: Waveform,
    fast: FastTime,
    tolerance: float,
    n_threads: int = 1,
) -> Plan:
    """The way that takes least, in ns on one core with 512-bit vectors."""
    n, n_chirps = len(paths.amplitudes), len(waveform.times_s)
    n_rx, n_times, n_columns = len(sent.rx_m), len(fast.times_s), fast.axis.n_points
    txs, rxs = _used(sent)
    few = paths.some(slice(None, None, -(-n // _LOOK))).middling(txs, rxs)
    strengths = _strengths(few, sent, waveform)
    allowed = (_SERIES * tolerance) ** 2 * float(np.sum(strengths**2))
    n_lines = int(np.count_nonzero(sent.weights)) * n_rx
    n_pairs = int(np.count_nonzero(sent.weights.any(axis=0))) * n_rx
    chirp_fields, _ = by_chirp.fields_needed(few, sent, waveform, fast.half_s, txs, rxs, allowed)
    scatterer_ns = 20 + 3 * chirp_fields
    best = Plan(0, 0)
    line_ns = 4.5 * chirp_fields * n_columns + 3 * n_times
    best_ns = n_lines * n * scatterer_ns + n_chirps * n_rx * line_ns
    if n_lines * n * scatterer_ns < n_chirps * n_rx * line_ns:
        return best
    half_s = by_run.half_duration_s(waveform.times_s, fast.half_s)
    mid_s = float(waveform.times_s[0] + waveform.times_s[-1]) / 2
    seen = view(few, sent, waveform, (0, 0), mid_s, half_s, one_chirp=False)
    blocks = tones(seen)
    allowed = (_SERIES * tolerance) ** 2 * float(powers(blocks).sum())
    look = survey(seen, 1)
    band_hz = 2 * look.fastest_hz
    if by_run.stretch_left_out(look, waveform, half_s) > _SERIES * tolerance:
        return best
    n_runs = 1
    while n_chirps >= 4 * n_runs:
        half_run_s = (half_s - fast.half_s) / n_runs + fast.half_s
        n_rows = slow_axis(band_hz, half_run_s, fast.axis.spacing).n_points
        most = slow_axis(2 * fast.most_doppler_hz, half_run_s, fast.axis.spacing).n_points
        for n_fields in range(2, 6):
            if most * n_columns * (n_fields + 1) > LARGEST:
                break
            n_points = (n_fields + 1) * n_rows * n_columns
            points_ns = (8 if n_points > CACHED else 5) * n_points
            run_ns = 1e5 + n * (30 + 12 * (n_fields + 1)) + points_ns
            sampled_ns = n_lines * n_times * (2 + n_fields)
            ns = n_runs * n_pairs * run_ns + sampled_ns
            if n_runs * n_rx < n_threads:  # threads that share a run wait for each other
                ns *= 1.5
            if ns >= best_ns:  # more fields take longer
                break
            hard = n * float(np.mean(hardest(left_out(blocks, n_fields, 1 / n_runs), allowed)))
            if hard > FEW:
                ns += n_lines * (hard * scatterer_ns + 6 * line_ns)  # longer series
            else:
                ns += n_lines * hard * (35 + 0.16 * n_times)
            if ns < best_ns:
                best, best_ns = Plan(n_runs, n_fields), ns
        n_runs *= 2
    return best
