"""Non-uniform FFT kernel: the beat signal of very many scatterers.

Each echo is a tone times a short series: in fast time, separately for each chirp
(`nufft_by_chirp`), or in fast and slow time, for a run of chirps (`nufft_by_run`). The tones of all
scatterers are spread onto a grid of frequencies, which transforms convert to samples. A cost model
chooses between the two, the length of the runs, and the length of the series. Scatterers that need
longer series in a run, the nearest and fastest, are summed chirp by chirp, or by the low-rank
kernel if they are few.

With n scatterers and N samples, runs take O(n + N log N), and chirps O(n chirps + N log N).
"""

from typing import NamedTuple

import numpy as np

from dechirp.core.buffers import scratch_complex64_array
from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.threads import run_in_threads, split_range
from dechirp.simulation.kernels import direct, low_rank, nufft_by_chirp, nufft_by_run
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.grid_axes import FastTime, make_fast_time_grid, make_slow_time_axis
from dechirp.simulation.kernels.tones import (
    ScattererPaths,
    Waveform,
    antenna_pair_view,
    expand_tones,
    mask_scatterers_with_largest_errors,
    survey_tone_frequencies_and_errors,
    tone_powers,
    truncation_error_powers,
)

GROUP_SIZE = 2**17
"""Scatterers that are summed together: their tones and series take 17 MB."""

MAX_GRID_POINTS = 2**23
"""Largest number of grid points, 64 MB."""

CACHED_GRID_POINTS = 2**18
"""Grid points that the cache of one core holds, 2 MB."""

_SERIES_SHARE = 1 / 4
"""Share of the tolerance for truncated series. Interpolation takes a quarter."""

_MIN_SAMPLES = 16
"""Samples of a chirp below which echoes are summed directly: the error of a transform is ten
times its mean near the edges of the window, and few samples all lie there."""

MAX_LOW_RANK_SCATTERERS = 150
"""Scatterers up to which the low-rank kernel is faster than separate transforms."""

_COST_SAMPLE = 1024
"""Scatterers from which the cost model estimates those of all."""


def add_echoes(
    out: np.ndarray,
    scatterers: Scatterers,
    transmission: Transmission,
    *,
    tolerance: float = 1e-5,
    n_threads: int = 1,
) -> None:
    """Add the echoes to `out`, (n_chirps, n_rx, n_samples), complex.

    `tolerance` is the root mean square of the error over that of the echoes, at least 2e-6, the
    limit
    of single precision. Amplitudes must not vary between chirps.
    """
    if not len(scatterers.amplitudes) or not transmission.weights.any():
        return
    if out.shape[2] < _MIN_SAMPLES:
        direct.add_echoes(out, scatterers, transmission)
        return
    middle_s = transmission.adc_start_s + out.shape[2] // 2 / transmission.sample_rate_hz
    waveform = Waveform(
        transmission.start_frequency_hz + transmission.slope_hz_per_s * middle_s,
        transmission.slope_hz_per_s,
        transmission.sample_rate_hz,
        out.shape[2],
        transmission.starts_s + middle_s,
    )
    for paths in _sort_by_range_and_split(scatterers):
        _add_scatterer_group(out, paths, transmission, waveform, tolerance, n_threads)


def _sort_by_range_and_split(scatterers: Scatterers) -> list[ScattererPaths]:
    """Sort scatterers by range, so that neighbours on the grid are adjacent, and split them."""
    # In steps of a 16,000th of the farthest: integers of two bytes sort in linear time.
    steps = np.empty(len(scatterers.amplitudes), np.int16)
    _fill_range_sort_keys(steps, np.asarray(scatterers.path_m[0], float))
    order = np.argsort(steps, kind="stable")
    path_m = np.empty((len(scatterers.path_m), 3, len(order)))
    _reorder_paths(path_m, np.asarray(scatterers.path_m, float), order)
    paths = ScattererPaths(
        path_m,
        np.asarray(scatterers.amplitudes, float)[order],
        np.asarray(scatterers.tx_gains, float)[:, order],
        np.asarray(scatterers.rx_gains, float)[:, order],
    )
    if len(order) <= GROUP_SIZE:
        return [paths]
    return [
        paths.select(slice(first, first + GROUP_SIZE)) for first in range(0, len(order), GROUP_SIZE)
    ]


_compiled = kernel(fastmath={"contract", "reassoc"})


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _fill_range_sort_keys(sort_keys: np.ndarray, positions_m: np.ndarray) -> None:
    farthest = 1e-300
    for i in range(len(sort_keys)):
        x, y, z = positions_m[i, 0], positions_m[i, 1], positions_m[i, 2]
        farthest = max(farthest, x * x + y * y + z * z)
    for i in range(len(sort_keys)):
        x, y, z = positions_m[i, 0], positions_m[i, 1], positions_m[i, 2]
        sort_keys[i] = int(np.sqrt((x * x + y * y + z * z) / farthest) * 16383)


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _reorder_paths(
    reordered_terms_m: np.ndarray, path_terms_m: np.ndarray, order: np.ndarray
) -> None:
    for k in range(len(path_terms_m)):
        for i in range(len(order)):
            for axis in range(3):
                reordered_terms_m[k, axis, i] = path_terms_m[k, order[i], axis]


class NufftPlan(NamedTuple):
    """Parameters of the summation."""

    n_runs: int
    """Number of runs; 0: chirp by chirp."""
    n_fields: int
    """Number of fields of the series in a run."""


def _add_scatterer_group(
    out: np.ndarray,
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    tolerance: float,
    n_threads: int,
) -> None:
    fast = make_fast_time_grid(
        paths, transmission, waveform, 1.5 if tolerance >= 9e-6 else 2.0, tolerance
    )
    plan = choose_run_and_field_counts(paths, transmission, waveform, fast, tolerance, n_threads)
    if plan.n_runs == 0:
        txs, rxs = _active_transmitters_and_all_receivers(transmission)
        amplitudes = _approximate_echo_amplitudes(
            paths.with_rms_gains(txs, rxs), transmission, waveform
        )
        allowed = (_SERIES_SHARE * tolerance) ** 2 * float(np.sum(amplitudes**2))
        nufft_by_chirp.add_echoes(
            out, paths, transmission, waveform, fast, txs, rxs, allowed, n_threads
        )
        return
    jobs = [
        (run, rx)
        for run in split_range(len(out), plan.n_runs)
        for rx in range(len(transmission.rx_m))
    ]
    threads_per_job = 1 if len(jobs) % n_threads == 0 or len(jobs) > 2 * n_threads else n_threads

    def process(job: tuple[slice, int]) -> None:
        run, rx = job
        _add_run_echoes_of_receiver(
            out[run, rx],
            paths,
            transmission,
            waveform,
            run,
            rx,
            fast,
            plan.n_fields,
            tolerance,
            threads_per_job,
        )

    run_in_threads(n_threads // threads_per_job, process, jobs)


def _add_run_echoes_of_receiver(
    out: np.ndarray,
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    run: slice,
    rx: int,
    fast: FastTime,
    n_fields: int,
    tolerance: float,
    n_threads: int,
) -> None:
    """Add the echoes of one receiver in a run to (n_chirps, n_samples)."""
    times_s = waveform.times_s[run]
    mid_s = float(times_s[0] + times_s[-1]) / 2
    half_s = nufft_by_run.half_run_duration_s(times_s, fast.half_s)
    shorter = waveform._replace(times_s=times_s)
    part = transmission._replace(
        starts_s=transmission.starts_s[run], weights=transmission.weights[run]
    )
    target = out
    if fast.interpolator is not None:
        target = scratch_complex64_array("known", (len(out), len(fast.times_s)))
        target[:] = 0
    for tx in (int(tx) for tx in np.flatnonzero(part.weights.any(axis=0))):
        view = antenna_pair_view(
            paths, transmission, waveform, (tx, rx), mid_s, half_s, one_chirp=False
        )
        survey = survey_tone_frequencies_and_errors(view, n_fields, n_threads)
        allowed = (_SERIES_SHARE * tolerance) ** 2 * survey.power
        is_hard = mask_scatterers_with_largest_errors(survey.errors, allowed)
        if is_hard.any():
            few_paths, single_receiver = (
                _select_receiver(paths.select(is_hard), rx),
                part._replace(rx_m=transmission.rx_m[[rx]]),
            )
            if len(few_paths.amplitudes) <= MAX_LOW_RANK_SCATTERERS:
                _add_few_by_low_rank_kernel(
                    target[:, None],
                    few_paths,
                    single_receiver,
                    waveform,
                    fast,
                    tx,
                    tolerance,
                    n_threads,
                )
            else:
                nufft_by_chirp.add_echoes(
                    out[:, None], few_paths, single_receiver, shorter, fast, [tx], [0], allowed,
                    n_threads,
                    target[:, None],
                )  # fmt: skip
        nufft_by_run.add_echoes(
            target, view, survey, is_hard, part.weights[:, tx], n_fields, shorter, fast, tolerance,
            n_threads,
        )  # fmt: skip
    interpolator = fast.interpolator
    if interpolator is not None:

        def fill(rows: slice) -> None:
            interpolator.add_interpolated(out, np.arange(rows.start, rows.stop), target[rows])

        run_in_threads(n_threads, fill, split_range(len(out), n_threads))


def _add_few_by_low_rank_kernel(
    known_samples: np.ndarray,
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    fast: FastTime,
    tx: int,
    tolerance: float,
    n_threads: int,
) -> None:
    """Add some scatterers by the low-rank kernel to (n_chirps, 1, n_times)."""
    middle_s = transmission.adc_start_s + waveform.n_samples // 2 / waveform.sample_rate_hz
    at_times = transmission._replace(
        tx_m=transmission.tx_m[[tx]],
        weights=transmission.weights[:, [tx]],
        adc_start_s=middle_s + fast.times_s[0],
        sample_rate_hz=1 / fast.axis.step_s,
    )
    few_paths = Scatterers(
        paths.path_m.transpose(0, 2, 1), paths.amplitudes, paths.tx_gains[[tx]], paths.rx_gains
    )
    mixer = np.exp(-2j * np.pi * (fast.mixer_hz * fast.times_s % 1)).astype(np.complex64)

    def process(rows: slice) -> None:
        part = at_times._replace(
            starts_s=transmission.starts_s[rows], weights=at_times.weights[rows]
        )
        echoes = scratch_complex64_array("few", known_samples[rows].shape)
        echoes[:] = 0
        low_rank.add_echoes(echoes, few_paths, part, tolerance=tolerance)
        echoes *= mixer
        known_samples[rows] += echoes

    run_in_threads(n_threads, process, split_range(len(known_samples), n_threads))


def _select_receiver(paths: ScattererPaths, rx: int) -> ScattererPaths:
    return paths._replace(rx_gains=paths.rx_gains[[rx]])


def _active_transmitters_and_all_receivers(
    transmission: Transmission,
) -> tuple[list[int], list[int]]:
    """Return the transmitters that send in some chirp, and all receivers."""
    return np.flatnonzero(transmission.weights.any(axis=0)).tolist(), list(
        range(len(transmission.rx_m))
    )


def _approximate_echo_amplitudes(
    paths: ScattererPaths, transmission: Transmission, waveform: Waveform
) -> np.ndarray:
    """Return approximate amplitudes of the echoes: first antenna pair, middle chirp."""
    mid_s = waveform.times_s[len(waveform.times_s) // 2]
    positions_m = sum(paths.path_m[k] * mid_s**k for k in range(len(paths.path_m)))
    outbound, inbound = (
        np.linalg.norm(positions_m - antenna_m[:, None], axis=0)
        for antenna_m in (transmission.tx_m[0], transmission.rx_m[0])
    )
    return np.asarray(
        paths.amplitudes * paths.tx_gains[0] * paths.rx_gains[0] / (outbound * inbound)
    )


def choose_run_and_field_counts(
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    fast: FastTime,
    tolerance: float,
    n_threads: int = 1,
) -> NufftPlan:
    """Choose the plan with the least predicted time, in ns on one core with 512-bit vectors."""
    n, n_chirps = len(paths.amplitudes), len(waveform.times_s)
    n_rx, n_times, n_columns = len(transmission.rx_m), len(fast.times_s), fast.axis.n_points
    txs, rxs = _active_transmitters_and_all_receivers(transmission)
    few_paths = paths.select(slice(None, None, -(-n // _COST_SAMPLE))).with_rms_gains(txs, rxs)
    strengths = _approximate_echo_amplitudes(few_paths, transmission, waveform)
    allowed = (_SERIES_SHARE * tolerance) ** 2 * float(np.sum(strengths**2))
    n_lines = int(np.count_nonzero(transmission.weights)) * n_rx
    n_pairs = int(np.count_nonzero(transmission.weights.any(axis=0))) * n_rx
    chirp_fields, _ = nufft_by_chirp.required_field_count_and_unsuitable_mask(
        few_paths, transmission, waveform, fast.half_s, txs, rxs, allowed
    )
    scatterer_ns = 20 + 3 * chirp_fields
    best = NufftPlan(0, 0)
    line_ns = 4.5 * chirp_fields * n_columns + 3 * n_times
    best_ns = n_lines * n * scatterer_ns + n_chirps * n_rx * line_ns
    if n_lines * n * scatterer_ns < n_chirps * n_rx * line_ns:
        return best
    half_s = nufft_by_run.half_run_duration_s(waveform.times_s, fast.half_s)
    mid_s = float(waveform.times_s[0] + waveform.times_s[-1]) / 2
    view = antenna_pair_view(
        few_paths, transmission, waveform, (0, 0), mid_s, half_s, one_chirp=False
    )
    blocks = expand_tones(view)
    allowed = (_SERIES_SHARE * tolerance) ** 2 * float(tone_powers(blocks).sum())
    survey = survey_tone_frequencies_and_errors(view, 1)
    band_hz = 2 * survey.max_doppler_hz
    if (
        nufft_by_run.slow_time_stretch_error_bound(survey, waveform, half_s)
        > _SERIES_SHARE * tolerance
    ):
        return best
    n_runs = 1
    while n_chirps >= 4 * n_runs:
        half_run_s = (half_s - fast.half_s) / n_runs + fast.half_s
        n_rows = make_slow_time_axis(band_hz, half_run_s, fast.axis.spacing).n_points
        most = make_slow_time_axis(2 * fast.max_doppler_hz, half_run_s, fast.axis.spacing).n_points
        for n_fields in range(2, 6):
            if most * n_columns * (n_fields + 1) > MAX_GRID_POINTS:
                break
            n_points = (n_fields + 1) * n_rows * n_columns
            points_ns = (8 if n_points > CACHED_GRID_POINTS else 5) * n_points
            run_ns = 1e5 + n * (30 + 12 * (n_fields + 1)) + points_ns
            sampled_ns = n_lines * n_times * (2 + n_fields)
            ns = n_runs * n_pairs * run_ns + sampled_ns
            if n_runs * n_rx < n_threads:  # threads that share a run wait for each other
                ns *= 1.5
            if ns >= best_ns:  # more fields take longer
                break
            is_hard = n * float(
                np.mean(
                    mask_scatterers_with_largest_errors(
                        truncation_error_powers(blocks, n_fields, 1 / n_runs), allowed
                    )
                )
            )
            if is_hard > MAX_LOW_RANK_SCATTERERS:
                ns += n_lines * (is_hard * scatterer_ns + 6 * line_ns)  # longer series
            else:
                ns += n_lines * is_hard * (35 + 0.16 * n_times)
            if ns < best_ns:
                best, best_ns = NufftPlan(n_runs, n_fields), ns
        n_runs *= 2
    return best
