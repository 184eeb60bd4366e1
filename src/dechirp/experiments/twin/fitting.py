"""Fit of points to the peaks of a recording.

Echoes of neighbours overlap in each other's cells, so their powers cannot be read off the map one
by one. The contribution of each point to each peak's cell is simulated, and amplitudes and phases
follow from linear equations: at each peak the twin has the recorded power and the phase that fits
best. A phase is a quarter of a wavelength of range at most, far below a cell; positions are
corrected by whole half wavelengths, which leave phases unchanged. Three to eight rounds suffice.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dechirp.core.findings import PhysicsWarning
from dechirp.experiments.twin.echoes import PointEchoes
from dechirp.experiments.twin.measure import (
    FrameMap,
    Peaks,
    channel_spectra_at_cells,
    is_in_searched_rows,
    measure_peaks_near_cells,
    noise_floor_at_rows,
)
from dechirp.radar.radar import Radar
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.simulate import simulate, simulate_ideal_echoes

_N_ROUNDS, _N_TURNS = 12, 3
_SINGLE: np.dtype[np.complexfloating] = np.dtype(np.complex64)
# Share of the error that a round corrects: neighbours move each other's peaks.
_STEP_GAIN, _MAX_STEP_CELLS = 0.7, 0.3  # cells
# Errors at which the fit stops, and rounds without improvement before it gives up.
_POWER_TOLERANCE_DB, _CELL_TOLERANCE, _PATIENCE = 0.1, 0.1, 3
# Singular values below this belong to points that no peak separates.
_RELATIVE_CONDITION = 1e-4
_MAX_AMPLITUDE_STEP = 3.0


def fit_points_to_recorded_peaks(
    recorded: FrameMap,
    start: PointEchoes,
    radar: Radar,
    *,
    constants: Sequence[Impairment] = (),
    progress: Callable[[int, int], None] | None = None,
) -> PointEchoes:
    """Fit points whose echoes, without noise, have the peaks of a map.

    Parameters
    ----------
    recorded : FrameMap
        Samples in sqrt(W).
    start : PointEchoes
        One point for each peak, near its position.
    radar : Radar
        With its hardware.
    constants : sequence of impairments
        Deterministic impairments of the twin besides the points.
    progress : callable, optional
        Called with the number of finished rounds and the maximum number.

    Returns
    -------
    PointEchoes
        Those of `start`, and a second point beside each peak that a single point does not
        reproduce: the rest of a body that is larger than a cell.
    """
    points = start
    for turn in range(_N_TURNS):
        report_round = progress and partial(_report_rounds_over_all_turns, progress, turn)
        points = _iterate_point_fit(recorded, points, radar, constants, report_round)
        others = _second_points_beside_displaced_peaks(recorded, points, radar, constants)
        if not len(others) or turn == _N_TURNS - 1:
            break
        points = points.concatenate(others)
    if progress is not None:
        progress(_N_TURNS * _N_ROUNDS, _N_TURNS * _N_ROUNDS)
    return points


def _report_rounds_over_all_turns(
    progress: Callable[[int, int], None], turn: int, n_rounds_done: int
) -> None:
    progress(turn * _N_ROUNDS + n_rounds_done, _N_TURNS * _N_ROUNDS)


def _iterate_point_fit(
    recorded: FrameMap,
    start: PointEchoes,
    radar: Radar,
    constants: Sequence[Impairment],
    progress: Callable[[int], None] | None,
) -> PointEchoes:
    """Return the points of the round with the smallest maximum error."""
    cells, wanted_power_w = start.map_cell, _recorded_echo_power_w(recorded, start)
    recorded_peaks, recorded_spectrum = (
        measure_peaks_near_cells(recorded, cells),
        channel_spectra_at_cells(recorded, cells),
    )
    is_fitted = start.is_peak & is_in_searched_rows(recorded, cells)
    points, best, least = start, start, np.inf
    twin_spectrum, last = None, 0
    for number in range(_N_ROUNDS):
        if progress is not None:
            progress(number)
        points = _fit_powers_and_phases(
            points, recorded, wanted_power_w, recorded_spectrum, twin_spectrum, radar, constants
        )
        twin = simulate_points_without_noise(points, radar, recorded, constants)
        twin_peaks = measure_peaks_near_cells(twin, cells)
        twin_spectrum = channel_spectra_at_cells(twin, cells)
        errors = _peak_errors_relative_to_tolerance(
            twin_peaks, recorded_peaks, wanted_power_w, is_fitted
        )
        worst = errors[start.is_peak].max(initial=0.0)
        if worst < least:
            best, least, last = points, worst, number
        if least < 1 or number - last >= _PATIENCE:
            break
        points = _shift_points_towards_recorded_peaks(
            points, twin_peaks, recorded_peaks, radar, recorded, is_fitted
        )
    return best


def _recorded_echo_power_w(recorded: FrameMap, echoes: PointEchoes) -> np.ndarray:
    """Return the echo power in each cell, W: the recorded power less its noise."""
    power = recorded.power.values[echoes.map_cell[:, 0], echoes.map_cell[:, 1]].astype(float)
    # At least half of the power counts as echo.
    return np.maximum(power - noise_floor_at_rows(recorded, echoes.map_cell[:, 1]), power / 2)


def _second_points_beside_displaced_peaks(
    recorded: FrameMap, points: PointEchoes, radar: Radar, constants: Sequence[Impairment]
) -> PointEchoes:
    """Add a point beside each displaced peak, in the cell that lacks the most power."""
    twin = simulate_points_without_noise(points, radar, recorded, constants)
    twin_peaks, recorded_peaks = (
        measure_peaks_near_cells(frame_map, points.map_cell) for frame_map in (twin, recorded)
    )
    is_searched = is_in_searched_rows(recorded, points.map_cell)
    is_displaced = (
        _peak_errors_relative_to_tolerance(
            twin_peaks, recorded_peaks, _recorded_echo_power_w(recorded, points), is_searched
        )
        > 1
    )
    is_displaced &= points.is_peak & ~points.is_leakage & is_searched
    peak_indices, (n_velocity, n_rows) = np.flatnonzero(is_displaced), recorded.power.shape
    steps = np.array([(0, 1), (0, -1), (1, 0), (-1, 0)])
    around = points.map_cell[peak_indices][:, None] + steps
    around[..., 0] %= n_velocity
    around[..., 1] = around[..., 1].clip(0, n_rows - 1)
    flat = around.reshape(-1, 2)
    missing = (
        abs(channel_spectra_at_cells(recorded, flat) - channel_spectra_at_cells(twin, flat)) ** 2
    )
    best = missing.sum(axis=1).reshape(len(peak_indices), len(steps)).argmax(axis=1)
    cells = around[np.arange(len(peak_indices)), best]
    occupied = {tuple(cell) for cell in points.map_cell.tolist()}
    free = np.array([tuple(cell) not in occupied for cell in cells.tolist()], dtype=bool)
    cells, step = cells[free], steps[best[free]]
    others = replace(
        points.select_points(*peak_indices[free].tolist()),
        is_peak=np.zeros(len(cells), dtype=bool),
        map_cell=cells,
    )
    per_slow, per_fast = _velocity_and_range_per_cell(radar, recorded)
    others = others.shift_in_range_and_velocity(
        range_m=step[:, 1] * per_fast, velocity_m_per_s=step[:, 0] * per_slow
    )
    return replace(others, power_w=_recorded_echo_power_w(recorded, others))


def simulate_points_without_noise(
    echoes: PointEchoes, radar: Radar, recorded: FrameMap, constants: Sequence[Impairment]
) -> FrameMap:
    """Simulate one frame of points without noise, processed as the recording."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)  # reported for the final twin only
        cube = simulate(
            echoes.targets_as_scene(radar),
            radar,
            impairments=[*echoes.leakage_impairments(radar), *constants],
        )
    return FrameMap(samples=cube.isel(frame=0), radar=radar, chain=recorded.chain)


def _simulate_single_point(point: PointEchoes, radar: Radar, recorded: FrameMap) -> FrameMap:
    """Simulate the frame of one point; these frames take most of the computing time."""
    if point.is_leakage.any():
        return simulate_points_without_noise(point, radar, recorded, ())
    cube = simulate_ideal_echoes(point.targets_as_scene(radar), radar, dtype=_SINGLE)
    return FrameMap(samples=cube.isel(frame=0), radar=radar, chain=recorded.chain)


def _fit_powers_and_phases(
    echoes: PointEchoes,
    recorded: FrameMap,
    power_w: np.ndarray,
    recorded_spectrum: np.ndarray,
    twin_spectrum: np.ndarray | None,
    radar: Radar,
    constants: Sequence[Impairment],
) -> PointEchoes:
    """Fit powers and phases of the points to the peaks.

    `twin_spectrum` is the previous twin in the cells, (n, channel); None: each point alone.
    """
    (n, n_channels), cells = recorded_spectrum.shape, echoes.map_cell
    point_spectra = np.stack(
        [
            channel_spectra_at_cells(
                _simulate_single_point(echoes.select_points(k), radar, recorded), cells
            )
            for k in range(n)
        ]
    )
    constant_spectrum = np.zeros_like(recorded_spectrum)
    if constants:
        constant_spectrum = channel_spectra_at_cells(
            simulate_points_without_noise(echoes.select_points(), radar, recorded, constants), cells
        )
    # Recorded channels deviate from those of ideal points. So each peak gets the recorded power,
    # distributed over the channels as in the twin, at the best phase.
    shape = point_spectra[np.arange(n), np.arange(n)] if twin_spectrum is None else twin_spectrum
    norm = np.linalg.norm(shape, axis=1)
    phase = np.exp(1j * np.angle(np.sum(recorded_spectrum * shape.conj(), axis=1)))
    wanted_spectrum = (np.sqrt(power_w * n_channels) / norm * phase)[
        :, None
    ] * shape - constant_spectrum
    weights = np.repeat(1 / np.sqrt(power_w), n_channels)
    matrix = weights[:, None] * point_spectra.reshape(n, -1).T
    largest = np.linalg.norm(matrix, axis=0)
    factors, *_ = np.linalg.lstsq(
        matrix / largest, weights * wanted_spectrum.ravel(), rcond=_RELATIVE_CONDITION
    )
    factors = factors / largest
    gain = np.clip(np.abs(factors), 1 / _MAX_AMPLITUDE_STEP, _MAX_AMPLITUDE_STEP)
    scaled = replace(echoes, power_w=echoes.power_w * gain**2)
    range_shift_m = np.angle(factors) * radar.frame.chirp.wavelength_m / (4 * np.pi)
    return scaled.shift_in_range_and_velocity(range_m=range_shift_m, velocity_m_per_s=np.zeros(n))


def _shift_points_towards_recorded_peaks(
    echoes: PointEchoes,
    twin_peaks: Peaks,
    recorded_peaks: Peaks,
    radar: Radar,
    recorded: FrameMap,
    is_fitted: np.ndarray,
) -> PointEchoes:
    """Shift points so that their peaks approach the recorded ones."""
    per_slow, per_fast = _velocity_and_range_per_cell(radar, recorded)
    slow, fast = (
        _STEP_GAIN * np.clip(missing, -_MAX_STEP_CELLS, _MAX_STEP_CELLS) * is_fitted
        for missing in (
            recorded_peaks.velocity_bin - twin_peaks.velocity_bin,
            recorded_peaks.range_bin - twin_peaks.range_bin,
        )
    )
    half_m = radar.frame.chirp.wavelength_m / 2
    return echoes.shift_in_range_and_velocity(
        range_m=np.round(fast * per_fast / half_m) * half_m, velocity_m_per_s=slow * per_slow
    )


def _velocity_and_range_per_cell(radar: Radar, recorded: FrameMap) -> tuple[float, float]:
    """Return the steps of the map in velocity, m/s, and range, m; 0 in velocity for one chirp."""
    frame, chirp, noise = radar.frame, radar.frame.chirp, recorded.chain.map_noise_statistics(radar)
    span = chirp.wavelength_m / 2 / frame.repetition_s if frame.can_measure_velocity else 0.0
    span_m = chirp.range_m(1.0) * chirp.sample_rate_hz
    return span / noise.doppler_transform.n_bins, span_m / noise.range_transform.n_bins


def _peak_errors_relative_to_tolerance(
    twin_peaks: Peaks, recorded_peaks: Peaks, wanted_power_w: np.ndarray, is_searched: np.ndarray
) -> np.ndarray:
    """Return the largest error of each peak, relative to its tolerance.

    Peaks outside the searched rows have a power only: about 0, the mirror image of real samples
    moves them.
    """
    level_error_db = abs(10 * np.log10(np.maximum(twin_peaks.power, 1e-300) / wanted_power_w))
    distance_cells = np.maximum(
        abs(twin_peaks.velocity_bin - recorded_peaks.velocity_bin),
        abs(twin_peaks.range_bin - recorded_peaks.range_bin),
    )
    distance_cells = np.where(is_searched, distance_cells, 0.0)
    return np.asarray(
        np.maximum(level_error_db / _POWER_TOLERANCE_DB, distance_cells / _CELL_TOLERANCE)
    )
