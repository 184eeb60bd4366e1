"""Tones onto a grid of frequencies, and from a grid of times to the instants that are wanted.

The transforms between the two grids are centred: signs of alternate points are turned here,
so that no pass over a grid is needed to move its origin. Grids are flat, float32, real and
imaginary parts in turn; WIDTH more columns than are transformed take what wraps round.
"""

import numba
import numpy as np

from dechirp.echoes.kernels.patches import WIDTH, add_line, add_patch, weighted
from dechirp.echoes.kernels.series import (
    BLOCK,
    DOPPLER,
    IMAG,
    LANES,
    ORDER,
    RANGE,
    REAL,
    SERIES,
    WORK,
    View,
    expand_block,
    shifts_of,
)

_compiled = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"}
)
# As in `series`.
_inlined = numba.njit(inline="always", nogil=True, error_model="numpy", fastmath={"contract"})

TAPS = 2 * WIDTH
"""Weights of one place: each of them twice, for real and imaginary parts."""


@_compiled
def spread(
    grid: np.ndarray,
    n_rows: int,
    n_columns: int,
    seen: View,
    first: int,
    stop: int,
    left: np.ndarray,
    kept: np.ndarray,
    before: np.ndarray,
    rows_at: np.ndarray,
    columns_at: np.ndarray,
    crossed: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Add the tones of some blocks to a grid of beat and Doppler frequencies, in place.

    `grid`: (n_columns + WIDTH, n_fields, n_rows): tones of the same beat frequency are near each
    other, so that scatterers sorted by range stay within 100 kB. `left` (n,): those not to
    add; `kept`, `before` as in `fields`. Coordinates are rows_at[0] D + rows_at[1], and with
    the beat frequency so for columns, which wrap round. `crossed`, of two numbers: one more
    field, the first one times i crossed[0] D (beat frequency - crossed[1]); none if 0.
    """
    n_fields = len(kept) + (1 if crossed[0] != 0 else 0)
    work, block, shifts = np.zeros(WORK), np.empty(BLOCK), shifts_of(seen)
    values = np.empty(2 * LANES * n_fields)
    firsts, seconds = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    y, z = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    row_taps, column_taps = np.empty(TAPS, np.float32), np.empty(TAPS, np.float32)
    for n in range(first, stop):
        expand_block(seen, shifts, n * LANES, work, block)
        fields(block, kept, before, values)
        if crossed[0] != 0:
            _cross(block, crossed[0], crossed[1], values, 2 * LANES * len(kept))
        _places(block, DOPPLER, rows_at, firsts, y)
        _places(block, RANGE, columns_at, seconds, z)
        for i in range(min(LANES, len(left) - n * LANES)):
            # What is not a number has no place: nothing is written there.
            if left[n * LANES + i] or not 0 <= firsts[i] <= n_rows - WIDTH:
                continue
            _taps(y[i], polynomials, row_taps)
            _taps(z[i], polynomials, column_taps)
            column = seconds[i] % n_columns
            sign = 1.0 - 2.0 * ((firsts[i] + column) % 2)
            place = 2 * (column * n_fields * n_rows + firsts[i])
            for f in range(n_fields):
                at = 2 * LANES * f + i
                real, imag = np.float32(sign * values[at]), np.float32(sign * values[at + LANES])
                add_patch(grid, place, 2 * n_fields * n_rows, column_taps, row_taps, real, imag)
                place += 2 * n_rows


@_compiled
def _places(
    block: np.ndarray, frequency: int, at: np.ndarray, firsts: np.ndarray, between: np.ndarray
) -> None:
    """First of the WIDTH points about each tone, and where it is between two, -1 to 1."""
    scale, offset = at[0], at[1]
    for i in range(np.uint64(LANES)):
        place = scale * block[np.uint64(frequency) + i] + offset
        first = np.ceil(place - WIDTH / 2)
        firsts[i], between[i] = int(first), 2 * (first - place + WIDTH / 2) - 1


@_inlined
def spread_line(
    grid: np.ndarray,
    first_float: int,
    n_columns: int,
    block: np.ndarray,
    lanes: int,
    weight: complex,
    kept: np.ndarray,
    columns_at: np.ndarray,
    polynomials: np.ndarray,
    columns: np.ndarray,
    between: np.ndarray,
    tones: np.ndarray,
    values: np.ndarray,
    taps: np.ndarray,
    one: np.ndarray,
) -> None:
    """Add the first tones of a block, times a weight, to lines of frequencies D, in place.

    `grid`: (..., n_fields, n_columns + WIDTH), of which `first_float` is the first float of
    the first field; the rest as in `spread`. To work in, float32 but for the columns: `columns`
    and `between` of LANES, `tones` of 4 LANES, `values` of 2 LANES n_fields, TAPS `taps`, and a 1.
    """
    _columns(block, n_columns, columns_at, columns, between)
    _weighted_fields(block, weight, columns, kept, tones, values)
    for i in range(np.uint64(lanes)):
        _taps(between[i], polynomials, taps)
        place = first_float + 2 * columns[i]
        for f in range(np.uint64(len(kept))):
            at = np.uint64(2 * LANES) * f + i
            real, imag = values[at], values[at + np.uint64(LANES)]
            add_line(grid, place, 0, one, taps, real, imag)
            place += 2 * (n_columns + WIDTH)


@_compiled
def _columns(
    block: np.ndarray, n_columns: int, at: np.ndarray, columns: np.ndarray, between: np.ndarray
) -> None:
    """As `_places` of D, wrapped round: by products, for a division takes 3 ns."""
    scale, offset, turns = at[0], at[1], 1 / n_columns
    for i in range(np.uint64(LANES)):
        place = scale * block[np.uint64(DOPPLER) + i] + offset
        first = np.ceil(place - WIDTH / 2)
        between[i] = 2 * (first - place + WIDTH / 2) - 1
        column = int(first - n_columns * np.floor(first * turns))
        # Rounding may leave it one turn off; what is not a number must not leave the grid.
        column += n_columns if column < 0 else 0
        column -= n_columns if column >= n_columns else 0
        columns[i] = min(max(column, 0), n_columns - 1)


@_compiled
def _weighted_fields(
    block: np.ndarray,
    weight: complex,
    columns: np.ndarray,
    kept: np.ndarray,
    tones: np.ndarray,
    values: np.ndarray,
) -> None:
    """As `fields`, times a weight and the sign of each column, in single precision."""
    for i in range(np.uint64(LANES)):
        sign = 1.0 - 2.0 * (columns[i] & 1)
        c, d = block[np.uint64(REAL) + i] * sign, block[np.uint64(IMAG) + i] * sign
        tones[i] = c * weight.real - d * weight.imag
        tones[np.uint64(LANES) + i] = c * weight.imag + d * weight.real
    series = np.uint64(2 * LANES)
    for f in range(np.uint64(len(kept))):
        for i in range(np.uint64(LANES)):
            tones[series + i], tones[series + np.uint64(LANES) + i] = kept[f, 0], 0.0
        for k in range(np.uint64(ORDER - 1)):
            share = np.float32(kept[f, k + np.uint64(1)])
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
def fields(block: np.ndarray, kept: np.ndarray, before: np.ndarray, values: np.ndarray) -> None:
    """Fill `values`, (n_fields, 2, LANES): strengths of the tones of a block in each field.

    `kept` (n_fields, ORDER): what of each power goes to which field. All times a polynomial,
    `before[1:]` with the highest power first, of the square of before[0] D.
    """
    scale = np.empty(LANES)
    for i in range(LANES):
        x = before[0] * block[DOPPLER + i]
        x *= x
        # Degree 10, in two halves that do not wait for each other.
        high = before[1] * x + before[2]
        high = ((high * x + before[3]) * x + before[4]) * x + before[5]
        low = (before[6] * x + before[7]) * x + before[8]
        low = ((low * x + before[9]) * x + before[10]) * x + before[11]
        square = x * x * x
        scale[i] = high * (square * square) + low
    for f in range(np.uint64(len(kept))):
        real = np.uint64(2 * LANES) * f
        imag = real + np.uint64(LANES)
        for i in range(np.uint64(LANES)):
            values[real + i], values[imag + i] = kept[f, 0], 0.0
        for k in range(np.uint64(ORDER - 1)):
            share = kept[f, k + np.uint64(1)]
            if share != 0:
                term = np.uint64(SERIES) + np.uint64(2 * LANES) * k
                for i in range(np.uint64(2 * LANES)):
                    values[real + i] += share * block[term + i]
        for i in range(np.uint64(LANES)):
            c, d = block[np.uint64(REAL) + i] * scale[i], block[np.uint64(IMAG) + i] * scale[i]
            g, h = values[real + i], values[imag + i]
            values[real + i], values[imag + i] = c * g - d * h, c * h + d * g


@_compiled
def _cross(block: np.ndarray, size: float, middle_hz: float, values: np.ndarray, into: int) -> None:
    """Fill one more field: the first one times i size D (beat frequency - middle)."""
    at = np.uint64(into)
    for i in range(np.uint64(LANES)):
        apart_hz = block[np.uint64(RANGE) + i] - middle_hz
        turn = size * block[np.uint64(DOPPLER) + i] * apart_hz
        real = values[i]
        values[at + i] = -turn * values[np.uint64(LANES) + i]
        values[at + np.uint64(LANES) + i] = turn * real


@_compiled
def _taps(y: float, polynomials: np.ndarray, taps: np.ndarray) -> None:
    """Weights of the points about a place, each twice; polynomials (9, TAPS) and flat."""
    p = polynomials
    for a in range(TAPS):
        high = ((p[a] * y + p[TAPS + a]) * y + p[2 * TAPS + a]) * y + p[3 * TAPS + a]
        low = ((p[4 * TAPS + a] * y + p[5 * TAPS + a]) * y + p[6 * TAPS + a]) * y
        square = y * y
        low = (low + p[7 * TAPS + a]) * y + p[8 * TAPS + a]
        taps[a] = high * (square * square * y) + low


@_compiled
def warp(
    out: np.ndarray,
    factors: np.ndarray,
    grid: np.ndarray,
    steps: np.ndarray,
    late_steps: np.ndarray,
    stretch: np.ndarray,
    middle: int,
    over_columns: np.ndarray,
    shares: np.ndarray,
    polynomials: np.ndarray,
) -> None:
    """Interpolate along slow time at stretched instants, and sum the fields of the series.

    Parameters
    ----------
    out : (n_chirps, n_times) complex
        Added to, in place, times `factors` (n_chirps,) complex.
    grid : (n_fields, n_rows, 2 n_times) float32
        Fields of the series over slow time, zero in row `middle`, and fast time.
    steps, late_steps : (n_chirps,), (n_times,)
        Slow and fast time, in rows; the instant is their sum times `stretch` (n_times,).
    over_columns : (n_times,) float32
        By which the sum is multiplied.
    shares : (n_fields, 3)
        Field f is multiplied by u^shares[f, 0] and stretch^shares[f, 1], u the sum of steps
        and late_steps times shares[f, 2]; shares[f, 1] = -1: by late_steps times shares[f, 2].
    """
    n_fields, n_rows, n_floats = grid.shape
    flat = grid.reshape(-1)
    n_times = n_floats // 2
    firsts, y = np.empty(n_times, np.int64), np.empty(n_floats, np.float32)
    # Real and imaginary parts side by side, as in the grid: plain loops over numbers.
    pairs = np.empty(WIDTH * n_floats, np.float32)
    field, total = np.empty(n_floats, np.float32), np.empty(n_floats, np.float32)
    share, late = np.empty(n_floats, np.float32), np.empty(n_floats, np.float32)
    stretched = np.empty(n_floats, np.float32)
    for j in range(n_times):
        for part in range(2):
            late[2 * j + part] = late_steps[j]
            stretched[2 * j + part] = stretch[j]
    for m in range(len(out)):
        if factors[m] == 0:
            continue
        for j in range(n_times):
            place = (steps[m] + late_steps[j]) * stretch[j] + middle
            first = np.ceil(place - WIDTH / 2)
            firsts[j] = int(first)
            between = np.float32(2 * (first - place + WIDTH / 2) - 1)
            y[2 * j], y[2 * j + 1] = between, between
        for a in range(WIDTH):
            _weights(pairs, a, y, polynomials)
        total[:] = 0.0
        for f in range(n_fields):
            _interpolate(field, flat, f * n_rows, firsts, pairs)
            _share(share, shares[f], steps[m], late, stretched)
            for j in range(n_floats):
                total[j] += share[j] * field[j]
        factor = np.complex64(factors[m])
        for j in range(n_times):
            real, imag = over_columns[j] * total[2 * j], over_columns[j] * total[2 * j + 1]
            out[m, j] += complex(
                real * factor.real - imag * factor.imag, real * factor.imag + imag * factor.real
            )


@_compiled
def _interpolate(
    field: np.ndarray, grid: np.ndarray, first_row: int, firsts: np.ndarray, pairs: np.ndarray
) -> None:
    """Sums of WIDTH rows of a flat grid, from `firsts` on, at all times."""
    n_floats = len(field)
    for start in range(0, len(firsts), WIDTH):
        stop = min(start + WIDTH, len(firsts))
        row = firsts[start]
        same = stop == start + WIDTH
        for j in range(start + 1, stop):
            same &= firsts[j] == row
        if same:
            place = (first_row + row) * n_floats + 2 * start
            weighted(field, 2 * start, grid, place, n_floats, pairs, n_floats)
            continue
        for j in range(2 * start, 2 * stop):
            place = (first_row + firsts[j // 2]) * n_floats + j
            total = np.float32(0)
            for a in range(WIDTH):
                total += pairs[a * n_floats + j] * grid[place + a * n_floats]
            field[j] = total


@_compiled
def _weights(pairs: np.ndarray, a: int, y: np.ndarray, polynomials: np.ndarray) -> None:
    """Fill weights of the rows in place a of WIDTH, (WIDTH, n_floats)."""
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = (
        polynomials[2 * a], polynomials[TAPS + 2 * a], polynomials[2 * TAPS + 2 * a],
        polynomials[3 * TAPS + 2 * a], polynomials[4 * TAPS + 2 * a],
        polynomials[5 * TAPS + 2 * a], polynomials[6 * TAPS + 2 * a],
        polynomials[7 * TAPS + 2 * a], polynomials[8 * TAPS + 2 * a],
    )  # fmt: skip
    at = np.uint64(a * len(y))
    sign = np.float32(1 - 2 * (a % 2))  # between times, signs do not alternate
    for j in range(np.uint64(len(y))):
        v = y[j]
        weight = ((((((c0 * v + c1) * v + c2) * v + c3) * v + c4) * v + c5) * v + c6) * v + c7
        pairs[at + j] = sign * (weight * v + c8)


@_compiled
def _share(
    share: np.ndarray, of: np.ndarray, step: float, late: np.ndarray, stretched: np.ndarray
) -> None:
    """By which a field is multiplied, as `warp` says."""
    unit, now = np.float32(of[2]), np.float32(step)
    share[:] = 1.0
    for _ in range(int(of[0])):
        for j in range(len(share)):
            share[j] *= (now + late[j]) * unit
    for _ in range(int(of[1])):
        for j in range(len(share)):
            share[j] *= stretched[j]
    if of[1] < 0:
        for j in range(len(share)):
            share[j] *= late[j] * unit
