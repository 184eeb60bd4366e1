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

import numba
import numpy as np
from scipy.special import i0

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
    expand_block,
    time_shift_matrix,
)

_compiled = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}
)
# Functions that call others are inlined, as in `taylor`.
_inlined = numba.njit(inline="always", nogil=True, error_model="numpy", fastmath={"contract"})

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

    def transform(self, angle: np.ndarray) -> np.ndarray:
        """Return the transform of the weights at phase steps per grid point, rad; any shape."""
        return _kernel_transform(self.beta, angle)


def _kernel_transform(beta: float, angle: np.ndarray) -> np.ndarray:
    root = np.sqrt(beta**2 - (np.asarray(angle) * WIDTH / 2) ** 2)
    return np.asarray(WIDTH * np.sinh(root) / (root * i0(beta)))


@cache
def make_spreading_kernel(spacing: float) -> SpreadingKernel:
    """Make the kernel for a grid oversampled by `spacing`, 1.5 or 2."""
    # 2 % below the edge of the images, where the sum of both errors is least.
    beta = 0.98 * np.pi * WIDTH * (1 - 0.5 / spacing)
    fractions = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    z = (fractions[:, None] / 2 + 0.5 + np.arange(WIDTH)) * 2 / WIDTH - 1
    weights = i0(beta * np.sqrt(np.maximum(1 - z**2, 0))) / i0(beta)
    squares = (1 + fractions) / 2
    return SpreadingKernel(
        spacing,
        beta,
        np.repeat(np.polyfit(fractions, weights * (-1.0) ** np.arange(WIDTH), _DEGREE), 2).astype(
            np.float32
        ),
        np.polyfit(squares, 1 / _kernel_transform(beta, np.pi / spacing * np.sqrt(squares)), 10),
    )


@_compiled
def spread_block_tones(
    grid: np.ndarray,
    n_rows: int,
    n_columns: int,
    view: AntennaPairView,
    first: int,
    stop: int,
    left_out: np.ndarray,
    retained: np.ndarray,
    correction: np.ndarray,
    row_map: np.ndarray,
    column_map: np.ndarray,
    cross_term: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Add the tones of some blocks to a grid of beat and Doppler frequencies, in place.

    `grid` is (n_columns + WIDTH, n_fields, n_rows): tones of similar beat frequency are adjacent,
    so
    scatterers sorted by range stay within 100 kB. `left_out` (n,) marks scatterers that are not
    added;
    `retained` and `correction` as in `evaluate_fields`. A row coordinate is row_map[0] D +
    row_map[1],
    a column coordinate likewise with the beat frequency, and columns wrap round. `cross_term`, of
    two
    numbers, adds one more field, the first one times i cross_term[0] D (beat frequency -
    cross_term[1]); none if 0.
    """
    n_fields = len(retained) + (1 if cross_term[0] != 0 else 0)
    work, block, shifts = np.zeros(WORK), np.empty(BLOCK), time_shift_matrix(view)
    values = np.empty(2 * LANES * n_fields)
    firsts, seconds = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    y, z = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    row_taps, column_taps = np.empty(TAPS, np.float32), np.empty(TAPS, np.float32)
    for n in range(first, stop):
        expand_block(view, shifts, n * LANES, work, block)
        evaluate_fields(block, retained, correction, values)
        if cross_term[0] != 0:
            _add_cross_field(block, cross_term[0], cross_term[1], values, 2 * LANES * len(retained))
        _find_grid_points(block, DOPPLER, row_map, firsts, y)
        _find_grid_points(block, RANGE, column_map, seconds, z)
        for i in range(min(LANES, len(left_out) - n * LANES)):
            # NaN fails this comparison, so nothing is written for it.
            if left_out[n * LANES + i] or not 0 <= firsts[i] <= n_rows - WIDTH:
                continue
            _evaluate_taps(y[i], polynomials, row_taps)
            _evaluate_taps(z[i], polynomials, column_taps)
            column = seconds[i] % n_columns
            sign = 1.0 - 2.0 * ((firsts[i] + column) % 2)
            position = 2 * (column * n_fields * n_rows + firsts[i])
            for f in range(n_fields):
                lane = 2 * LANES * f + i
                real, imag = (
                    np.float32(sign * values[lane]),
                    np.float32(sign * values[lane + LANES]),
                )
                add_patch(grid, position, 2 * n_fields * n_rows, column_taps, row_taps, real, imag)
                position += 2 * n_rows


@_compiled
def _find_grid_points(
    block: np.ndarray,
    frequency: int,
    coordinate_map: np.ndarray,
    firsts: np.ndarray,
    fractions: np.ndarray,
) -> None:
    """Find the first of the WIDTH points about each tone, and its fraction, -1 to 1."""
    scale, offset = coordinate_map[0], coordinate_map[1]
    for i in range(np.uint64(LANES)):
        position = scale * block[np.uint64(frequency) + i] + offset
        first = np.ceil(position - WIDTH / 2)
        firsts[i], fractions[i] = int(first), 2 * (first - position + WIDTH / 2) - 1


@_inlined
def spread_doppler_line(
    grid: np.ndarray,
    first_float: int,
    n_columns: int,
    block: np.ndarray,
    lanes: int,
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
    """Add the first tones of a block, times a weight, to lines of Doppler frequencies, in place.

    `grid` is (..., n_fields, n_columns + WIDTH), with `first_float` the index of the first float of
    the
    first field; the rest as in `spread_block_tones`. Work arrays, float32 except the columns:
    `columns`
    and `fractions` of LANES, `tones` of 4 LANES, `values` of 2 LANES n_fields, TAPS `taps`, a 1.
    """
    _find_wrapped_columns(block, n_columns, column_map, columns, fractions)
    _evaluate_weighted_fields(block, weight, columns, retained, tones, values)
    for i in range(np.uint64(lanes)):
        _evaluate_taps(fractions[i], polynomials, taps)
        position = first_float + 2 * columns[i]
        for f in range(np.uint64(len(retained))):
            lane = np.uint64(2 * LANES) * f + i
            real, imag = values[lane], values[lane + np.uint64(LANES)]
            add_line(grid, position, 0, unit, taps, real, imag)
            position += 2 * (n_columns + WIDTH)


@_compiled
def _find_wrapped_columns(
    block: np.ndarray,
    n_columns: int,
    coordinate_map: np.ndarray,
    columns: np.ndarray,
    fractions: np.ndarray,
) -> None:
    """Find wrapped columns of Doppler frequencies by products: a division takes 3 ns."""
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
def _evaluate_weighted_fields(
    block: np.ndarray,
    weight: complex,
    columns: np.ndarray,
    retained: np.ndarray,
    tones: np.ndarray,
    values: np.ndarray,
) -> None:
    """Evaluate fields times weight and column sign, in single precision."""
    for i in range(np.uint64(LANES)):
        sign = 1.0 - 2.0 * (columns[i] & 1)
        c, d = block[np.uint64(REAL) + i] * sign, block[np.uint64(IMAG) + i] * sign
        tones[i] = c * weight.real - d * weight.imag
        tones[np.uint64(LANES) + i] = c * weight.imag + d * weight.real
    series = np.uint64(2 * LANES)
    for f in range(np.uint64(len(retained))):
        for i in range(np.uint64(LANES)):
            tones[series + i], tones[series + np.uint64(LANES) + i] = retained[f, 0], 0.0
        for k in range(np.uint64(ORDER - 1)):
            share = np.float32(retained[f, k + np.uint64(1)])
            if share != 0:
                term = np.uint64(SERIES) + np.uint64(2 * LANES) * k
                for i in range(np.uint64(2 * LANES)):
                    tones[series + i] += share * np.float32(block[term + i])
        real = np.uint64(2 * LANES) * f
        imag = real + np.uint64(LANES)
        for i in range(np.uint64(LANES)):
            c, d = tones[i], tones[np.uint64(LANES) + i]
            g, h = tones[series + i], tones[series + np.uint64(LANES) + i]
            values[real + i], values[imag + i] = c * g - d * h, c * h + d * g


@_compiled
def evaluate_fields(
    block: np.ndarray, retained: np.ndarray, correction: np.ndarray, values: np.ndarray
) -> None:
    """Fill `values`, (n_fields, 2, LANES): amplitudes of the tones of a block in each field.

    `retained` (n_fields, ORDER) maps each power to the fields. All are multiplied by the polynomial
    `correction[1:]`, highest power first, of the square of correction[0] D.
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
    for f in range(np.uint64(len(retained))):
        real = np.uint64(2 * LANES) * f
        imag = real + np.uint64(LANES)
        for i in range(np.uint64(LANES)):
            values[real + i], values[imag + i] = retained[f, 0], 0.0
        for k in range(np.uint64(ORDER - 1)):
            share = retained[f, k + np.uint64(1)]
            if share != 0:
                term = np.uint64(SERIES) + np.uint64(2 * LANES) * k
                for i in range(np.uint64(2 * LANES)):
                    values[real + i] += share * block[term + i]
        for i in range(np.uint64(LANES)):
            c, d = block[np.uint64(REAL) + i] * scale[i], block[np.uint64(IMAG) + i] * scale[i]
            g, h = values[real + i], values[imag + i]
            values[real + i], values[imag + i] = c * g - d * h, c * h + d * g


@_compiled
def _add_cross_field(
    block: np.ndarray, size: float, middle_hz: float, values: np.ndarray, offset: int
) -> None:
    """Fill one more field: the first one times i size D (beat frequency - middle)."""
    target = np.uint64(offset)
    for i in range(np.uint64(LANES)):
        apart_hz = block[np.uint64(RANGE) + i] - middle_hz
        turn = size * block[np.uint64(DOPPLER) + i] * apart_hz
        real = values[i]
        values[target + i] = -turn * values[np.uint64(LANES) + i]
        values[target + np.uint64(LANES) + i] = turn * real


@_compiled
def _evaluate_taps(y: float, polynomials: np.ndarray, taps: np.ndarray) -> None:
    """Evaluate the weights of the points about a position, each twice."""
    p = polynomials
    for a in range(TAPS):
        high = ((p[a] * y + p[TAPS + a]) * y + p[2 * TAPS + a]) * y + p[3 * TAPS + a]
        low = ((p[4 * TAPS + a] * y + p[5 * TAPS + a]) * y + p[6 * TAPS + a]) * y
        square = y * y
        low = (low + p[7 * TAPS + a]) * y + p[8 * TAPS + a]
        taps[a] = high * (square * square * y) + low


@_compiled
def interpolate_stretched(
    out: np.ndarray,
    factors: np.ndarray,
    grid: np.ndarray,
    steps: np.ndarray,
    late_steps: np.ndarray,
    stretch: np.ndarray,
    middle: int,
    deapodisation: np.ndarray,
    shares: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Interpolate along slow time at stretched times, and sum the fields of the series.

    Parameters
    ----------
    out : (n_chirps, n_times) complex
        Added to, in place, times `factors` (n_chirps,) complex.
    grid : (n_fields, n_rows, 2 n_times) float32
        Fields of the series over slow time, zero in row `middle`, and fast time.
    steps, late_steps : (n_chirps,), (n_times,)
        Slow and fast time, in rows; the stretched time is their sum times `stretch` (n_times,).
    deapodisation : (n_times,) float32
        Factor of the sum.
    shares : (n_fields, 3)
        Field f is multiplied by u^shares[f, 0] and stretch^shares[f, 1], with u the sum of steps
        and late_steps times shares[f, 2]; shares[f, 1] = -1: by late_steps times shares[f, 2].
    """
    n_fields, n_rows, n_floats = grid.shape
    flat = grid.reshape(-1)
    n_times = n_floats // 2
    firsts, y = np.empty(n_times, np.int64), np.empty(n_floats, np.float32)
    # Real and imaginary parts alternate, as in the grid: plain loops over numbers.
    pairs = np.empty(WIDTH * n_floats, np.float32)
    field, total = np.empty(n_floats, np.float32), np.empty(n_floats, np.float32)
    share, late_times = np.empty(n_floats, np.float32), np.empty(n_floats, np.float32)
    stretched = np.empty(n_floats, np.float32)
    for j in range(n_times):
        for part in range(2):
            late_times[2 * j + part] = late_steps[j]
            stretched[2 * j + part] = stretch[j]
    for m in range(len(out)):
        if factors[m] == 0:
            continue
        for j in range(n_times):
            position = (steps[m] + late_steps[j]) * stretch[j] + middle
            first = np.ceil(position - WIDTH / 2)
            firsts[j] = int(first)
            fractions = np.float32(2 * (first - position + WIDTH / 2) - 1)
            y[2 * j], y[2 * j + 1] = fractions, fractions
        for a in range(WIDTH):
            _evaluate_row_weights(pairs, a, y, polynomials)
        total[:] = 0.0
        for f in range(n_fields):
            _interpolate_rows(field, flat, f * n_rows, firsts, pairs)
            _fill_field_factors(share, shares[f], steps[m], late_times, stretched)
            for j in range(n_floats):
                total[j] += share[j] * field[j]
        factor = np.complex64(factors[m])
        for j in range(n_times):
            real, imag = deapodisation[j] * total[2 * j], deapodisation[j] * total[2 * j + 1]
            out[m, j] += complex(
                real * factor.real - imag * factor.imag, real * factor.imag + imag * factor.real
            )


@_compiled
def _interpolate_rows(
    field: np.ndarray, grid: np.ndarray, first_row: int, firsts: np.ndarray, pairs: np.ndarray
) -> None:
    """Sum WIDTH weighted rows of a flat grid, starting at `firsts`, at all times."""
    n_floats = len(field)
    for start in range(0, len(firsts), WIDTH):
        stop = min(start + WIDTH, len(firsts))
        row = firsts[start]
        same = stop == start + WIDTH
        for j in range(start + 1, stop):
            same &= firsts[j] == row
        if same:
            position = (first_row + row) * n_floats + 2 * start
            set_weighted_sum(field, 2 * start, grid, position, n_floats, pairs, n_floats)
            continue
        for j in range(2 * start, 2 * stop):
            position = (first_row + firsts[j // 2]) * n_floats + j
            total = np.float32(0)
            for a in range(WIDTH):
                total += pairs[a * n_floats + j] * grid[position + a * n_floats]
            field[j] = total


@_compiled
def _evaluate_row_weights(
    pairs: np.ndarray, a: int, y: np.ndarray, polynomials: np.ndarray
) -> None:
    """Evaluate the weights of row a of WIDTH, (WIDTH, n_floats)."""
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = (
        polynomials[2 * a], polynomials[TAPS + 2 * a], polynomials[2 * TAPS + 2 * a],
        polynomials[3 * TAPS + 2 * a], polynomials[4 * TAPS + 2 * a],
        polynomials[5 * TAPS + 2 * a], polynomials[6 * TAPS + 2 * a],
        polynomials[7 * TAPS + 2 * a], polynomials[8 * TAPS + 2 * a],
    )  # fmt: skip
    row_start = np.uint64(a * len(y))
    sign = np.float32(1 - 2 * (a % 2))  # signs do not alternate between times
    for j in range(np.uint64(len(y))):
        v = y[j]
        weight = ((((((c0 * v + c1) * v + c2) * v + c3) * v + c4) * v + c5) * v + c6) * v + c7
        pairs[row_start + j] = sign * (weight * v + c8)


@_compiled
def _fill_field_factors(
    share: np.ndarray,
    exponents: np.ndarray,
    step: float,
    late_times: np.ndarray,
    stretched: np.ndarray,
) -> None:
    """Fill the factors of a field, as defined in `interpolate_stretched`."""
    unit, now = np.float32(exponents[2]), np.float32(step)
    share[:] = 1.0
    for _ in range(int(exponents[0])):
        for j in range(len(share)):
            share[j] *= (now + late_times[j]) * unit
    for _ in range(int(exponents[1])):
        for j in range(len(share)):
            share[j] *= stretched[j]
    if exponents[1] < 0:
        for j in range(len(share)):
            share[j] *= late_times[j] * unit
