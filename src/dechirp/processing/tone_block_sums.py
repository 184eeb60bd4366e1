"""Block sums of samples, in which tones are estimated and subtracted instead of in the samples.

The samples of a channel, demodulated at a frequency near that of a tone, are summed into at most
16 x 16 blocks of chirps and samples: one pass over the samples for each tone, after which
estimating a frequency takes microseconds. What another tone adds to the sums is known in closed
form.

`rows` and `columns` are the edges of the blocks along chirps and samples, `slow` and `fast` the
frequencies along them, rad per chirp and sample.
"""

import cmath
import math
from functools import lru_cache

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel

# Blocks per axis: the phase of a tone 0.3 bins off changes by 7 degrees within a block, which
# costs 0.05 % of its amplitude.
_N_BLOCKS = 16
# Phase over half a block below which a second moment is that of a constant, within 1e-6: the
# quotient by its square would lose digits.
_MIN_PHASE_OF_QUOTIENT = 1e-3


@lru_cache(maxsize=64)
def block_edges(n_points: int) -> np.ndarray:
    """Return the first point of each block, and the number of points, (blocks + 1,)."""
    edges = np.linspace(0, n_points, min(n_points, _N_BLOCKS) + 1).round().astype(np.int64)
    edges.setflags(write=False)
    return edges


@lru_cache(maxsize=64)
def block_centres(n_points: int) -> np.ndarray:
    """Return the middle of each block relative to the middle of all, (blocks,)."""
    edges = block_edges(n_points)
    centres = np.asarray((edges[1:] + edges[:-1] - n_points) / 2)
    centres.setflags(write=False)
    return centres


def walk_phase_pattern(rows: np.ndarray, columns: np.ndarray, interval_ratio: float) -> np.ndarray:
    """Return the phase of a walk of 1 rad per chirp and sample at the blocks, (rows, columns).

    r chirps and c samples after mid-frame, r + interval_ratio c repetitions have passed, in which
    the target moves; the frequency sent is c steps from the mean. The phase of the motion is their
    product. `interval_ratio`: see `refine.refine_tones_and_residuals`.
    """
    from_row, from_column = block_centres(int(rows[-1])), block_centres(int(columns[-1]))
    return np.asarray((from_row[:, None] + interval_ratio * from_column) * from_column)


def _demodulated_block_sums_in_numpy(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    fast: float,
    walk: float,
    interval_ratio: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """Plain twin of `demodulated_block_sums`: equal within 1e-6 of the largest sum."""
    n_chirps, _, n_numbers = numbers.shape
    samples = numbers if n_numbers == n_samples else numbers.view(np.complex64)
    phase = fast * np.arange(n_samples)
    if walk:
        m = np.arange(n_chirps)[:, None, None] - (n_chirps - 1) / 2
        p = m - np.repeat(block_centres(n_chirps), np.diff(rows))[:, None, None]
        c = np.repeat(block_centres(n_samples), np.diff(columns))
        q = np.arange(n_samples) - (n_samples - 1) / 2 - c
        phase = phase + walk * ((m + 2 * interval_ratio * c) * q + p * c)
    turned = samples * np.exp(-1j * phase).astype(np.complex64)
    sums = np.add.reduceat(turned, columns[:-1], axis=2, dtype=complex)
    sums *= np.exp(-1j * slow * np.arange(n_chirps))[:, None, None]
    return np.ascontiguousarray(np.add.reduceat(sums, rows[:-1], axis=0).transpose(1, 0, 2))


@kernel(plain=_demodulated_block_sums_in_numpy, fastmath={"contract", "reassoc"})
def demodulated_block_sums(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    fast: float,
    walk: float,
    interval_ratio: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """Sum blocks of samples times exp(-i (slow m + fast n)), (rx, rows, columns).

    One pass over the samples takes half as long again as to read them: the chirps of a block are
    summed first. Then the real part is the product of re, im, re, im ... with cos, sin, cos, sin
    ..., the imaginary part that with -sin, cos, -sin, cos ...; real samples have neither im nor
    every other factor.

    A `walk`, rad per chirp and sample, is compensated within each block, relative to its middle,
    see `subtract_tone`: that of 20 cells would take a third of the amplitude. It takes one complex
    product for each sample and chirp, and the sums of each chirp by itself: twice as long or more.
    """
    if walk != 0:
        return _walking_block_sums(
            numbers, n_samples, slow, fast, walk, interval_ratio, rows, columns
        )
    n_chirps, n_rx, n_numbers = numbers.shape
    # Four arrays, not one of four rows: the compiler must know that they do not overlap.
    to_real, to_imaginary = np.empty(n_numbers, np.float32), np.empty(n_numbers, np.float32)
    by_cosine, by_sine = np.empty(n_numbers, np.float32), np.empty(n_numbers, np.float32)
    _write_factors_of_numbers(np.exp(-1j * fast * np.arange(n_samples)), to_real, to_imaginary)
    turns = np.exp(-1j * slow * np.arange(n_chirps))
    cosines, sines = turns.real.astype(np.float32), turns.imag.astype(np.float32)
    edges = columns * (n_numbers // n_samples)
    out = np.empty((n_rx, len(rows) - 1, len(columns) - 1), np.complex128)
    for row in range(len(rows) - 1):
        for k in range(n_rx):
            sum_chirps_times_cosines_and_sines(
                numbers, k, 0, rows[row], rows[row + 1], cosines, sines, by_cosine, by_sine
            )
            for column in range(len(columns) - 1):
                start, stop = edges[column], edges[column + 1]
                a, b = by_cosine[start:stop], by_sine[start:stop]
                u, v = to_real[start:stop], to_imaginary[start:stop]
                real, imaginary = np.float32(0.0), np.float32(0.0)
                for i in range(a.size):
                    real += a[i] * u[i] - b[i] * v[i]
                    imaginary += a[i] * v[i] + b[i] * u[i]
                out[k, row, column] = complex(real, imaginary)
    return out


@kernel(fastmath={"contract", "reassoc"})
def _walking_block_sums(
    numbers: np.ndarray,
    n_samples: int,
    slow: float,
    fast: float,
    walk: float,
    interval_ratio: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    """Sum blocks as `demodulated_block_sums` does, with a walk."""
    n_chirps, n_rx, n_numbers = numbers.shape
    n_columns = len(columns) - 1
    edges = columns * (n_numbers // n_samples)
    to_real, to_imaginary = np.empty((2, n_numbers), np.float32)
    turns = np.empty(n_columns, np.complex128)
    # Of each sample in the first chirp, and from chirp to chirp.
    phasors, steps = np.empty(n_samples, np.complex128), np.empty(n_samples, np.complex128)
    for column in range(n_columns):
        c = (columns[column] + columns[column + 1] - n_samples) / 2
        for n in range(columns[column], columns[column + 1]):
            from_middle = walk * (n - (n_samples - 1) / 2 - c)
            angle = fast * n + (2 * interval_ratio * c - (n_chirps - 1) / 2) * from_middle
            phasors[n] = complex(np.cos(angle), -np.sin(angle))
            steps[n] = complex(np.cos(from_middle), -np.sin(from_middle))
    out = np.zeros((n_rx, len(rows) - 1, n_columns), np.complex128)
    for row in range(len(rows) - 1):
        middle = (rows[row] + rows[row + 1] - 1) / 2
        for m in range(rows[row], rows[row + 1]):
            _write_factors_of_numbers(phasors, to_real, to_imaginary)
            for n in range(n_samples):
                phasors[n] *= steps[n]
            for column in range(n_columns):
                c = (columns[column] + columns[column + 1] - n_samples) / 2
                turns[column] = np.exp(-1j * (slow * m + walk * c * (m - middle)))
            for k in range(n_rx):
                for column in range(n_columns):
                    start, stop = edges[column], edges[column + 1]
                    a, u, v = (
                        numbers[m, k, start:stop],
                        to_real[start:stop],
                        to_imaginary[start:stop],
                    )
                    real, imaginary = np.float32(0.0), np.float32(0.0)
                    for i in range(a.size):
                        real += a[i] * u[i]
                        imaginary += a[i] * v[i]
                    out[k, row, column] += turns[column] * complex(real, imaginary)
    return out


@kernel(fastmath={"contract"})
def _write_factors_of_numbers(
    phasors: np.ndarray, to_real: np.ndarray, to_imaginary: np.ndarray
) -> None:
    """Write the factors that give real and imaginary part of samples times phasors."""
    per_sample = to_real.size // phasors.size
    for n in range(phasors.size):
        value, at = phasors[n], n * per_sample
        to_real[at], to_imaginary[at] = value.real, value.imag
        if per_sample == 2:
            to_real[at + 1], to_imaginary[at + 1] = -value.imag, value.real


@kernel(fastmath={"contract"})
def sum_chirps_times_cosines_and_sines(
    numbers: np.ndarray,
    channel: int,
    start: int,
    first_chirp: int,
    stop_chirp: int,
    cosines: np.ndarray,
    sines: np.ndarray,
    by_cosine: np.ndarray,
    by_sine: np.ndarray,
) -> None:
    """Set sums over some chirps of the numbers from `start` on, times those of the chirps.

    Four chirps at once: the sums are then read and written a fourth as often.
    """
    n = by_cosine.size
    by_cosine[:] = 0.0
    by_sine[:] = 0.0
    for m in range(first_chirp, stop_chirp - 3, 4):
        c0, c1, c2, c3 = cosines[m], cosines[m + 1], cosines[m + 2], cosines[m + 3]
        s0, s1, s2, s3 = sines[m], sines[m + 1], sines[m + 2], sines[m + 3]
        x0 = numbers[m, channel, start : start + n]
        x1 = numbers[m + 1, channel, start : start + n]
        x2 = numbers[m + 2, channel, start : start + n]
        x3 = numbers[m + 3, channel, start : start + n]
        for i in range(n):
            by_cosine[i] += c0 * x0[i] + c1 * x1[i] + c2 * x2[i] + c3 * x3[i]
            by_sine[i] += s0 * x0[i] + s1 * x1[i] + s2 * x2[i] + s3 * x3[i]
    for m in range(stop_chirp - (stop_chirp - first_chirp) % 4, stop_chirp):
        x0 = numbers[m, channel, start : start + n]
        for i in range(n):
            by_cosine[i] += cosines[m] * x0[i]
            by_sine[i] += sines[m] * x0[i]


@kernel(plain=AS_WRITTEN)
def _scale_to_walk_series(moments: np.ndarray, walk: float) -> np.ndarray:
    """Scale moments to the coefficients of a series for the sums of a walking tone.

    `moments`: see `_tone_block_moments`; they are changed in place, and returned. `walk` is in rad
    per chirp and sample. At c from the middle on the other axis, the phase of a
    point n from the middle of its block changes by walk c n: the sum becomes s0 + s1 c + s2 c^2,
    and the first moment its slope over i walk.
    """
    moments[1] *= 1j * walk
    moments[2] *= -(walk**2) / 2
    return moments


def _tone_block_moments_in_numpy(frequency: float, edges: np.ndarray) -> np.ndarray:
    """Plain twin of `_tone_block_moments`."""
    half = math.remainder(frequency, math.tau) / 2
    lengths = edges[1:] - edges[:-1]
    mean_squares = (lengths**2 - 1) / 12
    # The quotients below lose half of the digits where half a step is 1e-8.
    if abs(half) < 1e-5:
        sums = lengths * np.exp(1j * half * (edges[1:] + edges[:-1] - 1))
        return np.stack([sums, 2j * half * mean_squares * sums, mean_squares * sums])
    ends = np.exp(2j * half * edges) / (2j * math.sin(half) * cmath.exp(1j * half))
    sums = ends[1:] - ends[:-1]
    firsts = lengths * (ends[1:] + ends[:-1]) / 2 + 0.5j / math.tan(half) * sums
    seconds = np.where(
        abs(half) * lengths < _MIN_PHASE_OF_QUOTIENT,
        mean_squares * sums,
        3 * mean_squares * sums + 1j / math.tan(half) * firsts,
    )
    return np.stack([sums, firsts, seconds])


@kernel(plain=_tone_block_moments_in_numpy)
def _tone_block_moments(frequency: float, edges: np.ndarray) -> np.ndarray:
    """Sum (n - n0)^k exp(i frequency n) over each block, k = 0, 1 and 2, (3, blocks).

    n0 is the middle of the block. They are sin(L h) / sin(h) for L points, h half the frequency,
    and its derivatives.
    """
    moments = np.empty((3, edges.size - 1), np.complex128)
    half = frequency / 2 - np.pi * np.round(frequency / (2 * np.pi))
    is_still, sine, cosine = abs(half) < 1e-9, np.sin(half), np.cos(half)
    length, response, slope, curvature = 0, 0.0, 0.0, 0.0
    # A loop: `np.diff` and sums of arrays take 3 s more to compile.
    for k in range(edges.size - 1):
        if edges[k + 1] - edges[k] != length:  # most blocks have that of the last one
            length = edges[k + 1] - edges[k]
            response, slope = float(length), 0.0
            if not is_still:
                response = np.sin(half * length) / sine
                slope = (length * np.cos(half * length) - response * cosine) / (2 * sine)
            curvature = (1 - length**2) / 12 * response
            if abs(half) * length > _MIN_PHASE_OF_QUOTIENT:
                curvature = 3 * curvature - slope * cosine / sine
        turn = np.exp(1j * half * (edges[k + 1] + edges[k] - 1))
        moments[0, k], moments[1, k] = response * turn, -1j * slope * turn
        moments[2, k] = -curvature * turn
    return moments


def _blockwise_demodulation_gain_in_numpy(frequency: float, edges: np.ndarray) -> float:
    """Plain twin of `blockwise_demodulation_gain`."""
    centres = (edges[1:] + edges[:-1] - 1) / 2
    return float(
        np.sum(_tone_block_moments(frequency, edges)[0] * np.exp(-1j * frequency * centres)).real
    )


@kernel(plain=_blockwise_demodulation_gain_in_numpy)
def blockwise_demodulation_gain(frequency: float, edges: np.ndarray) -> float:
    """Return the sum of a unit tone demodulated block by block: a little less than N."""
    gain = 0.0
    tones = _tone_block_moments(frequency, edges)[0]
    for k in range(tones.size):
        centre = (edges[k + 1] + edges[k] - 1) / 2
        gain += (tones[k] * np.exp(-1j * frequency * centre)).real
    return gain


@kernel(plain=AS_WRITTEN)
def blockwise_walk_gain(walk: float, rows: np.ndarray, columns: np.ndarray) -> float:
    """Return the share of the amplitude of a tone that its walk leaves in its sums.

    `walk`, rad per chirp and sample, is compensated at the middle (r, c) of a block of P x Q points
    but changes the phase within it by walk c p and walk r q. With their mean squares 2 x, the share
    on an axis, Si(z) / z with z^2 = 18 x, is within 2 % of 1 / (1 + x) up to 20 cells within the
    frame. One cell costs 0.001 of the amplitude.
    """
    n_row_blocks, n_column_blocks = rows.size - 1, columns.size - 1
    n_rows, n_columns = float(rows[-1]), float(columns[-1])
    over_rows = (walk * n_columns) ** 2 * ((n_rows / n_row_blocks) ** 2 - 1) / 288
    over_columns = (walk * n_rows) ** 2 * ((n_columns / n_column_blocks) ** 2 - 1) / 288
    return 1 / ((1 + over_rows) * (1 + over_columns))


def _periodogram_moments_in_numpy(
    sums: np.ndarray, rows: np.ndarray, columns: np.ndarray, slow: float, fast: float
) -> np.ndarray:
    """Plain twin of `periodogram_moments`."""
    p, q = (rows[1:] + rows[:-1] - 1) / 2, (columns[1:] + columns[:-1] - 1) / 2
    turn_p, turn_q = np.exp(-1j * slow * p), np.exp(-1j * fast * q)
    p, q = p - (rows[-1] - 1) / 2, q - (columns[-1] - 1) / 2
    powers_p, powers_q = turn_p * (np.ones_like(p), p, p * p), turn_q * (np.ones_like(q), q, q * q)
    moments = powers_p @ sums @ powers_q.T
    return np.stack([moments[:, i, j] for i, j in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))])


@kernel(plain=_periodogram_moments_in_numpy, fastmath={"contract", "reassoc"})
def periodogram_moments(
    sums: np.ndarray, rows: np.ndarray, columns: np.ndarray, slow: float, fast: float
) -> np.ndarray:
    """Sum p^i q^j y exp(-i (slow p + fast q)): orders 00 10 01 20 11 02, (6, rx).

    p and q count from the middle of the aperture; a factor of unit modulus, the phase of the
    middle, is restored, so that order 00 has the phase of the periodogram.
    """
    p = (rows[1:] + rows[:-1] - 1) / 2
    q = (columns[1:] + columns[:-1] - 1) / 2
    turn_p, turn_q = np.exp(-1j * slow * p), np.exp(-1j * fast * q)
    p, q = p - (rows[-1] - 1) / 2, q - (columns[-1] - 1) / 2
    out = np.zeros((6, sums.shape[0]), np.complex128)
    for k in range(sums.shape[0]):
        for a in range(p.size):
            row_sum, row_sum_q, row_sum_qq = 0j, 0j, 0j
            for b in range(q.size):
                z = sums[k, a, b] * turn_q[b]
                row_sum += z
                row_sum_q += q[b] * z
                row_sum_qq += q[b] * q[b] * z
            row_sum *= turn_p[a]
            row_sum_q *= turn_p[a]
            out[0, k] += row_sum
            out[1, k] += p[a] * row_sum
            out[2, k] += row_sum_q
            out[3, k] += p[a] * p[a] * row_sum
            out[4, k] += p[a] * row_sum_q
            out[5, k] += row_sum_qq * turn_p[a]
    return out


def _subtract_tone_in_numpy(
    sums: np.ndarray,
    amplitude: np.ndarray,
    apart_slow: float,
    apart_fast: float,
    channel_fast: np.ndarray,
    walk: float,
    walk_apart: float,
    amplitude_growth: float,
    interval_ratio: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Plain twin of `subtract_tone`."""
    n_chirps, n_samples = int(rows[-1]), int(columns[-1])
    from_row, from_column = block_centres(n_chirps)[:, None], block_centres(n_samples)
    shifted_row = from_row + 2 * interval_ratio * from_column
    turn = np.exp((1j * walk_apart) * walk_phase_pattern(rows, columns, interval_ratio))
    moments = _tone_block_moments(apart_slow, rows)
    gain = 1 + amplitude_growth * from_row[:, 0]
    moments[:2] = gain * moments[:2] + amplitude_growth * moments[1:]
    moments[2] *= gain
    row = _scale_to_walk_series(moments, walk)[:, :, None]
    row_sum = row[0] + from_column * (row[1] + from_column * row[2])
    row_slope = row[1] + 2 * from_column * row[2]
    for k, shift in enumerate(channel_fast.tolist()):
        column = _scale_to_walk_series(_tone_block_moments(apart_fast + shift, columns), walk)
        tone = row_sum * (column[0] + shifted_row * (column[1] + shifted_row * column[2]))
        if walk:
            tone += row_slope * (column[1] + 2 * shifted_row * column[2]) / (1j * walk)
        sums[k] -= amplitude[k] * cmath.exp(-0.5j * shift * (n_samples - 1)) * turn * tone


@kernel(plain=_subtract_tone_in_numpy)
def subtract_tone(
    sums: np.ndarray,
    amplitude: np.ndarray,
    apart_slow: float,
    apart_fast: float,
    channel_fast: np.ndarray,
    walk: float,
    walk_apart: float,
    amplitude_growth: float,
    interval_ratio: float,
    rows: np.ndarray,
    columns: np.ndarray,
) -> None:
    """Subtract a tone from block sums, in place.

    Parameters
    ----------
    sums : array (channel, rows, columns), complex
    amplitude : array (channel,), complex
    apart_slow, apart_fast : float
        Frequencies relative to those of the demodulation.
    channel_fast : array (channel,)
        Frequencies in the channels relative to `apart_fast`.
    walk, walk_apart : float
        Walk of the tone, rad per chirp and sample, less that compensated in the sums: within
        blocks, and at their middles, see `walk_phase_pattern`.
    amplitude_growth : float
        Growth of the amplitude per chirp, relative to its mean.
    interval_ratio : float
        See `refine.refine_tones_and_residuals`.
    rows, columns : arrays
        Edges of the blocks.

    Notes
    -----
    In a block with the middle (r, c), the walk w turns the phase at (r + p, c + q) by
    w ((r + i c) c + (r + 2 i c) q + c p + p q), with the interval ratio i. w i q^2 is left out: its
    mean is a phase of the amplitude, and the rest is below 1e-4 rad for a cell of walk in 128
    chirps, 1e-3 in eight. The last three terms, at most 0.2 rad for each cell that the tone walks
    within the frame, are added to second order by the moments of p and q: without them a tone 16,
    32, ... bins away, whose block sums vanish, leaves a tone at the frequency sought. The error is
    4e-6 of a block for half a cell of `walk`, 1.3e-4 for two cells, 1e-2 for eight. Where the walk
    changes the phase at the corners of the frame by 0.1 rad, the error of a target 80 dB below is
    0.015 bins; without compensation 0.25.
    """
    from_row = (rows[1:] + rows[:-1] - rows[-1]) / 2
    from_column = (columns[1:] + columns[:-1] - columns[-1]) / 2
    moments = _tone_block_moments(apart_slow, rows)
    for a in range(from_row.size):
        gain = 1 + amplitude_growth * from_row[a]
        moments[0, a] = gain * moments[0, a] + amplitude_growth * moments[1, a]
        moments[1, a] = gain * moments[1, a] + amplitude_growth * moments[2, a]
        moments[2, a] *= gain
    row = _scale_to_walk_series(moments, walk)
    # Over i walk, a scaled first moment is itself again; the product of two keeps one factor.
    inverse_step = 0j if walk == 0 else 1 / (1j * walk)
    turns = np.empty((from_row.size, from_column.size), np.complex128)
    for a in range(from_row.size):
        for b in range(from_column.size):
            angle = walk_apart * (from_row[a] + interval_ratio * from_column[b]) * from_column[b]
            turns[a, b] = complex(np.cos(angle), np.sin(angle))
    tone = np.empty_like(turns)
    subtracted_shift = np.nan
    for k in range(amplitude.size):
        shift = channel_fast[k]
        if shift != subtracted_shift:
            subtracted_shift = shift
            column = _scale_to_walk_series(_tone_block_moments(apart_fast + shift, columns), walk)
            for a in range(from_row.size):
                for b in range(from_column.size):
                    c, r = from_column[b], from_row[a] + 2 * interval_ratio * from_column[b]
                    row_sum = row[0, a] + c * (row[1, a] + c * row[2, a])
                    column_sum = column[0, b] + r * (column[1, b] + r * column[2, b])
                    slopes = (row[1, a] + 2 * c * row[2, a]) * (column[1, b] + 2 * r * column[2, b])
                    tone[a, b] = (row_sum * column_sum + inverse_step * slopes) * turns[a, b]
        value = amplitude[k] * np.exp(-0.5j * shift * (columns[-1] - 1))
        for a in range(from_row.size):
            for b in range(from_column.size):
                sums[k, a, b] -= value * tone[a, b]


def _highest_power_beside_in_numpy(
    sums: np.ndarray, slow: float, fast: float, rows: np.ndarray, columns: np.ndarray
) -> tuple[float, float]:
    """Plain twin of `highest_power_beside`."""
    turn_rows = np.exp(-0.5j * slow * (rows[1:] + rows[:-1] - 1))
    turn_columns = np.exp(-0.5j * fast * (columns[1:] + columns[:-1] - 1))
    turned = sums * turn_rows[:, None] * turn_columns
    scale = 1.0 / (float(rows[-1]) * columns[-1]) ** 2
    return (
        _highest_bin_power(turned.sum(axis=2)) * scale,
        _highest_bin_power(turned.sum(axis=1)) * scale,
    )


@kernel(plain=_highest_power_beside_in_numpy)
def highest_power_beside(
    sums: np.ndarray, slow: float, fast: float, rows: np.ndarray, columns: np.ndarray
) -> tuple[float, float]:
    """Return the highest power in whole bins beside an offset, along slow and along fast time.

    `sums` (channel, rows, columns); mean of |amplitude|^2 over the channels.
    """
    n_channels, n_rows, n_columns = sums.shape
    row_sums = np.zeros((n_channels, n_rows), np.complex128)
    column_sums = np.zeros((n_channels, n_columns), np.complex128)
    turn_rows = np.exp(-0.5j * slow * (rows[1:] + rows[:-1] - 1))
    turn_columns = np.exp(-0.5j * fast * (columns[1:] + columns[:-1] - 1))
    for k in range(n_channels):
        for a in range(n_rows):
            for b in range(n_columns):
                row_sums[k, a] += sums[k, a, b] * turn_columns[b]
                column_sums[k, b] += sums[k, a, b] * turn_rows[a]
        for a in range(n_rows):
            row_sums[k, a] *= turn_rows[a]
        for b in range(n_columns):
            column_sums[k, b] *= turn_columns[b]
    scale = 1.0 / (float(rows[-1]) * columns[-1]) ** 2
    return _highest_bin_power(row_sums) * scale, _highest_bin_power(column_sums) * scale


def _highest_bin_power_in_numpy(values: np.ndarray) -> float:
    """Plain twin of `_highest_bin_power`."""
    power = np.mean(abs(np.fft.fft(values, axis=1)) ** 2, axis=0)
    return float(power[1:].max(initial=0.0))


@kernel(plain=_highest_bin_power_in_numpy)
def _highest_bin_power(values: np.ndarray) -> float:
    """Return the highest power in a bin of the transform over blocks, except the first bin.

    `values` (channel, block); the power is the mean over the channels.
    """
    n_channels, n = values.shape
    turns = np.exp(-2j * np.pi * np.arange(n) / n)
    highest = 0.0
    for j in range(1, n):
        power = 0.0
        for k in range(n_channels):
            total, turn = 0j, 0
            for b in range(n):
                total += values[k, b] * turns[turn]
                turn += j
                if turn >= n:
                    turn -= n
            power += total.real**2 + total.imag**2
        highest = max(highest, power / n_channels)
    return highest
