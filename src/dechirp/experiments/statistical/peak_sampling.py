"""Sampling of peaks from their distribution, without computing a map.

About every scatterer the cells that its peak may be in contain the sum of all scatterers near it,
and noise with the covariance of the transforms; so do the sums from which its frequencies and
amplitudes are estimated, see `axis_statistics`. The highest of these cells is a peak where none
beside it is higher, and a detection where it exceeds a threshold that is drawn from the law of its
training window, raised by the echoes of other targets in the window. False alarms are cells whose
noise is drawn over the threshold; those that a neighbour exceeds are no peaks, as in a map.
Sidelobes are rejected as in `processing.peaks`.
"""

from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.experiments.statistical.axis_statistics import (
    N_OFFSETS,
    N_SUMS,
    POINTS_PER_BIN,
    REFINEMENT_BINS,
    AxisStatistics,
    LobeEnergy,
)

# Mean power of noise in a cell.
_MEAN_NOISE = 1.0
# Echo power in a cell above which an alarm counts as the detection of a target.
_MIN_TARGET_POWER = 0.5
# Unpadded bins on both axes within which two tones form one peak.
_MERGING_BINS = 0.75
# Ratio to the threshold above which only the estimates need noise, not the cells.
_CERTAIN_RATIO = 10.0
# Cells from a scatterer to the peak that it forms with others, and steps of refinement from there.
_MAX_MOVES, _MORE_STEPS = 8, 2
# Unpadded bins within which the amplitudes of tones add coherently.
_COHERENT_BINS = 4.0


class TrainingWindows(NamedTuple):
    """Training windows of the detector: their law, and their positions."""

    statistic: np.ndarray
    """(n_draws,), this and the next two as in `training_statistics.TrainingStatistics`."""
    corners: np.ndarray
    sensitivity: float
    factors: np.ndarray
    """(n_rows,), threshold over statistic; infinite in rows that are not searched."""
    n_training: np.ndarray
    """(n_rows,) cells in the window."""
    shifts: np.ndarray
    """(n_rows,): offset of the centre of the window from the row under test."""
    box: tuple[LobeEnergy, LobeEnergy]
    """Of velocity and range."""
    guard: tuple[LobeEnergy, LobeEnergy]
    sidelobes: tuple[np.ndarray, np.ndarray]
    """`processing.peaks.sidelobe_envelope` of both axes."""


class NoiseAlarms(NamedTuple):
    """Noise cells over threshold, frame by frame."""

    first: np.ndarray
    """(n_frames + 1,): first index of each frame."""
    cells: np.ndarray
    """(n, 2), velocity and range."""
    power: np.ndarray
    """(n,), over the mean of noise."""
    window_draw: np.ndarray
    """(n,): index of the draw of the training window."""


class SampledPeaks(NamedTuple):
    """Peaks of all frames, (n,), strongest first in each; noise powers are 1."""

    frame: np.ndarray
    """Frame number, from the first frame of the block."""
    slow: np.ndarray
    """Radians per chirp, from the first bin."""
    fast: np.ndarray
    """Radians per sample."""
    noise: np.ndarray
    """Measured noise: its mean is 1."""
    amplitude: np.ndarray
    """(n, n_channels) complex64: |.|^2 is a ratio."""


class FrameEchoes(NamedTuple):
    """Echoes of each frame and scatterer, (n_frames, n_scatterers): see `ReceivedEchoes`."""

    velocity: np.ndarray
    row: np.ndarray
    amplitude: np.ndarray
    """(..., n_channels) complex64, as drawn for each frame."""
    in_cells: np.ndarray
    powers: np.ndarray
    """Power in the cell of each, mean over channels, relative to that of noise."""
    has_peak: np.ndarray
    """bool: whether it is strong enough to form a peak."""


def max_normal_numbers_per_candidate(
    axes: tuple[AxisStatistics, AxisStatistics], n_channels: int
) -> int:
    """Return the maximum number of normal numbers that one candidate needs."""
    over_velocity, over_range = (axis.factors.shape[1] for axis in axes)
    return 2 * n_channels * over_velocity * over_range


@kernel(plain=AS_WRITTEN)
def _circular_difference(a: float, b: float, n_bins: float) -> float:
    """Return the shorter signed difference a - b modulo n bins."""
    difference = a - b
    if difference > n_bins / 2:
        difference -= n_bins
    elif difference < -n_bins / 2:
        difference += n_bins
    return difference


@kernel(plain=AS_WRITTEN)
def _interpolated_lobe_amplitude(axis: AxisStatistics, offset: float) -> complex:
    position = (
        (offset + axis.reach) * ((axis.lobe.size - 1) / (2 * axis.reach)) if axis.reach else 0.0
    )
    if position < 0 or position > axis.lobe.size - 1:
        return 0j
    low = min(int(position), max(axis.lobe.size - 2, 0))
    if axis.lobe.size == 1:
        return axis.lobe[0]
    fraction = position - low
    return axis.lobe[low] * (1 - fraction) + axis.lobe[low + 1] * fraction


@kernel(plain=AS_WRITTEN)
def _interpolated_tone_moment(axis: AxisStatistics, order: int, offset: float) -> float:
    position = (offset + REFINEMENT_BINS) * POINTS_PER_BIN
    low = min(max(int(position), 0), axis.moments.shape[1] - 2)
    fraction = position - low
    return axis.moments[order, low] * (1 - fraction) + axis.moments[order, low + 1] * fraction


@kernel(plain=AS_WRITTEN)
def _tabulated_lobe_energy(energy_table: LobeEnergy, offset: float) -> float:
    if energy_table.table.size == 1:
        return energy_table.table[0]
    position = (offset + energy_table.reach) * (
        (energy_table.table.size - 1) / (2 * energy_table.reach)
    )
    if position < 0 or position > energy_table.table.size - 1:
        return 0.0
    return energy_table.table[int(position + 0.5)]


class Workspace(NamedTuple):
    """Buffers reused for all candidates."""

    cells: np.ndarray
    """Signals in the cells that its peak may be in, and one more on each side: real and imaginary
    parts, (2, n_velocity, n_range, n_channels) float32."""
    echo_power: np.ndarray
    """Their powers, mean over channels."""
    sums: np.ndarray
    """(6, n_channels): of 1, p, q, pp, pq and qq, each normalised, p over chirps."""
    cell_noise: np.ndarray
    """(n_channels, n_velocity, n_range): noise in the cells that its peak may be in."""
    power: np.ndarray
    """Power of signal plus noise."""


_FAST = {"contract", "reassoc"}


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def sample_peaks(
    echoes: FrameEchoes,
    over_velocity: AxisStatistics,
    over_range: AxisStatistics,
    windows: TrainingWindows,
    alarms: NoiseAlarms,
    searched: np.ndarray,
    window_draws: np.ndarray,
    white: np.ndarray,
) -> SampledPeaks:
    """Sample the peaks of a block of frames.

    Parameters
    ----------
    echoes, over_velocity, over_range, windows, alarms
        Echoes, tables of the axes, training windows and noise cells over threshold.
    searched : bool array (n_velocity, n_rows)
        Cells in which a peak may be.
    window_draws : array (n_candidates,)
        Index of the draw of the training window for each candidate.
    white : float32 array (n_candidates + n_alarms, n)
        Normal numbers of each.
    """
    n_frames, n_scatterers, n_channels = echoes.amplitude.shape
    size_v, size_r = 2 * over_velocity.half_width + 1, 2 * over_range.half_width + 1
    n_most = len(window_draws) + len(alarms.window_draw)
    out_frame, out = np.empty(n_most, np.int64), np.empty((n_most, 5))
    out_cell = np.empty((n_most, 2), np.int64)
    out_amplitude = np.empty((n_most, n_channels), np.complex64)
    work = Workspace(
        np.empty((2, size_v + 2, size_r + 2, n_channels), np.float32),
        np.empty((size_v + 2, size_r + 2)),
        np.empty((6, n_channels), np.complex128),
        np.empty((n_channels, size_v, size_r), np.complex128),
        np.empty((size_v, size_r)),
    )
    n_out, n_own = 0, 0
    for f in range(n_frames):
        first_out = n_out
        for c in range(n_scatterers):
            if not echoes.has_peak[f, c]:
                continue
            n_own += 1
            if _is_merged_with_stronger_echo(echoes, f, c, over_velocity, over_range):
                continue
            position = echoes.velocity[f, c], echoes.row[f, c]
            n_out += _try_sampling_detection_at_position(
                echoes, f, position, 0.0, window_draws[n_own - 1], white[n_own - 1],
                over_velocity, over_range, windows, searched, out_cell[first_out:n_out], work,
                out[n_out], out_cell[n_out], out_amplitude[n_out],
            )  # fmt: skip
        for c in range(alarms.first[f], alarms.first[f + 1]):
            position = float(alarms.cells[c, 0]), float(alarms.cells[c, 1])
            n_out += _try_sampling_detection_at_position(
                echoes, f, position, alarms.power[c], alarms.window_draw[c],
                white[len(window_draws) + c], over_velocity, over_range, windows, searched,
                out_cell[first_out:n_out], work, out[n_out], out_cell[n_out], out_amplitude[n_out],
            )  # fmt: skip
        frame_rows = slice(first_out, n_out)
        accepted = first_out + _indices_of_peaks_without_sidelobes(
            out[frame_rows, 3],
            out[frame_rows, 4],
            out_cell[frame_rows],
            windows,
            over_velocity.n_bins,
            over_range.n_bins,
        )
        n_out = first_out + len(accepted)
        out_frame[first_out:n_out] = f
        out[first_out:n_out] = out[accepted]
        out_amplitude[first_out:n_out] = out_amplitude[accepted]
    return SampledPeaks(
        out_frame[:n_out],
        out[:n_out, 0].copy(),
        out[:n_out, 1].copy(),
        out[:n_out, 2].copy(),
        out_amplitude[:n_out],
    )


@kernel(plain=AS_WRITTEN)
def _is_merged_with_stronger_echo(
    echoes: FrameEchoes,
    frame: int,
    scatterer: int,
    over_velocity: AxisStatistics,
    over_range: AxisStatistics,
) -> bool:
    """Return whether a stronger scatterer is in the same cell: both form one peak."""
    for j in range(echoes.powers.shape[1]):
        away_v = _circular_difference(
            echoes.velocity[frame, j], echoes.velocity[frame, scatterer], over_velocity.n_bins
        )
        away_r = _circular_difference(
            echoes.row[frame, j], echoes.row[frame, scatterer], over_range.n_bins
        )
        if (
            abs(away_v) * over_velocity.unpadded_per_bin < _MERGING_BINS
            and abs(away_r) * over_range.unpadded_per_bin < _MERGING_BINS
        ):
            more = echoes.powers[frame, j] - echoes.powers[frame, scatterer]
            if more > 0 or (more == 0 and j < scatterer):
                return True
    return False


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def _try_sampling_detection_at_position(
    echoes: FrameEchoes,
    frame: int,
    position: tuple[float, float],
    alarm_power: float,
    window_draw: int,
    normal_numbers: np.ndarray,
    over_velocity: AxisStatistics,
    over_range: AxisStatistics,
    windows: TrainingWindows,
    searched: np.ndarray,
    earlier_cells: np.ndarray,
    work: Workspace,
    out: np.ndarray,
    out_cell: np.ndarray,
    out_amplitude: np.ndarray,
) -> bool:
    """Sample the cells about a position in a frame; return whether they hold a detection.

    `alarm_power`: the power of a noise cell over threshold; 0 about a scatterer. `earlier_cells`:
    peaks of the frame so far, (n, 2). `out`: frequencies of both axes, measured noise, amplitudes
    of the peak in the map and of its threshold.
    """
    half_v, half_r = over_velocity.half_width, over_range.half_width
    echo_power, power = work.echo_power, work.power
    position, n_moves, window_power, is_certain = _fill_cells_about_peak(
        echoes, frame, position, bool(alarm_power), over_velocity, over_range, windows,
        earlier_cells, work,
    )  # fmt: skip
    cell_v, cell_r = int(np.floor(position[0] + 0.5)), int(np.floor(position[1] + 0.5))
    row = min(max(cell_r, 0), windows.factors.size - 1)
    if (alarm_power and echo_power[half_v + 1, half_r + 1] > _MIN_TARGET_POWER) or (
        n_moves and _is_in_cells(position, earlier_cells, over_velocity.n_bins, over_range.n_bins)
    ):
        return False
    if is_certain:
        _add_noise_to_estimator_sums(normal_numbers, work.sums)
    else:
        table_v = over_velocity.factors[int((position[0] - cell_v + 0.5) * N_OFFSETS + 0.5)]
        table_r = over_range.factors[int((position[1] - cell_r + 0.5) * N_OFFSETS + 0.5)]
        _draw_correlated_cell_noise(normal_numbers, table_v, table_r, work.sums, work.cell_noise)
        if alarm_power:
            _scale_noise_to_alarm_power(
                alarm_power,
                over_velocity.centre_covariance,
                over_range.centre_covariance,
                work.sums,
                work.cell_noise,
            )
        _fill_channel_mean_power_with_noise(work.cells, work.cell_noise, power)
    top_v, top_r = divmod(np.argmax(power), power.shape[1])
    top = power[top_v, top_r]
    if (
        alarm_power and (top_v != half_v or top_r != half_r)
    ) or _has_higher_cell_beside_sampled_ones(top, echo_power, top_v, top_r):
        return False
    peak_v = (cell_v + top_v - half_v) % over_velocity.n_bins
    # Range bins of complex samples are cyclic.
    peak_r = (cell_r + top_r - half_r) % over_range.n_bins
    if peak_r >= windows.factors.size or not searched[peak_v, peak_r]:
        return False
    level = (
        windows.statistic[window_draw]
        + windows.sensitivity * window_power / windows.n_training[row]
    )
    threshold = windows.factors[peak_r] * level
    if not top > threshold:
        return False
    step_v, step_r = _refine_peak_by_newton_step(
        work.sums, over_velocity.n_bins == 1, out_amplitude
    )
    for _ in range(_MORE_STEPS if n_moves else 0):  # the cell is up to half a bin from the peak
        position = (
            position[0] + step_v / over_velocity.rms_index * over_velocity.n_bins / (2 * np.pi),
            position[1] + step_r / over_range.rms_index * over_range.n_bins / (2 * np.pi),
        )
        step_v, step_r = _refine_peak_at_position(
            echoes, frame, position, normal_numbers, over_velocity, over_range, windows, work,
            out_amplitude,
        )  # fmt: skip
    # Noise alone at the threshold has this energy without a window, in the mean: the window
    # correlates cell and tone by one over its noise bandwidth.
    bandwidth = over_velocity.noise_bandwidth * over_range.noise_bandwidth
    least_energy = len(out_amplitude) * (1 + (threshold - _MEAN_NOISE) / bandwidth)
    if not alarm_power and np.sum(np.abs(out_amplitude) ** 2) < least_energy:
        # Scatterers cancel at the strongest one: the peak is beside it, where processing starts.
        position = float(cell_v + top_v - half_v), float(cell_r + top_r - half_r)
        step_v, step_r = _refine_peak_at_position(
            echoes, frame, position, normal_numbers, over_velocity, over_range, windows, work,
            out_amplitude,
        )  # fmt: skip
        if np.sum(np.abs(out_amplitude) ** 2) < least_energy:
            return False
    out[0] = 2 * np.pi * position[0] / over_velocity.n_bins + step_v / over_velocity.rms_index
    out[1] = 2 * np.pi * position[1] / over_range.n_bins + step_r / over_range.rms_index
    out[2] = windows.corners[window_draw]
    out[3], out[4] = np.sqrt(top), np.sqrt(threshold)
    out_cell[0], out_cell[1] = peak_v, peak_r
    return True


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def _fill_cells_about_peak(
    echoes: FrameEchoes,
    frame: int,
    position: tuple[float, float],
    is_alarm: bool,
    over_velocity: AxisStatistics,
    over_range: AxisStatistics,
    windows: TrainingWindows,
    earlier_cells: np.ndarray,
    work: Workspace,
) -> tuple[tuple[float, float], int, float, bool]:
    """Fill the cells about a position, or about the peak beside it where echoes are strong.

    Scatterers of a body add up to a peak beside the strongest of them: from cell to cell, the
    position climbs to it, or to the first of `earlier_cells`.

    Returns the position, the number of moves, the power in the training window, and whether the
    echoes exceed any threshold without noise.
    """
    half_v, half_r = over_velocity.half_width, over_range.half_width
    echo_power, power = work.echo_power, work.power
    n_moves, window_power, is_certain = 0, 0.0, False
    while True:
        cell_v, cell_r = int(np.floor(position[0] + 0.5)), int(np.floor(position[1] + 0.5))
        row = min(max(cell_r, 0), windows.factors.size - 1)
        window_power = _fill_cell_signals_and_sum_window_power(
            echoes, frame, position, over_velocity, over_range, windows, work.cells, work.sums
        )
        _fill_channel_mean_power(work.cells, echo_power)
        power[:] = echo_power[1:-1, 1:-1] + _MEAN_NOISE
        top_v, top_r = divmod(np.argmax(power), power.shape[1])
        is_certain = not is_alarm and power[top_v, top_r] > _CERTAIN_RATIO * windows.factors[row]
        if not is_certain or (top_v == half_v and top_r == half_r) or n_moves == _MAX_MOVES:
            break
        n_moves += 1
        position = float(cell_v + top_v - half_v), float(cell_r + top_r - half_r)
        if _is_in_cells(position, earlier_cells, over_velocity.n_bins, over_range.n_bins):
            break
    return position, n_moves, window_power, is_certain


@kernel(plain=AS_WRITTEN)
def _is_in_cells(position: tuple[float, float], cells: np.ndarray, n_v: int, n_r: int) -> bool:
    """Return whether a position is the centre of one of cells, (n, 2)."""
    for k in range(len(cells)):
        if cells[k, 0] == position[0] % n_v and cells[k, 1] == position[1] % n_r:
            return True
    return False


@kernel(plain=AS_WRITTEN)
def _refine_peak_at_position(
    echoes: FrameEchoes,
    frame: int,
    position: tuple[float, float],
    normal_numbers: np.ndarray,
    over_velocity: AxisStatistics,
    over_range: AxisStatistics,
    windows: TrainingWindows,
    work: Workspace,
    out_amplitude: np.ndarray,
) -> tuple[float, float]:
    """Refine a peak from a position, see `_refine_peak_by_newton_step`."""
    _fill_cell_signals_and_sum_window_power(
        echoes, frame, position, over_velocity, over_range, windows, work.cells, work.sums
    )
    _add_noise_to_estimator_sums(normal_numbers, work.sums)
    return _refine_peak_by_newton_step(work.sums, over_velocity.n_bins == 1, out_amplitude)


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def _fill_cell_signals_and_sum_window_power(
    echoes: FrameEchoes,
    frame: int,
    position: tuple[float, float],
    over_velocity: AxisStatistics,
    over_range: AxisStatistics,
    windows: TrainingWindows,
    cells: np.ndarray,
    sums: np.ndarray,
) -> float:
    """Add the echoes of all scatterers to cells and sums; return their power in the window."""
    n_v, n_r = over_velocity.n_bins, over_range.n_bins
    cell_v, cell_r = np.floor(position[0] + 0.5), np.floor(position[1] + 0.5)
    row = min(max(int(cell_r), 0), windows.factors.size - 1)
    shift = windows.shifts[row]
    reach_v = min(_COHERENT_BINS / over_velocity.unpadded_per_bin, over_velocity.reach)
    reach_r = min(_COHERENT_BINS / over_range.unpadded_per_bin, over_range.reach)
    amplitude_scale = 1 / np.sqrt(over_velocity.noise_bandwidth * over_range.noise_bandwidth)
    _, n_rows, n_columns, n_channels = cells.shape
    lobes_v, lobes_r = np.empty(n_rows, np.complex128), np.empty(n_columns, np.complex128)
    amplitude = echoes.amplitude[frame].view(np.float32)
    cells[:], sums[:] = 0, 0
    window_power = 0.0
    for j in range(len(amplitude)):
        away_v = _circular_difference(echoes.velocity[frame, j], cell_v, n_v)
        away_r = _circular_difference(echoes.row[frame, j], cell_r, n_r)
        if abs(away_v) <= windows.box[0].reach and abs(away_r) <= windows.box[1].reach + abs(shift):
            box_energy = _tabulated_lobe_energy(windows.box[0], away_v) * _tabulated_lobe_energy(
                windows.box[1], away_r - shift
            )
            guard_energy = _tabulated_lobe_energy(
                windows.guard[0], away_v
            ) * _tabulated_lobe_energy(windows.guard[1], away_r)
            window_power += echoes.powers[frame, j] * max(box_energy - guard_energy, 0.0)
        if abs(away_v) > reach_v or abs(away_r) > reach_r:
            continue
        for a in range(n_rows):
            lobes_v[a] = _interpolated_lobe_amplitude(over_velocity, away_v - (a - n_rows // 2))
        for b in range(n_columns):
            lobes_r[b] = _interpolated_lobe_amplitude(over_range, away_r - (b - n_columns // 2))
        for a in range(n_rows):
            for b in range(n_columns):
                both = echoes.in_cells[frame, j] * amplitude_scale * lobes_v[a] * lobes_r[b]
                re, im = np.float32(both.real), np.float32(both.imag)
                for k in range(n_channels):
                    x, y = amplitude[j, 2 * k], amplitude[j, 2 * k + 1]
                    cells[0, a, b, k] += re * x - im * y
                    cells[1, a, b, k] += re * y + im * x
        near_v = (echoes.velocity[frame, j] - position[0] + n_v / 2) % n_v - n_v / 2
        near_r = (echoes.row[frame, j] - position[1] + n_r / 2) % n_r - n_r / 2
        near_v, near_r = (
            near_v * over_velocity.unpadded_per_bin,
            near_r * over_range.unpadded_per_bin,
        )
        if abs(near_v) < REFINEMENT_BINS and abs(near_r) < REFINEMENT_BINS:
            v0, v1 = (
                _interpolated_tone_moment(over_velocity, 0, near_v),
                _interpolated_tone_moment(over_velocity, 1, near_v),
            )
            r0, r1 = (
                _interpolated_tone_moment(over_range, 0, near_r),
                _interpolated_tone_moment(over_range, 1, near_r),
            )
            v2, r2 = (
                _interpolated_tone_moment(over_velocity, 2, near_v),
                _interpolated_tone_moment(over_range, 2, near_r),
            )
            for k in range(n_channels):
                z = echoes.amplitude[frame, j, k]
                sums[0, k] += z * (v0 * r0)
                sums[1, k] += z * (1j * v1 * r0)
                sums[2, k] += z * (1j * v0 * r1)
                sums[3, k] += z * (v2 * r0)
                sums[4, k] += z * (-v1 * r1)
                sums[5, k] += z * (v0 * r2)
    return window_power


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def _fill_channel_mean_power(cell_signals: np.ndarray, cell_power: np.ndarray) -> None:
    """Compute the mean power over channels in each cell."""
    n_channels = cell_signals.shape[3]
    for a in range(cell_power.shape[0]):
        for b in range(cell_power.shape[1]):
            total = 0.0
            for k in range(n_channels):
                total += cell_signals[0, a, b, k] ** 2 + cell_signals[1, a, b, k] ** 2
            cell_power[a, b] = total / n_channels


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def _fill_channel_mean_power_with_noise(
    cell_signals: np.ndarray, cell_noise: np.ndarray, cell_power: np.ndarray
) -> None:
    """Compute the mean power over channels in each cell, including noise."""
    for a in range(cell_power.shape[0]):
        for b in range(cell_power.shape[1]):
            total = 0.0
            for k in range(len(cell_noise)):
                z = cell_noise[k, a, b]
                x, y = (
                    cell_signals[0, a + 1, b + 1, k] + z.real,
                    cell_signals[1, a + 1, b + 1, k] + z.imag,
                )
                total += x * x + y * y
            cell_power[a, b] = total / len(cell_noise)


@kernel(plain=AS_WRITTEN)
def _add_noise_to_estimator_sums(normal_numbers: np.ndarray, sums: np.ndarray) -> None:
    """Add noise to the sums alone; that of their second moments is neglected."""
    half = np.sqrt(0.5)
    for k in range(sums.shape[1]):
        channel_numbers = normal_numbers[6 * k : 6 * k + 6] * half
        z = complex(channel_numbers[0], channel_numbers[1])
        sums[0, k] += z
        sums[3, k] += z
        sums[5, k] += z
        sums[1, k] += complex(channel_numbers[2], channel_numbers[3])
        sums[2, k] += complex(channel_numbers[4], channel_numbers[5])


@kernel(plain=AS_WRITTEN, fastmath=_FAST)
def _draw_correlated_cell_noise(
    normal_numbers: np.ndarray,
    velocity_factor: np.ndarray,
    range_factor: np.ndarray,
    sums: np.ndarray,
    cell_noise: np.ndarray,
) -> None:
    """Draw the noise in cells, and add its part to the sums."""
    n_v, n_r = len(velocity_factor), len(range_factor)
    white = normal_numbers.view(np.complex64).reshape(sums.shape[1], n_v, n_r)
    half_way, noise = np.empty((n_v, n_r), np.complex128), np.empty((n_v, n_r), np.complex128)
    for k in range(sums.shape[1]):
        for m in range(n_v):
            for n in range(n_r):
                z = 0j
                for i in range(n + 1):
                    z += white[k, m, i] * range_factor[n, i]
                half_way[m, n] = z * np.sqrt(0.5)
        for m in range(n_v):
            for n in range(n_r):
                z = 0j
                for i in range(m + 1):
                    z += velocity_factor[m, i] * half_way[i, n]
                noise[m, n] = z
        cell_noise[k] = noise[N_SUMS:, N_SUMS:]
        _add_noise_to_sums_of_channel(sums, k, noise)


@kernel(plain=AS_WRITTEN)
def _add_noise_to_sums_of_channel(sums: np.ndarray, channel: int, noise: np.ndarray) -> None:
    sums[0, channel] += noise[0, 0]
    sums[1, channel] += noise[1, 0]
    sums[2, channel] += noise[0, 1]
    sums[3, channel] += noise[2, 0]
    sums[4, channel] += noise[1, 1]
    sums[5, channel] += noise[0, 2]


@kernel(plain=AS_WRITTEN)
def _scale_noise_to_alarm_power(
    alarm_power: float,
    velocity_covariance: np.ndarray,
    range_covariance: np.ndarray,
    sums: np.ndarray,
    cell_noise: np.ndarray,
) -> None:
    """Scale the noise of the centre cell to a power, and all correlated noise with it."""
    n_channels, size_v, size_r = cell_noise.shape
    middle = cell_noise[:, size_v // 2, size_r // 2].copy()
    sampled_power = np.sum(np.abs(middle) ** 2)
    excess_gain = np.sqrt(n_channels * alarm_power / sampled_power) - 1
    correlation = np.outer(velocity_covariance, range_covariance)
    for k in range(n_channels):
        more = excess_gain * middle[k] * correlation
        cell_noise[k] += more[N_SUMS:, N_SUMS:]
        _add_noise_to_sums_of_channel(sums, k, more)


@kernel(plain=AS_WRITTEN)
def _has_higher_cell_beside_sampled_ones(
    peak_power: float, echo_power: np.ndarray, peak_v: int, peak_r: int
) -> bool:
    """Return whether a cell beside the sampled ones is higher: one of another target."""
    for a in range(peak_v, peak_v + 3):
        for b in range(peak_r, peak_r + 3):
            is_inside = 0 < a < echo_power.shape[0] - 1 and 0 < b < echo_power.shape[1] - 1
            if not is_inside and echo_power[a, b] + _MEAN_NOISE > peak_power:
                return True
    return False


@kernel(plain=AS_WRITTEN)
def _refine_peak_by_newton_step(
    sums: np.ndarray, has_one_chirp: bool, out_amplitude: np.ndarray
) -> tuple[float, float]:
    """Refine the offset of a peak, in units of 1 / spread; fill in the amplitudes there.

    A Newton step on the logarithm of the summed periodogram, as in `processing.refine`.
    """
    up_v, up_r, vv, vr, rr, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(sums.shape[1]):
        conjugate = np.conj(sums[0, k])
        total += abs(sums[0, k]) ** 2
        up_v += (conjugate * sums[1, k]).imag
        up_r += (conjugate * sums[2, k]).imag
        vv += abs(sums[1, k]) ** 2 - (conjugate * sums[3, k]).real
        vr += (np.conj(sums[1, k]) * sums[2, k] - conjugate * sums[4, k]).real
        rr += abs(sums[2, k]) ** 2 - (conjugate * sums[5, k]).real
    vv -= 2 * up_v**2 / total
    vr -= 2 * up_v * up_r / total
    rr -= 2 * up_r**2 / total
    if has_one_chirp:
        vv = -1.0
    determinant = vv * rr - vr * vr
    step_v = -(rr * up_v - vr * up_r) / determinant
    step_r = -(vv * up_r - vr * up_v) / determinant
    # Half a bin is pi / N, and p / spread runs to the root of 3: 0.9.
    if not (vv < 0 and determinant > 0) or max(abs(step_v), abs(step_r)) > 0.9:
        step_v, step_r = up_v / total, up_r / total
        longest = max(abs(step_v), abs(step_r), 0.9) / 0.9
        step_v, step_r = step_v / longest, step_r / longest
    power = 0.0
    for k in range(sums.shape[1]):
        z = sums[0, k] - 1j * (step_v * sums[1, k] + step_r * sums[2, k])
        z -= (step_v**2 * sums[3, k] + step_r**2 * sums[5, k]) / 2 + step_v * step_r * sums[4, k]
        power += abs(z) ** 2
        out_amplitude[k] = z
    # The logarithm is parabolic over a wider interval than the amplitudes.
    out_amplitude *= np.sqrt(total * np.exp((up_v * step_v + up_r * step_r) / total) / power)
    return step_v, step_r


@kernel(plain=AS_WRITTEN)
def _indices_of_peaks_without_sidelobes(
    peak_amplitude: np.ndarray,
    threshold: np.ndarray,
    cell: np.ndarray,
    windows: TrainingWindows,
    n_v: int,
    n_r: int,
) -> np.ndarray:
    """Return the indices of peaks, strongest first, without neighbours and sidelobes of others."""
    accepted = np.empty(len(peak_amplitude), np.int64)
    n_accepted = 0
    for i in np.argsort(-peak_amplitude):
        keep = True
        for k in accepted[:n_accepted]:
            dv, dr = abs(cell[i, 0] - cell[k, 0]), abs(cell[i, 1] - cell[k, 1])
            dv, dr = min(dv, n_v - dv), min(dr, n_r - dr)
            lobe = peak_amplitude[k] * windows.sidelobes[0][dv] * windows.sidelobes[1][dr]
            if (dv <= 1 and dr <= 1) or peak_amplitude[i] < lobe + threshold[i]:
                keep = False
                break
        if keep:
            accepted[n_accepted] = i
            n_accepted += 1
    return accepted[:n_accepted]
