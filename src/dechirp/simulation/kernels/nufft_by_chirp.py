"""Non-uniform FFT chirp by chirp: one tone in fast time, times a short series.

Nothing is assumed about the change from chirp to chirp, so near field, weights and long frames cost
nothing. Each scatterer is expanded anew in each chirp, about 30 ns, plus a transform for each chirp
and receiver. It is best for up to some thousand scatterers.
"""

from collections.abc import Iterator
from math import comb

import numpy as np
import scipy

from dechirp.core.buffers import scratch_complex64_array
from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.threads import run_in_threads
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.kernels import direct
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.grid_axes import FastTime
from dechirp.simulation.kernels.gridding import TAPS, spread_tones_onto_frequency_lines
from dechirp.simulation.kernels.simd import WIDTH
from dechirp.simulation.kernels.taylor import (
    BLOCK,
    LANES,
    WORK,
    AntennaPairView,
    expand_inbound_ranges_and_fill_tones,
    expand_positions_and_outbound_ranges,
    polynomial_time_shift_matrix,
    split_work_into_positions_and_ranges,
)
from dechirp.simulation.kernels.tones import (
    ECONOMISATIONS,
    MAX_FIELDS,
    ScattererPaths,
    Waveform,
    antenna_pair_view,
    expand_tones,
    truncation_error_powers,
)

_BATCH_POINTS = 2**17
"""Grid points that are transformed together, 1 MB: some chirps."""


def add_echoes(
    out: np.ndarray,
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    fast: FastTime,
    transmitters: list[int],
    receivers: list[int],
    allowed_error_power: float,
    n_threads: int,
    known_samples: np.ndarray | None = None,
) -> None:
    """Add the echoes of some antenna pairs and all scatterers to `out`.

    `allowed_error_power` is the power of the error, relative to an echo of amplitude 1. With
    `known_samples`, (n_chirps, n_rx, n_times), the echoes are added there instead, only at the
    times of `fast`.
    """
    half_s = fast.half_s
    n_fields, is_hard = required_field_count_and_unsuitable_mask(
        paths, transmission, waveform, half_s, transmitters, receivers, allowed_error_power
    )
    if is_hard.any():
        _add_by_direct_kernel(out, paths.select(is_hard), transmission, transmitters, receivers)
        paths = paths.select(~is_hard)
        if not len(paths.amplitudes):
            return
    active = np.flatnonzero(transmission.weights[:, transmitters].any(axis=1))
    batch_size = max(_BATCH_POINTS // (len(receivers) * n_fields * fast.axis.n_points), 1)
    batch_size = min(batch_size, -(-len(active) // n_threads))
    jobs = [active[first : first + batch_size] for first in range(0, len(active), batch_size)]
    amplitudes = (paths.amplitudes * paths.tx_gains[transmitters])[:, None] * paths.rx_gains[
        receivers
    ]
    tx_m, rx_m = transmission.tx_m[transmitters], transmission.rx_m[receivers]
    weights = transmission.weights[:, transmitters].astype(complex)
    n_terms = required_path_term_count(paths.path_m, waveform, half_s)
    retained = ECONOMISATIONS[n_fields - 1][0]
    column_map = fast.axis.frequency_to_grid_scale_and_offset(fast.mixer_hz)
    s = (fast.times_s / half_s).astype(np.float32)

    def process_chirps(chirps: np.ndarray) -> None:
        n_points = fast.axis.n_points + WIDTH
        grid = scratch_complex64_array("chirps", (len(chirps), len(receivers), n_fields, n_points))
        grid[:] = 0
        _spread_tones_of_chirps(
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
            retained,
            column_map,
            fast.axis.spreading_kernel.polynomials,
        )
        grid[..., :WIDTH] += grid[..., -WIDTH:]
        lines = grid[..., :-WIDTH]
        lines = scipy.fft.ifft(lines, norm="forward", overwrite_x=True)[..., fast.time_slice]
        for position, rx in enumerate(receivers):
            if fast.interpolator is None or known_samples is not None:
                destination = out if known_samples is None else known_samples
                _add_fields_times_time_powers(
                    destination[:, rx], chirps, lines[:, position], s, fast.deapodisation_factors()
                )
            else:
                target = np.zeros((len(chirps), len(s)), np.complex64)
                _add_fields_times_time_powers(
                    target,
                    np.arange(len(chirps)),
                    lines[:, position],
                    s,
                    fast.deapodisation_factors(),
                )
                fast.interpolator.add_interpolated(out[:, rx], chirps, target)

    run_in_threads(n_threads, process_chirps, jobs)


def required_path_term_count(
    path_terms_m: np.ndarray, waveform: Waveform, half_window_s: float
) -> int:
    """Return the path terms about mid-chirp that leave at most 1e-7 rad of phase."""
    close_m = 1e-8 * SPEED_OF_LIGHT / abs(waveform.mid_frequency_hz)
    n_terms = len(path_terms_m)
    latest_s = float(abs(waveform.times_s).max())
    sizes_m = np.abs(path_terms_m).max(axis=(1, 2), initial=0.0)
    left_m = 0.0
    for k in range(n_terms - 1, 1, -1):
        left_m += half_window_s**k * sum(
            comb(j, k) * latest_s ** (j - k) * sizes_m[j] for j in range(k, n_terms)
        )
        if left_m > close_m:
            return k + 1
    return min(n_terms, 2)


def required_field_count_and_unsuitable_mask(
    paths: ScattererPaths,
    transmission: Transmission,
    waveform: Waveform,
    half_window_s: float,
    transmitters: list[int],
    receivers: list[int],
    allowed_error_power: float,
) -> tuple[int, np.ndarray]:
    """Return the fields of the series in each chirp, and a mask of unsuitable scatterers."""
    n, last = len(paths.amplitudes), len(waveform.times_s) - 1
    paths = paths.with_rms_gains(transmitters, receivers)
    times_s = waveform.times_s[[last * part // 4 for part in range(5)]]
    is_near, is_close = _near_and_closely_passing_masks(
        paths.path_m,
        np.concatenate([transmission.tx_m[transmitters], transmission.rx_m[receivers]]),
        times_s,
    )
    pairs = [(tx, rx) for tx in transmitters for rx in receivers]
    is_near &= len(pairs) > 1
    # Another pair each time: a scatterer may approach one antenna and cross in front of another.
    ends = [
        (tx, rx)
        for rx in _outermost_antenna_indices(transmission.rx_m, receivers)
        for tx in _outermost_antenna_indices(transmission.tx_m, transmitters)
    ]

    def examine() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield masks of the examined scatterers, and blocks of their tones."""

        def expand(mask: np.ndarray, time_s: float, pair: tuple[int, int]) -> np.ndarray:
            subset = paths if mask.all() else paths.select(mask)
            return expand_tones(
                antenna_pair_view(
                    subset, transmission, waveform, pair, time_s, half_window_s, one_chirp=True
                )
            )

        all_mask = np.ones(n, bool)
        for turn, time_s in enumerate(times_s):
            yield all_mask, expand(all_mask, time_s, ends[turn % len(ends)])
            for pair in pairs if is_near.any() else []:
                yield is_near, expand(is_near, time_s, pair)
        if is_close.any():
            for m, tx in zip(*np.nonzero(transmission.weights[:, transmitters]), strict=True):
                for rx in receivers:
                    yield is_close, expand(is_close, waveform.times_s[m], (transmitters[tx], rx))

    n_fields = 1
    for _, blocks in examine():
        while (
            n_fields <= MAX_FIELDS
            and not truncation_error_powers(blocks, n_fields).sum() <= allowed_error_power
        ):
            n_fields += 1
        if n_fields > MAX_FIELDS:
            break
    else:
        return n_fields, np.zeros(n, bool)
    errors = np.zeros(n)
    for mask, blocks in examine():
        values = truncation_error_powers(blocks, MAX_FIELDS)[: np.count_nonzero(mask)]
        errors[mask] = np.maximum(errors[mask], values)
    return MAX_FIELDS, ~(errors <= allowed_error_power / n)


def _outermost_antenna_indices(antennas_m: np.ndarray, used_indices: list[int]) -> list[int]:
    """Return two antennas with about the largest distance; or the only one."""

    def farthest(antenna: int) -> int:
        return used_indices[
            int(np.argmax(np.linalg.norm(antennas_m[used_indices] - antennas_m[antenna], axis=1)))
        ]

    first = farthest(used_indices[0])
    return list(dict.fromkeys([first, farthest(first)]))


def _near_and_closely_passing_masks(
    path_terms_m: np.ndarray, antennas_m: np.ndarray, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of scatterers in the near field, and of those much closer between the times."""
    centre_m = (antennas_m.min(axis=0) + antennas_m.max(axis=0)) / 2
    radius_m = float(np.linalg.norm(antennas_m - centre_m, axis=1).max())
    powers = range(len(path_terms_m))

    def nearest_distances_m(subset_m: np.ndarray, positions_m: np.ndarray) -> np.ndarray:
        values = np.full(subset_m.shape[2], np.inf)
        for t in times_s:
            time_positions_m = sum(subset_m[k] * t**k for k in powers)
            for position_m in positions_m:
                np.minimum(
                    values,
                    np.linalg.norm(time_positions_m - position_m[:, None], axis=0),
                    out=values,
                )
        return values

    nearest_m = nearest_distances_m(path_terms_m, centre_m[None])
    # Beyond, angles and distances differ by at most an eighth between antennas.
    is_near = nearest_m < 8 * radius_m
    nearest_m -= radius_m
    if is_near.any():
        nearest_m[is_near] = nearest_distances_m(path_terms_m[..., is_near], antennas_m)
    latest_s, apart_s = float(abs(times_s).max()), float(np.diff(times_s).max(initial=0))
    fastest = sum(
        k * latest_s ** (k - 1) * np.linalg.norm(path_terms_m[k], axis=0) for k in powers if k
    )
    # A quarter closer: beyond that, series soon need one field more.
    return is_near, np.asarray(fastest * apart_s / 2 > 0.25 * nearest_m)


def _add_by_direct_kernel(
    out: np.ndarray,
    paths: ScattererPaths,
    transmission: Transmission,
    transmitters: list[int],
    receivers: list[int],
) -> None:
    scatterers = Scatterers(
        paths.path_m.transpose(0, 2, 1),
        paths.amplitudes,
        paths.tx_gains[transmitters],
        paths.rx_gains,
    )
    transmission = transmission._replace(
        tx_m=transmission.tx_m[transmitters], weights=transmission.weights[:, transmitters]
    )
    for rx in receivers:
        receiver_slice = slice(rx, rx + 1)
        direct.add_echoes(
            out[:, receiver_slice],
            scatterers._replace(rx_gains=scatterers.rx_gains[receiver_slice]),
            transmission._replace(rx_m=transmission.rx_m[receiver_slice]),
        )


_compiled = kernel(fastmath={"contract", "reassoc"})


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _spread_tones_of_chirps(
    grid: np.ndarray,
    n_columns: int,
    path_terms_m: np.ndarray,
    n_path_terms: int,
    amplitudes: np.ndarray,
    times_s: np.ndarray,
    weights: np.ndarray,
    half_s: float,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    mid_frequency_hz: float,
    slope_hz_per_s: float,
    retained: np.ndarray,
    column_map: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Add all tones of some chirps to (n_chirps, n_rx, n_fields, n_columns + WIDTH) frequencies."""
    n = amplitudes.shape[2]
    block, work = np.empty(BLOCK), np.zeros(WORK)
    positions, outbound, inbound = split_work_into_positions_and_ranges(work)
    columns, fractions = np.empty(LANES, np.int64), np.empty(LANES, np.float32)
    tones, values = np.empty(4 * LANES, np.float32), np.empty(2 * LANES * len(retained), np.float32)
    taps, unit = np.empty(TAPS, np.float32), np.ones(1, np.float32)
    shifted_m = np.empty((n_path_terms, 3, n))
    # Copies: reference counts of views into shared arrays would be updated by all threads.
    amplitudes, rx_m = amplitudes.copy(), rx_m.copy()
    for m in range(len(times_s)):
        _expand_paths_about_time(path_terms_m, times_s[m], shifted_m)
        for tx in range(len(tx_m)):
            if weights[m, tx] == 0:
                continue
            view = AntennaPairView(
                shifted_m, amplitudes[tx, 0], tx_m[tx], rx_m[0], 0.0, half_s, mid_frequency_hz,
                slope_hz_per_s, True,
            )  # fmt: skip
            shifts = polynomial_time_shift_matrix(view)
            for first in range(0, n, LANES):
                expand_positions_and_outbound_ranges(view, shifts, first, positions, outbound)
                for rx in range(len(rx_m)):
                    expand_inbound_ranges_and_fill_tones(
                        rx_m[rx], amplitudes[tx, rx], first, n_path_terms, mid_frequency_hz,
                        slope_hz_per_s, half_s, True, positions, outbound, inbound, block,
                    )  # fmt: skip
                    spread_tones_onto_frequency_lines(
                        grid, 2 * (m * len(rx_m) + rx) * len(retained) * (n_columns + WIDTH),
                        n_columns, block, min(LANES, n - first), weights[m, tx], retained,
                        column_map, polynomials, columns, fractions, tones, values, taps, unit,
                    )  # fmt: skip


@_compiled
def _expand_paths_about_time(
    path_terms_m: np.ndarray, new_origin_s: float, shifted_terms_m: np.ndarray
) -> None:
    """Fill `shifted_terms_m`, (n_terms, 3, n): the first terms of paths about another time."""
    n = path_terms_m.shape[2]
    for k in range(len(shifted_terms_m)):
        for axis in range(3):
            row = shifted_terms_m[k, axis]
            row[:] = 0.0
            share = 1.0
            for j in range(k, len(path_terms_m)):
                term = path_terms_m[j, axis]
                for i in range(np.uint64(n)):
                    row[i] += share * term[i]
                share *= new_origin_s * (j + 1) / (j + 1 - k)


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def _add_fields_times_time_powers(
    out: np.ndarray,
    chirp_rows: np.ndarray,
    fields: np.ndarray,
    normalised_times: np.ndarray,
    deapodisation: np.ndarray,
) -> None:
    """Add the sum over f of s^f times field f, (n_chirps, n_fields, n_times), to some rows."""
    n_fields = fields.shape[1]
    total = np.empty(len(normalised_times), np.complex64)
    for m in range(len(chirp_rows)):
        for j in range(len(normalised_times)):
            total[j] = deapodisation[j] * fields[m, n_fields - 1, j]
        for f in range(n_fields - 2, -1, -1):
            for j in range(len(normalised_times)):
                total[j] = normalised_times[j] * total[j] + deapodisation[j] * fields[m, f, j]
        for j in range(len(normalised_times)):
            out[chirp_rows[m], j] += total[j]
