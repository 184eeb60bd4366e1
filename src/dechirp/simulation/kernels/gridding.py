"""Gridding: spread tones onto a frequency grid, interpolate from a time grid (Kaiser-Bessel).

A value at the grid coordinate g is spread over the WIDTH nearest points b with the weights

    phi(z) = I0(beta sqrt(1 - z^2)) / I0(beta),   z = 2 (b - g) / WIDTH.

A transform of the grid yields the tone exp(i w g) times the transform of phi,

    phi^(w) = WIDTH sinh(sqrt(beta^2 - (w WIDTH / 2)^2)) / (sqrt(...) I0(beta)),

which is divided out (Jackson et al. 1991; Beatty, Nishimura & Pauly 2005). The residual images,
measured over a window filled to its edges, are 1.0e-6 root mean square on a grid 1.5 times finer
than critical, and 6e-8 on one twice as fine.

The transforms between the two grids are centred: the functions here flip the signs of alternate
points, which saves a pass over the grid that would move its origin. Grids are flat and float32,
with real and imaginary parts in turn; WIDTH extra columns hold the values that wrap round.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.simulation.kernels.simd import WIDTH, add_line, add_patch, set_weighted_sum
from dechirp.simulation.kernels.taylor import (
    BLOCK,
    DOPPLER,
    IMAG,
    LANES,
    ORDER,
    RANGE,
    REAL,
    SERIES,
    WORK,
    AntennaPairView,
    fill_tone_block,
    polynomial_time_shift_matrix,
)

_compiled = kernel(fastmath={"contract", "reassoc"})
# Functions that call others are inlined, as in `taylor`.
_inlined = kernel(inline="always", fastmath={"contract"}, cache=False)

TAPS = 2 * WIDTH
"""Number of weights of one grid position: each twice, for real and imaginary parts."""

_DEGREE = 8  # 4e-9 off


class SpreadingKernel(NamedTuple):
    """Kaiser-Bessel spreading kernel for an oversampled grid."""

    spacing: float
    """Oversampling factor of the grid."""
    beta: float
    """Shape parameter of the Kaiser-Bessel function."""
    polynomials: np.ndarray
    """(degree + 1) x WIDTH x 2, flat, float32, highest power first: weight of each point, twice,
    as a polynomial of the position between two points, -1 to 1. Signs alternate from point to
    point."""

    correction: np.ndarray
    """Polynomial of degree 10, highest power first, of the square of a frequency over that of
    the band edge: the factor of a tone that corrects its amplitude between the points."""

    def fourier_transform(self, phase_step_rad: np.ndarray) -> np.ndarray:
        """Return the transform of the weights at phase steps per grid point, rad; any shape."""
        return _kaiser_bessel_transform(self.beta, phase_step_rad)


def _kaiser_bessel_transform(beta: float, phase_step_rad: np.ndarray) -> np.ndarray:
    root = np.sqrt(beta**2 - (np.asarray(phase_step_rad) * WIDTH / 2) ** 2)
    return np.asarray(WIDTH * np.sinh(root) / (root * scipy.special.i0(beta)))


@cache
def make_spreading_kernel(oversampling: float) -> SpreadingKernel:
    """Make the kernel for a grid oversampled by `oversampling`, 1.5 or 2."""
    # 2 % below the edge of the images, where the sum of both errors is least.
    beta = 0.98 * np.pi * WIDTH * (1 - 0.5 / oversampling)
    fractions = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    z = (fractions[:, None] / 2 + 0.5 + np.arange(WIDTH)) * 2 / WIDTH - 1
    weights = scipy.special.i0(beta * np.sqrt(np.maximum(1 - z**2, 0))) / scipy.special.i0(beta)
    squares = (1 + fractions) / 2
    return SpreadingKernel(
        oversampling,
        beta,
        np.repeat(np.polyfit(fractions, weights * (-1.0) ** np.arange(WIDTH), _DEGREE), 2).astype(
            np.float32
        ),
        np.polyfit(
            squares, 1 / _kaiser_bessel_transform(beta, np.pi / oversampling * np.sqrt(squares)), 10
        ),
    )


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def spread_tones_onto_grid(
    grid: np.ndarray,
    n_doppler_rows: int,
    n_beat_columns: int,
    view: AntennaPairView,
    first_block: int,
    stop_block: int,
    left_out: np.ndarray,
    retained: np.ndarray,
    correction: np.ndarray,
    row_map: np.ndarray,
    column_map: np.ndarray,
    cross_term: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Add the tones of some blocks to a grid of beat and Doppler frequencies, in place.

    `grid` is (n_beat_columns + WIDTH, n_fields, n_doppler_rows): tones of similar beat frequency
    are adjacent, so scatterers sorted by range stay within 100 kB. `left_out` (n,) marks scatterers
    that are not added; `retained` and `correction` are those of `fill_tone_amplitudes_per_field`. A
    row coordinate is row_map[0] D + row_map[1], a column coordinate likewise with the beat
    frequency, and columns wrap round. `cross_term`, of two numbers, adds one more field, the first
    one times i cross_term[0] D (beat frequency - cross_term[1]); none if 0.
    """
    n_fields = len(retained) + (1 if cross_term[0] != 0 else 0)
    work, block, shifts = np.zeros(WORK), np.empty(BLOCK), polynomial_time_shift_matrix(view)
    values = np.empty(2 * LANES * n_fields)
    firsts, seconds = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    y, z = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    row_taps, column_taps = np.empty(TAPS, np.float32), np.empty(TAPS, np.float32)
    for n in range(first_block, stop_block):
        fill_tone_block(view, shifts, n * LANES, work, block)
        fill_tone_amplitudes_per_field(block, retained, correction, values)
        if cross_term[0] != 0:
            _fill_beat_doppler_cross_field(
                block, cross_term[0], cross_term[1], values, 2 * LANES * len(retained)
            )
        _first_grid_points_and_fractions(block, DOPPLER, row_map, firsts, y)
        _first_grid_points_and_fractions(block, RANGE, column_map, seconds, z)
        for i in range(min(LANES, len(left_out) - n * LANES)):
            # NaN fails this comparison, so nothing is written for it.
            if left_out[n * LANES + i] or not 0 <= firsts[i] <= n_doppler_rows - WIDTH:
                continue
            _evaluate_spreading_weights(y[i], polynomials, row_taps)
            _evaluate_spreading_weights(z[i], polynomials, column_taps)
            column = seconds[i] % n_beat_columns
            sign = 1.0 - 2.0 * ((firsts[i] + column) % 2)
            position = 2 * (column * n_fields * n_doppler_rows + firsts[i])
            for f in range(n_fields):
                lane = 2 * LANES * f + i
                real, imag = (
                    np.float32(sign * values[lane]),
                    np.float32(sign * values[lane + LANES]),
                )
                add_patch(
                    grid, position, 2 * n_fields * n_doppler_rows, column_taps, row_taps, real, imag
                )
                position += 2 * n_doppler_rows


@_compiled
def _first_grid_points_and_fractions(
    block: np.ndarray,
    frequency_offset: int,
    coordinate_map: np.ndarray,
    first_points: np.ndarray,
    fractions: np.ndarray,
) -> None:
    """Find the first of the WIDTH points about each tone, and its fraction, -1 to 1."""
    scale, offset = coordinate_map[0], coordinate_map[1]
    for i in range(np.uint64(LANES)):
        position = scale * block[np.uint64(frequency_offset) + i] + offset
        first = np.ceil(position - WIDTH / 2)
        first_points[i], fractions[i] = int(first), 2 * (first - position + WIDTH / 2) - 1


@_inlined
def spread_tones_onto_frequency_lines(
    grid: np.ndarray,
    first_float_index: int,
    n_columns: int,
    block: np.ndarray,
    n_tones: int,
    weight: complex,
    retained: np.ndarray,
    column_map: np.ndarray,
    polynomials: np.ndarray,
    columns: np.ndarray,
    fractions: np.ndarray,
    tones: np.ndarray,
    values: np.ndarray,
    taps: np.ndarray,
    unit: np.ndarray,
) -> None:
    """Add the first tones of a block, times a weight, to lines of frequencies, in place.

    `grid` is (..., n_fields, n_columns + WIDTH), with `first_float_index` the index of the first
    float of the first field; the rest as in `spread_tones_onto_grid`. Work arrays, float32 except
    the columns: `columns` and `fractions` of LANES, `tones` of 4 LANES, `values` of 2 LANES
    n_fields, TAPS `taps`, a 1.
    """
    _wrapped_columns_and_fractions(block, n_columns, column_map, columns, fractions)
    _fill_weighted_tone_amplitudes_per_field(block, weight, columns, retained, tones, values)
    for i in range(np.uint64(n_tones)):
        _evaluate_spreading_weights(fractions[i], polynomials, taps)
        position = first_float_index + 2 * columns[i]
        for f in range(np.uint64(len(retained))):
            lane = np.uint64(2 * LANES) * f + i
            real, imag = values[lane], values[lane + np.uint64(LANES)]
            add_line(grid, position, 0, unit, taps, real, imag)
            position += 2 * (n_columns + WIDTH)


@_compiled
def _wrapped_columns_and_fractions(
    block: np.ndarray,
    n_columns: int,
    coordinate_map: np.ndarray,
    columns: np.ndarray,
    fractions: np.ndarray,
) -> None:
    """Find the wrapped columns of tones by products: a division takes 3 ns."""
    scale, offset, inverse_period = coordinate_map[0], coordinate_map[1], 1 / n_columns
    for i in range(np.uint64(LANES)):
        position = scale * block[np.uint64(DOPPLER) + i] + offset
        first = np.ceil(position - WIDTH / 2)
        fractions[i] = 2 * (first - position + WIDTH / 2) - 1
        column = int(first - n_columns * np.floor(first * inverse_period))
        # Rounding may leave it one period off; NaN must not leave the grid.
        column += n_columns if column < 0 else 0
        column -= n_columns if column >= n_columns else 0
        columns[i] = min(max(column, 0), n_columns - 1)


@_compiled
def _fill_weighted_tone_amplitudes_per_field(
    block: np.ndarray,
    weight: complex,
    columns: np.ndarray,
    retained_powers: np.ndarray,
    tones: np.ndarray,
    field_amplitudes: np.ndarray,
) -> None:
    """Evaluate fields times weight and column sign, in single precision."""
    for i in range(np.uint64(LANES)):
        sign = 1.0 - 2.0 * (columns[i] & 1)
        c, d = block[np.uint64(REAL) + i] * sign, block[np.uint64(IMAG) + i] * sign
        tones[i] = c * weight.real - d * weight.imag
        tones[np.uint64(LANES) + i] = c * weight.imag + d * weight.real
    series = np.uint64(2 * LANES)
    for f in range(np.uint64(len(retained_powers))):
        for i in range(np.uint64(LANES)):
            tones[series + i], tones[series + np.uint64(LANES) + i] = retained_powers[f, 0], 0.0
        for k in range(np.uint64(ORDER - 1)):
            share = np.float32(retained_powers[f, k + np.uint64(1)])
            if share != 0:
                term = np.uint64(SERIES) + np.uint64(2 * LANES) * k
                for i in range(np.uint64(2 * LANES)):
                    tones[series + i] += share * np.float32(block[term + i])
        real = np.uint64(2 * LANES) * f
        imag = real + np.uint64(LANES)
        for i in range(np.uint64(LANES)):
            c, d = tones[i], tones[np.uint64(LANES) + i]
            g, h = tones[series + i], tones[series + np.uint64(LANES) + i]
            field_amplitudes[real + i], field_amplitudes[imag + i] = c * g - d * h, c * h + d * g


@_compiled
def fill_tone_amplitudes_per_field(
    block: np.ndarray,
    retained_powers: np.ndarray,
    correction: np.ndarray,
    field_amplitudes: np.ndarray,
) -> None:
    """Fill (n_fields, 2, LANES) with the amplitudes of the tones of a block in each field.

    `retained_powers` (n_fields, ORDER) maps each power to the fields. All are multiplied by the
    polynomial `correction[1:]`, highest power first, of the square of correction[0] D.
    """
    scale = np.empty(LANES)
    for i in range(LANES):
        x = correction[0] * block[DOPPLER + i]
        x *= x
        # Degree 10, in two halves without data dependence.
        high = correction[1] * x + correction[2]
        high = ((high * x + correction[3]) * x + correction[4]) * x + correction[5]
        low = (correction[6] * x + correction[7]) * x + correction[8]
        low = ((low * x + correction[9]) * x + correction[10]) * x + correction[11]
        square = x * x * x
        scale[i] = high * (square * square) + low
    for f in range(np.uint64(len(retained_powers))):
        real = np.uint64(2 * LANES) * f
        imag = real + np.uint64(LANES)
        for i in range(np.uint64(LANES)):
            field_amplitudes[real + i], field_amplitudes[imag + i] = retained_powers[f, 0], 0.0
        for k in range(np.uint64(ORDER - 1)):
            share = retained_powers[f, k + np.uint64(1)]
            if share != 0:
                term = np.uint64(SERIES) + np.uint64(2 * LANES) * k
                for i in range(np.uint64(2 * LANES)):
                    field_amplitudes[real + i] += share * block[term + i]
        for i in range(np.uint64(LANES)):
            c, d = block[np.uint64(REAL) + i] * scale[i], block[np.uint64(IMAG) + i] * scale[i]
            g, h = field_amplitudes[real + i], field_amplitudes[imag + i]
            field_amplitudes[real + i], field_amplitudes[imag + i] = c * g - d * h, c * h + d * g


@_compiled
def _fill_beat_doppler_cross_field(
    block: np.ndarray,
    cross_phase: float,
    mid_beat_hz: float,
    field_amplitudes: np.ndarray,
    offset: int,
) -> None:
    """Fill one more field: the first one times i size D (beat frequency - middle)."""
    target = np.uint64(offset)
    for i in range(np.uint64(LANES)):
        apart_hz = block[np.uint64(RANGE) + i] - mid_beat_hz
        turn = cross_phase * block[np.uint64(DOPPLER) + i] * apart_hz
        real = field_amplitudes[i]
        field_amplitudes[target + i] = -turn * field_amplitudes[np.uint64(LANES) + i]
        field_amplitudes[target + np.uint64(LANES) + i] = turn * real


@_compiled
def _evaluate_spreading_weights(
    fraction: float, polynomials: np.ndarray, weights: np.ndarray
) -> None:
    """Evaluate the weights of the points about a position, each twice."""
    p = polynomials
    for a in range(TAPS):
        high = ((p[a] * fraction + p[TAPS + a]) * fraction + p[2 * TAPS + a]) * fraction + p[
            3 * TAPS + a
        ]
        low = (
            (p[4 * TAPS + a] * fraction + p[5 * TAPS + a]) * fraction + p[6 * TAPS + a]
        ) * fraction
        square = fraction * fraction
        low = (low + p[7 * TAPS + a]) * fraction + p[8 * TAPS + a]
        weights[a] = high * (square * square * fraction) + low


@kernel(plain=IN_CALLER, fastmath={"contract", "reassoc"})
def interpolate_stretched_slow_time(
    out: np.ndarray,
    chirp_factors: np.ndarray,
    slow_time_grid: np.ndarray,
    slow_time_rows: np.ndarray,
    fast_time_rows: np.ndarray,
    stretch: np.ndarray,
    middle_row: int,
    deapodisation: np.ndarray,
    field_exponents: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Interpolate along slow time at stretched times, and sum the fields of the series.

    Parameters
    ----------
    out : (n_chirps, n_times) complex
        Added to, in place, times `chirp_factors` (n_chirps,) complex.
    slow_time_grid : (n_fields, n_rows, 2 n_times) float32
        Fields of the series over slow time, zero in row `middle_row`, and fast time.
    slow_time_rows, fast_time_rows : (n_chirps,), (n_times,)
        Slow and fast time, in rows; the stretched time is their sum times `stretch` (n_times,).
    deapodisation : (n_times,) float32
        Factor of the sum.
    field_exponents : (n_fields, 3)
        Field f, with (a, b, unit) = field_exponents[f], is multiplied by u^a and stretch^b, with u
        the sum of slow_time_rows and fast_time_rows times unit; if b = -1, by fast_time_rows times
        unit instead of the power of stretch.
    """
    n_fields, n_rows, n_floats = slow_time_grid.shape
    flat = slow_time_grid.reshape(-1)
    n_times = n_floats // 2
    firsts, y = np.empty(n_times, np.int64), np.empty(n_floats, np.float32)
    # Real and imaginary parts alternate, as in the grid: plain loops over numbers.
    pairs = np.empty(WIDTH * n_floats, np.float32)
    field, total = np.empty(n_floats, np.float32), np.empty(n_floats, np.float32)
    share, late_times = np.empty(n_floats, np.float32), np.empty(n_floats, np.float32)
    stretched = np.empty(n_floats, np.float32)
    for j in range(n_times):
        for part in range(2):
            late_times[2 * j + part] = fast_time_rows[j]
            stretched[2 * j + part] = stretch[j]
    for m in range(len(out)):
        if chirp_factors[m] == 0:
            continue
        for j in range(n_times):
            position = (slow_time_rows[m] + fast_time_rows[j]) * stretch[j] + middle_row
            first = np.ceil(position - WIDTH / 2)
            firsts[j] = int(first)
            fractions = np.float32(2 * (first - position + WIDTH / 2) - 1)
            y[2 * j], y[2 * j + 1] = fractions, fractions
        for a in range(WIDTH):
            _evaluate_row_weights(pairs, a, y, polynomials)
        total[:] = 0.0
        for f in range(n_fields):
            _sum_weighted_rows(field, flat, f * n_rows, firsts, pairs)
            _fill_field_power_factors(
                share, field_exponents[f], slow_time_rows[m], late_times, stretched
            )
            for j in range(n_floats):
                total[j] += share[j] * field[j]
        factor = np.complex64(chirp_factors[m])
        for j in range(n_times):
            real, imag = deapodisation[j] * total[2 * j], deapodisation[j] * total[2 * j + 1]
            out[m, j] += complex(
                real * factor.real - imag * factor.imag, real * factor.imag + imag * factor.real
            )


@_compiled
def _sum_weighted_rows(
    sums: np.ndarray,
    grid: np.ndarray,
    field_row_offset: int,
    first_rows: np.ndarray,
    row_weights: np.ndarray,
) -> None:
    """Sum WIDTH weighted rows of a flat grid, starting at `first_rows`, at all times."""
    n_floats = len(sums)
    for start in range(0, len(first_rows), WIDTH):
        stop = min(start + WIDTH, len(first_rows))
        row = first_rows[start]
        same = stop == start + WIDTH
        for j in range(start + 1, stop):
            same &= first_rows[j] == row
        if same:
            position = (field_row_offset + row) * n_floats + 2 * start
            set_weighted_sum(sums, 2 * start, grid, position, n_floats, row_weights, n_floats)
            continue
        for j in range(2 * start, 2 * stop):
            position = (field_row_offset + first_rows[j // 2]) * n_floats + j
            total = np.float32(0)
            for a in range(WIDTH):
                total += row_weights[a * n_floats + j] * grid[position + a * n_floats]
            sums[j] = total


@_compiled
def _evaluate_row_weights(
    row_weights: np.ndarray, row: int, fractions: np.ndarray, polynomials: np.ndarray
) -> None:
    """Evaluate the weights of row a of WIDTH, (WIDTH, n_floats)."""
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = (
        polynomials[2 * row], polynomials[TAPS + 2 * row], polynomials[2 * TAPS + 2 * row],
        polynomials[3 * TAPS + 2 * row], polynomials[4 * TAPS + 2 * row],
        polynomials[5 * TAPS + 2 * row], polynomials[6 * TAPS + 2 * row],
        polynomials[7 * TAPS + 2 * row], polynomials[8 * TAPS + 2 * row],
    )  # fmt: skip
    row_start = np.uint64(row * len(fractions))
    sign = np.float32(1 - 2 * (row % 2))  # signs do not alternate between times
    for j in range(np.uint64(len(fractions))):
        v = fractions[j]
        weight = ((((((c0 * v + c1) * v + c2) * v + c3) * v + c4) * v + c5) * v + c6) * v + c7
        row_weights[row_start + j] = sign * (weight * v + c8)


@_compiled
def _fill_field_power_factors(
    factors: np.ndarray,
    exponents_and_unit: np.ndarray,
    slow_time_row: float,
    fast_time_rows: np.ndarray,
    stretch: np.ndarray,
) -> None:
    """Fill the factors of a field, as defined in `interpolate_stretched_slow_time`."""
    unit, now = np.float32(exponents_and_unit[2]), np.float32(slow_time_row)
    factors[:] = 1.0
    for _ in range(int(exponents_and_unit[0])):
        for j in range(len(factors)):
            factors[j] *= (now + fast_time_rows[j]) * unit
    for _ in range(int(exponents_and_unit[1])):
        for j in range(len(factors)):
            factors[j] *= stretch[j]
    if exponents_and_unit[1] < 0:
        for j in range(len(factors)):
            factors[j] *= fast_time_rows[j] * unit
