"""Non-uniform FFT over a run of chirps: one tone in fast time and one in stretched slow time.

The tones of all scatterers are spread onto a grid of beat and Doppler frequencies. Two transforms
convert it to fast and slow time, slightly denser than the bands of the scene require. Each sample
of the run is interpolated at its own stretched slow time, (1 + S t_n / f) t, which contains all of
the range migration (inverse of the keystone transform, Perry, DiPietro & Fante 1999). The cost is
therefore that of scatterers + samples x log samples, independent of their speed.
"""

import numpy as np
import scipy

from dechirp.core.buffers import scratch_complex64_array
from dechirp.core.threads import run_in_threads, split_range
from dechirp.simulation.kernels.grid_axes import FastTime, GridAxis, make_slow_time_axis
from dechirp.simulation.kernels.gridding import (
    interpolate_stretched_slow_time,
    spread_tones_onto_grid,
)
from dechirp.simulation.kernels.simd import WIDTH
from dechirp.simulation.kernels.taylor import LANES, AntennaPairView
from dechirp.simulation.kernels.tones import ECONOMISATIONS, ToneSurvey, Waveform


def half_run_duration_s(chirp_times_s: np.ndarray, half_window_s: float) -> float:
    """Return the time from the middle of a run to its first or last sample."""
    return float(chirp_times_s[-1] - chirp_times_s[0]) / 2 + half_window_s


def slow_time_stretch_error_bound(
    survey: ToneSurvey, waveform: Waveform, half_run_s: float
) -> float:
    """Return a bound on the relative error of stretches that the additional field does not cover.

    It matters only for delays far longer than a chirp.
    """
    mid_hz = (survey.low_hz + survey.high_hz) / 2
    carrier_hz = abs(waveform.mid_frequency_hz - mid_hz)
    relative_offset = (survey.high_hz - mid_hz) / carrier_hz
    swept = abs(waveform.slope_hz_per_s) * waveform.half_window_s / carrier_hz
    first = 2 * np.pi * swept * relative_offset * survey.max_doppler_hz * half_run_s
    return float(first * (first / 2 + relative_offset))


def add_echoes(
    out: np.ndarray,
    view: AntennaPairView,
    survey: ToneSurvey,
    left_out: np.ndarray,
    weights: np.ndarray,
    n_fields: int,
    waveform: Waveform,
    fast: FastTime,
    tolerance: float,
    n_threads: int,
) -> None:
    """Add the echoes of one antenna pair in a run to (n_chirps, n_samples).

    `left_out` (n,) marks scatterers that are not added; `weights` is (n_chirps,) complex.
    """
    low_hz, high_hz, half_s = survey.low_hz, survey.high_hz, view.half_s
    mid_hz = (low_hz + high_hz) / 2
    carrier_hz = waveform.mid_frequency_hz - mid_hz
    stretch = 1 + waveform.slope_hz_per_s * fast.times_s / carrier_hz
    widest = max(stretch[0], stretch[-1])
    times_s = waveform.times_s - view.mid_s
    latest_s = max(-times_s[0], times_s[-1]) + max(-fast.times_s[0], fast.times_s[-1])
    slow = make_slow_time_axis(
        2 * survey.max_doppler_hz, float(latest_s * widest), fast.axis.spacing
    )
    unit = slow.step_s / half_s
    shares = [(power, power // 2, unit) for power in range(n_fields)]
    # Tones away from the middle of the beat frequencies have a slightly different stretch: one
    # field more.
    cross_phase = 2 * np.pi * waveform.slope_hz_per_s / carrier_hz**2 * half_s**2
    phase_error = (
        abs(cross_phase) * (high_hz - mid_hz) * survey.max_doppler_hz * -fast.times_s[0] / half_s
    )
    cross_term = np.array([cross_phase if phase_error > tolerance else 0.0, mid_hz])
    if cross_term[0] != 0:
        shares.append((1, -1, unit))
    retained = ECONOMISATIONS[n_fields - 1][0]
    grid = _spread_tones_onto_new_grid(
        view, left_out, slow, fast, len(shares), retained, cross_term, n_threads
    )
    grid[:WIDTH] += grid[-WIDTH:]
    # Columns without tones need no transform.
    column_map = fast.axis.frequency_to_grid_scale_and_offset(fast.mixer_hz)
    first = int(column_map[0] * low_hz + column_map[1]) - WIDTH // 2 - 1
    last = int(column_map[0] * high_hz + column_map[1]) + WIDTH // 2 + 2
    n_columns = fast.axis.n_points
    for grid_columns in _circular_range_as_slices(first, last, n_columns):
        lines = scipy.fft.ifft(
            grid[grid_columns], axis=2, norm="forward", overwrite_x=True, workers=n_threads
        )
        if not np.shares_memory(lines, grid):
            grid[grid_columns] = lines
    reach = int(np.ceil(latest_s * widest / slow.step_s)) + WIDTH // 2 + 1
    middle = slow.n_points // 2
    rows = slice(max(middle - reach, 0), min(middle + reach, slow.n_points))
    fields = np.moveaxis(grid[:n_columns, :, rows], 0, 2)
    lines = scratch_complex64_array("times", fields.shape)
    np.multiply(fields, slow.deapodisation_factors()[rows, None], out=lines)
    times = scipy.fft.ifft(lines, axis=2, norm="forward", overwrite_x=True, workers=n_threads)
    kept_times = scratch_complex64_array("kept times", (*times.shape[:2], len(fast.times_s)))
    kept_times[:] = times[:, :, fast.time_slice]

    def interpolate_rows(grid_columns: slice) -> None:
        interpolate_stretched_slow_time(
            out[grid_columns],
            weights[grid_columns],
            kept_times.view(np.float32),
            times_s[grid_columns] / slow.step_s,
            fast.times_s / slow.step_s,
            stretch,
            middle - rows.start,
            fast.deapodisation_factors(),
            np.array(shares),
            slow.spreading_kernel.polynomials,
        )

    run_in_threads(n_threads, interpolate_rows, split_range(len(out), n_threads))


def _circular_range_as_slices(first: int, last: int, n: int) -> list[slice]:
    """Return the indices from first to last on a circle of n, as slices."""
    if last - first >= n:
        return [slice(0, n)]
    first, last = first % n, last % n
    return [slice(first, last)] if first < last else [slice(first, n), slice(0, last)]


def _spread_tones_onto_new_grid(
    view: AntennaPairView,
    left_out: np.ndarray,
    slow: GridAxis,
    fast: FastTime,
    n_fields: int,
    retained: np.ndarray,
    cross_term: np.ndarray,
    n_threads: int,
) -> np.ndarray:
    """Spread all tones onto the frequency grid, (n_fast + WIDTH, n_fields, n_slow)."""
    shape = (fast.axis.n_points + WIDTH, n_fields, slow.n_points)
    correction = np.append(2 * slow.spacing * slow.step_s, slow.spreading_kernel.correction)
    parts = split_range(-(-len(left_out) // LANES), n_threads)
    grids = [scratch_complex64_array(f"grid {part}", shape) for part in range(len(parts))]

    def spread_part(part: int) -> None:
        block_range, grid = parts[part], grids[part]
        grid[:] = 0
        spread_tones_onto_grid(
            grid.view(np.float32).reshape(-1),
            slow.n_points,
            fast.axis.n_points,
            view,
            block_range.start,
            block_range.stop,
            left_out,
            retained,
            correction,
            slow.frequency_to_grid_scale_and_offset(),
            fast.axis.frequency_to_grid_scale_and_offset(fast.mixer_hz),
            cross_term,
            slow.spreading_kernel.polynomials,
        )

    run_in_threads(n_threads, spread_part, range(len(parts)))
    total = grids[0]
    for other in grids[1:]:
        total += other
    return total
