"""Echoes over a run of chirps: each is one tone in fast time and one in stretched slow time.

The tones of all scatterers are spread onto a grid of beat and Doppler frequencies; two
transforms make samples of it over fast time and slow time, a little denser than the bands of
the scene need; and each sample of the run is interpolated at its own stretched slow time,
(1 + S t_n / f) t, which holds all of the range migration (the keystone, Perry, DiPietro &
Fante 1999, read backwards). So the cost is that of scatterers + samples x log samples, however
fast they move. For very many scatterers.
"""

import numpy as np
import scipy.fft

from dechirp.core.scratch import lent
from dechirp.core.threads import in_threads, slices
from dechirp.echoes.kernels.axes import Axis, FastTime, slow_axis
from dechirp.echoes.kernels.gridding import spread, warp
from dechirp.echoes.kernels.patches import WIDTH
from dechirp.echoes.kernels.series import LANES, View
from dechirp.echoes.kernels.tones import ECONOMISED, Survey, Waveform


def half_duration_s(times_s: np.ndarray, half_window_s: float) -> float:
    """From the middle of a run to its first or last sample."""
    return float(times_s[-1] - times_s[0]) / 2 + half_window_s


def stretch_left_out(look: Survey, waveform: Waveform, half_s: float) -> float:
    """Error of echoes, at most, of stretches that differ by more than the one field more holds.

    It counts only for delays far longer than a chirp.
    """
    mid_hz = (look.low_hz + look.high_hz) / 2
    carrier_hz = abs(waveform.mid_frequency_hz - mid_hz)
    apart = (look.high_hz - mid_hz) / carrier_hz
    swept = abs(waveform.slope_hz_per_s) * waveform.half_window_s / carrier_hz
    first = 2 * np.pi * swept * apart * look.fastest_hz * half_s
    return float(first * (first / 2 + apart))


def add(
    out: np.ndarray,
    seen: View,
    look: Survey,
    left: np.ndarray,
    weights: np.ndarray,
    n_fields: int,
    waveform: Waveform,
    fast: FastTime,
    tolerance: float,
    n_threads: int,
) -> None:
    """Add what one pair of antennas sees in a run to (n_chirps, n_samples).

    `look`: what the survey of the view found; `left` (n,): scatterers that are not added;
    `weights` (n_chirps,) complex.
    """
    low_hz, high_hz, half_s = look.low_hz, look.high_hz, seen.half_s
    mid_hz = (low_hz + high_hz) / 2
    carrier_hz = waveform.mid_frequency_hz - mid_hz
    stretch = 1 + waveform.slope_hz_per_s * fast.times_s / carrier_hz
    widest = max(stretch[0], stretch[-1])
    times_s = waveform.times_s - seen.mid_s
    latest_s = max(-times_s[0], times_s[-1]) + max(-fast.times_s[0], fast.times_s[-1])
    slow = slow_axis(2 * look.fastest_hz, float(latest_s * widest), fast.axis.spacing)
    unit = slow.step_s / half_s
    shares = [(power, power // 2, unit) for power in range(n_fields)]
    # The stretch of a tone that is not amid the beat frequencies is a little off: one field more.
    # Of a product of two evenly spread numbers the root mean square is a third of the largest.
    turn = 2 * np.pi * waveform.slope_hz_per_s / carrier_hz**2 * half_s**2
    off = abs(turn) * (high_hz - mid_hz) * look.fastest_hz * -fast.times_s[0] / half_s
    crossed = np.array([turn if off > tolerance else 0.0, mid_hz])
    if crossed[0] != 0:
        shares.append((1, -1, unit))
    kept = ECONOMISED[n_fields - 1][0]
    grid = _spread(seen, left, slow, fast, len(shares), kept, crossed, n_threads)
    grid[:WIDTH] += grid[-WIDTH:]
    # Where no tone is, there is nothing to transform.
    columns_at = fast.axis.places(fast.mixed_hz)
    first = int(columns_at[0] * low_hz + columns_at[1]) - WIDTH // 2 - 1
    last = int(columns_at[0] * high_hz + columns_at[1]) + WIDTH // 2 + 2
    n_columns = fast.axis.n_points
    for some in _wrapped(first, last, n_columns):
        lines = scipy.fft.ifft(
            grid[some], axis=2, norm="forward", overwrite_x=True, workers=n_threads
        )
        if not np.shares_memory(lines, grid):
            grid[some] = lines
    reach = int(np.ceil(latest_s * widest / slow.step_s)) + WIDTH // 2 + 1
    middle = slow.n_points // 2
    rows = slice(max(middle - reach, 0), min(middle + reach, slow.n_points))
    fields = np.moveaxis(grid[:n_columns, :, rows], 0, 2)
    lines = lent("times", fields.shape)
    np.multiply(fields, slow.over()[rows, None], out=lines)
    times = scipy.fft.ifft(lines, axis=2, norm="forward", overwrite_x=True, workers=n_threads)
    kept_times = lent("kept times", (*times.shape[:2], len(fast.times_s)))
    kept_times[:] = times[:, :, fast.kept]

    def one(some: slice) -> None:
        warp(
            out[some],
            weights[some],
            kept_times.view(np.float32),
            times_s[some] / slow.step_s,
            fast.times_s / slow.step_s,
            stretch,
            middle - rows.start,
            fast.over(),
            np.array(shares),
            slow.spread.polynomials,
        )

    in_threads(n_threads, one, slices(len(out), n_threads))


def _wrapped(first: int, last: int, n: int) -> list[slice]:
    """Indices from first to last, round a circle of n."""
    if last - first >= n:
        return [slice(0, n)]
    first, last = first % n, last % n
    return [slice(first, last)] if first < last else [slice(first, n), slice(0, last)]


def _spread(
    seen: View,
    left: np.ndarray,
    slow: Axis,
    fast: FastTime,
    n_fields: int,
    kept: np.ndarray,
    crossed: np.ndarray,
    n_threads: int,
) -> np.ndarray:
    """All tones on the grid of beat and Doppler frequencies, (n_fast + WIDTH, n_fields, n_slow)."""
    shape = (fast.axis.n_points + WIDTH, n_fields, slow.n_points)
    before = np.append(2 * slow.spacing * slow.step_s, slow.spread.before)
    parts = slices(-(-len(left) // LANES), n_threads)
    grids = [lent(f"grid {part}", shape) for part in range(len(parts))]

    def one(part: int) -> None:
        some, grid = parts[part], grids[part]
        grid[:] = 0
        spread(
            grid.view(np.float32).reshape(-1),
            slow.n_points,
            fast.axis.n_points,
            seen,
            some.start,
            some.stop,
            left,
            kept,
            before,
            slow.places(),
            fast.axis.places(fast.mixed_hz),
            crossed,
            slow.spread.polynomials,
        )

    in_threads(n_threads, one, range(len(parts)))
    total = grids[0]
    for other in grids[1:]:
        total += other
    return total
