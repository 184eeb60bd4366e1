"""Direct kernel: the beat signal as a plain sum over scatterers, the reference of the others.

It sums echo by echo in double precision, within 1e-9 of the law in `base` at 50 digits out to 500 m
at 77 GHz. The remaining error is the rounding of the range, 1e-12 of the echo for each metre.

The samples of a chirp are cut into segments on which the phase and the logarithm of the amplitude
are cubic in time to 1e-10, by a bound from the speed of the scatterer past the antennas: one
segment per chirp except for near and fast scatterers. On a segment the echo is exp g, with g a
complex cubic, and is added block by block. With x the middle of a block and y a sample from there,

    exp g(x + y) = exp g(x) I(y),    I(y) *= U(y) from block to block,    U(y) *= V(y).

Sines are therefore computed once for each block and a few times for each position in a block, and
the positions in a block are independent: 0.3 ns for each sample and scatterer with 512-bit vectors.
"""

import math
from typing import Literal, NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.errors import InvalidSetting
from dechirp.core.phasors import phasors
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.simulation.kernels.base import Scatterers, Transmission

# Scatterers whose paths are expanded together: wide vectors, and tables that stay in L2.
_BATCH = 64
# Relative truncation error of a segment's series, and again of the blocks.
_TOLERANCE = 1e-10
# Longest block, and largest number of blocks in a segment: rounding grows with their square, to
# 1e-12.
_WIDTH, _BLOCKS = 64, 128
# Samples that the plain twin sums together.
_PLAIN_BLOCK_SAMPLES = 2**14
# Offsets of the tables: real and imaginary parts of I, U and V for each position, then of exp g for
# each block. Constant unsigned offsets into one array let the compiler see that they do not
# overlap. Views would cost 20 ns each in atomic counts.
_RE_I, _IM_I, _RE_U, _IM_U, _RE_V, _IM_V, _RE_G = (np.uint64(_WIDTH * i) for i in range(7))
_IM_G = np.uint64(6 * _WIDTH + _BLOCKS + 8)

_compiled = kernel(fastmath={"contract"})


class PreviousRamps(NamedTuple):
    """Ramp sent before each chirp, whose echo may still arrive."""

    gaps_s: np.ndarray
    """(n_chirps,): time from the start of the previous ramp to that of this one; NaN: none."""
    weights: np.ndarray
    """(n_chirps, n_tx) complex: weight of each transmitter in the previous ramp."""
    ramp_duration_s: float
    """Duration of a ramp; transmitters are silent from its end to the next start."""

    def select_chirps(self, chirps: slice) -> "PreviousRamps":
        """Return the previous ramps of some of the chirps."""
        return self._replace(gaps_s=self.gaps_s[chirps], weights=self.weights[chirps])


def add_echoes(
    out: np.ndarray,
    scatterers: Scatterers,
    transmission: Transmission,
    *,
    late: Literal["held", "onset", "tail"] = "held",
    previous: PreviousRamps | None = None,
) -> None:
    """Add the echoes of all scatterers to `out`, in place and chirp by chirp.

    Several threads may each process some of the chirps.

    Parameters
    ----------
    out : (n_chirps, n_rx, n_samples), complex64 or complex128
        Echoes are summed in double precision and rounded once.
    scatterers, transmission
        No scatterer may be at an antenna.
    late : {"held", "onset", "tail"}
        Content of samples before the echo arrives, at t_n < tau: the echo, as if the ramp had begun
        earlier; nothing; or the remaining echo of the previous chirp. Relative to the present ramp,
        that one has the delay tau - gap, which replaces tau in the phase and may be negative; its
        size
        is that of the present chirp, except for the weights. Echoes from two chirps ago are
        neglected.
    previous
        Required for the tail.

    Raises
    ------
    InvalidSetting
        If the tail is requested without the previous ramps.
    """
    if late == "tail" and previous is None:
        raise InvalidSetting(
            "previous", value="missing", expected="the ramp before each chirp", fix="pass it"
        )
    n_chirps, n_rx, n_samples = out.shape
    gaps_s, low_s, high_s = np.zeros((3, 2, n_chirps))
    sent_by = np.zeros((2, *transmission.weights.shape), complex)
    # An echo is present for `low <= t_n - tau < high`: this chirp's echo, then the previous one's.
    sent_by[0] = transmission.weights
    low_s[0], high_s[0] = -np.inf if late == "held" else 0.0, np.inf
    if late == "tail" and previous is not None:
        has_one = ~np.isnan(previous.gaps_s)
        sent_by[1] = np.where(has_one[:, None], previous.weights, 0)
        gaps_s[1] = np.where(has_one, previous.gaps_s, 0)
        low_s[1], high_s[1] = -gaps_s[1], np.minimum(previous.ramp_duration_s - gaps_s[1], 0)
    n_scatterers = scatterers.path_m.shape[1]
    factors = scatterers.chirp_factors
    _add_echoes_chirp_by_chirp(
        out,
        np.ascontiguousarray(scatterers.path_m.transpose(0, 2, 1), float),
        np.ascontiguousarray(scatterers.amplitudes, float),
        np.ascontiguousarray(scatterers.tx_gains, float),
        np.ascontiguousarray(scatterers.rx_gains, float),
        np.ones((1, n_scatterers)) if factors is None else np.ascontiguousarray(factors, float),
        np.ascontiguousarray(transmission.starts_s, float),
        abs(sent_by),
        np.angle(sent_by) / (2 * np.pi),
        gaps_s,
        _fractional_cycles(transmission.start_frequency_hz, gaps_s),
        low_s,
        high_s,
        np.ascontiguousarray(transmission.tx_m, float),
        np.ascontiguousarray(transmission.rx_m, float),
        float(transmission.start_frequency_hz),
        float(transmission.slope_hz_per_s),
        float(transmission.adc_start_s),
        float(transmission.sample_rate_hz),
        _zeros_with_aligned_rows((n_rx, 2, n_samples + 2 * _WIDTH)),
        _zeros_with_aligned_rows((6 * _WIDTH + 2 * (_BLOCKS + 8),)),
    )


def estimate_segments_per_chirp(
    scatterers: Scatterers, transmission: Transmission, n_samples: int
) -> float:
    """Estimate the segments per chirp of `add_echoes`, from some scatterers and chirps."""
    n, last = scatterers.path_m.shape[1], len(transmission.starts_s) - 1
    groups = {max(n - _BATCH, 0) * part // 3 for part in range(4)}
    sample = (np.array(sorted(groups))[:, None] + np.arange(min(n, _BATCH))).ravel()
    chirps = [0, last // 2, last]
    return float(
        _mean_segments_per_chirp(
            np.ascontiguousarray(scatterers.path_m[:, sample].transpose(0, 2, 1), float),
            np.ascontiguousarray(transmission.starts_s[chirps], float),
            np.ascontiguousarray(transmission.tx_m, float),
            np.ascontiguousarray(transmission.rx_m, float),
            float(transmission.start_frequency_hz),
            float(transmission.slope_hz_per_s),
            float(transmission.adc_start_s),
            float(transmission.sample_rate_hz),
            n_samples,
        )
    )


def _fractional_cycles(frequency_hz: float, times_s: np.ndarray) -> np.ndarray:
    """Return the fractional part of frequency times time.

    A chirp of 13 us has a million cycles. The factors are split into parts of 24 bits, whose
    product is
    exact; rounding would cost 1e-9 rad.
    """
    high_hz, high_s = float(np.float32(frequency_hz)), times_s.astype(np.float32).astype(float)
    rest = (frequency_hz - high_hz) * high_s + frequency_hz * (times_s - high_s)
    return np.fmod(high_hz * high_s, 1.0) + rest


def _zeros_with_aligned_rows(shape: tuple[int, ...]) -> np.ndarray:
    """Return zeros with rows aligned to 64 bytes: unaligned vectors take twice as long."""
    *outer, inner = shape
    inner = -(-inner // 8) * 8
    size = math.prod(outer) * inner
    zeros = np.zeros(size + 8)
    first = -(zeros.ctypes.data // 8) % 8
    return zeros[first : first + size].reshape(*outer, inner)


def _add_echoes_in_numpy(
    out: np.ndarray,
    path_terms_m: np.ndarray,
    amplitudes: np.ndarray,
    tx_gains: np.ndarray,
    rx_gains: np.ndarray,
    chirp_factors: np.ndarray,
    starts_s: np.ndarray,
    weights: np.ndarray,
    weight_cycles: np.ndarray,
    gaps_s: np.ndarray,
    gap_cycles: np.ndarray,
    low_s: np.ndarray,
    high_s: np.ndarray,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    adc_start_s: float,
    sample_rate_hz: float,
    *_buffers: np.ndarray,
) -> None:
    """Plain twin of `_add_echoes_chirp_by_chirp`: the law in `base`, within 1e-9 of the echoes.

    Sample by sample without series, so that the rounding of the range is the only error: 0.1 us
    for each sample and scatterer. The samples of a block of chirps stay in the L2 cache.
    """
    n_chirps, _, n_samples = out.shape
    on_ramp_s = adc_start_s + np.arange(n_samples) / sample_rate_hz
    block = max(_PLAIN_BLOCK_SAMPLES // n_samples, 1)
    for first in range(0, n_chirps, block):
        m = slice(first, min(first + block, n_chirps))
        times_s = starts_s[m, None] + on_ramp_s
        sums = np.zeros((out.shape[1], *times_s.shape), complex)
        for i, amplitude in enumerate(amplitudes):
            factors = chirp_factors[m if len(chirp_factors) > 1 else slice(None), i, None]
            position_m = _position_at_times(path_terms_m[:, :, i], times_s)
            to_tx_m, to_rx_m = (
                [
                    np.linalg.norm(position_m - antenna[:, None, None], axis=0)
                    for antenna in antennas
                ]
                for antennas in (tx_m, rx_m)
            )
            for turn, j, k in np.ndindex(len(weights), len(tx_m), len(rx_m)):
                if not weights[turn, m, j].any():
                    continue
                delay_s = (to_tx_m[j] + to_rx_m[k]) / SPEED_OF_LIGHT
                behind_s = delay_s - gaps_s[turn, m, None]
                cycles = start_frequency_hz * delay_s
                cycles -= np.floor(cycles)
                cycles += slope_hz_per_s * behind_s * (on_ramp_s - behind_s / 2)
                cycles += weight_cycles[turn, m, j, None] - gap_cycles[turn, m, None]
                gain = amplitude * tx_gains[j, i] * rx_gains[k, i] * weights[turn, m, j, None]
                size = gain * factors / (to_tx_m[j] * to_rx_m[k])
                since_s = on_ramp_s - delay_s
                is_present = (since_s >= low_s[turn, m, None]) & (since_s < high_s[turn, m, None])
                sums[k] += np.where(is_present, size, 0.0) * phasors(cycles)
        out[m] += sums.swapaxes(0, 1)


def _position_at_times(path_terms_m: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """Return the position at each time, (3, *times), from its polynomial (term, axis)."""
    position_m = np.zeros((3, *times_s.shape))
    for term_m in path_terms_m[::-1]:
        position_m = position_m * times_s + term_m[:, None, None]
    return position_m


@kernel(plain=_add_echoes_in_numpy, fastmath={"contract"})
def _add_echoes_chirp_by_chirp(
    out: np.ndarray,
    path_terms_m: np.ndarray,
    amplitudes: np.ndarray,
    tx_gains: np.ndarray,
    rx_gains: np.ndarray,
    chirp_factors: np.ndarray,
    starts_s: np.ndarray,
    weights: np.ndarray,
    weight_cycles: np.ndarray,
    gaps_s: np.ndarray,
    gap_cycles: np.ndarray,
    low_s: np.ndarray,
    high_s: np.ndarray,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    adc_start_s: float,
    sample_rate_hz: float,
    sums: np.ndarray,
    tables: np.ndarray,
) -> None:
    """Sum over chirps, batches of scatterers, segments and antenna pairs, in this order."""
    n_chirps, n_rx, n_samples = out.shape
    n_tx, n_scatterers = len(tx_m), len(amplitudes)
    step_s = 1 / sample_rate_hz
    local = np.empty((12, _BATCH))
    tx_ways, rx_ways = np.empty((n_tx, 8, _BATCH)), np.empty((n_rx, 8, _BATCH))
    echoes = np.empty((12, _BATCH))
    for m in range(n_chirps):
        sums[:] = 0
        varied = m if len(chirp_factors) > 1 else 0
        for i0 in range(0, n_scatterers, _BATCH):
            n = min(_BATCH, n_scatterers - i0)
            middle_s = starts_s[m] + adc_start_s + (n_samples - 1) / 2 * step_s
            _expand_positions_about_time(path_terms_m, i0, n, middle_s, step_s, local)
            longest = _longest_cubic_segment(
                path_terms_m, i0, n, local, middle_s, step_s, n_samples, tx_m, rx_m,
                start_frequency_hz, slope_hz_per_s,
            )  # fmt: skip
            width, length = _block_and_segment_lengths(longest, n_samples)
            for first in range(0, n_samples, length):
                stop = min(first + length, n_samples)
                # An integer sample: removing whole cycles from a step would make halves of them.
                centre = (first + stop) // 2
                on_ramp_s = adc_start_s + centre * step_s
                _expand_positions_about_time(
                    path_terms_m, i0, n, starts_s[m] + on_ramp_s, step_s, local
                )
                for j in range(n_tx):
                    if weights[0, m, j] != 0 or weights[1, m, j] != 0:
                        _expand_ranges_and_log_ranges(local, n, tx_m, j, tx_ways)
                for k in range(n_rx):
                    _expand_ranges_and_log_ranges(local, n, rx_m, k, rx_ways)
                # Present and previous chirp, by transmitter and receiver.
                for path in range(2 * n_tx * n_rx):
                    k, j, turn = path // (2 * n_tx), path // 2 % n_tx, path % 2
                    weight = weights[turn, m, j]
                    if weight == 0:
                        continue
                    _expand_phases_and_amplitudes(
                        tx_ways, j, rx_ways, k, n, gaps_s[turn, m],
                        weight_cycles[turn, m, j] - gap_cycles[turn, m],
                        start_frequency_hz, slope_hz_per_s, on_ramp_s, step_s, echoes,
                    )  # fmt: skip
                    for i in range(n):
                        factor = weight * chirp_factors[varied, i0 + i] * amplitudes[i0 + i]
                        echoes[4, i] *= factor * tx_gains[j, i0 + i] * rx_gains[k, i0 + i]
                    _add_echoes_of_antenna_pair(
                        echoes, n, low_s[turn, m], high_s[turn, m], first, stop, centre, width,
                        adc_start_s, sample_rate_hz, n_samples, sums, k, tables,
                    )  # fmt: skip
        for k in range(n_rx):
            for sample in range(n_samples):
                out[m, k, sample] += complex(sums[k, 0, sample], sums[k, 1, sample])


@kernel(plain=IN_CALLER, fastmath={"contract"})
def _mean_segments_per_chirp(
    path_terms_m: np.ndarray,
    chirp_starts_s: np.ndarray,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    adc_start_s: float,
    sample_rate_hz: float,
    n_samples: int,
) -> float:
    """Return the mean over chirps and scatterers, batched as in `_add_echoes_chirp_by_chirp`."""
    step_s, total, n_scatterers = 1 / sample_rate_hz, 0.0, path_terms_m.shape[2]
    local = np.empty((12, _BATCH))
    for start_s in chirp_starts_s:
        middle_s = start_s + adc_start_s + (n_samples - 1) / 2 * step_s
        for i0 in range(0, n_scatterers, _BATCH):
            n = min(_BATCH, n_scatterers - i0)
            _expand_positions_about_time(path_terms_m, i0, n, middle_s, step_s, local)
            longest = _longest_cubic_segment(
                path_terms_m, i0, n, local, middle_s, step_s, n_samples, tx_m, rx_m,
                start_frequency_hz, slope_hz_per_s,
            )  # fmt: skip
            _, length = _block_and_segment_lengths(longest, n_samples)
            total += n * -(-n_samples // length)
    return total / (len(chirp_starts_s) * n_scatterers)


@_compiled
def _expand_positions_about_time(
    path_terms_m: np.ndarray,
    first_scatterer: int,
    n_scatterers: int,
    time_s: float,
    sample_interval_s: float,
    position_series: np.ndarray,
) -> None:
    """Fill `position_series`: row 3 k + axis is the k-th power of the time in sample steps."""
    for axis in range(3):
        for i in range(n_scatterers):
            p, v, a, b = 0.0, 0.0, 0.0, 0.0
            for term in range(len(path_terms_m) - 1, -1, -1):
                b = b * time_s + a
                a = a * time_s + v
                v = v * time_s + p
                p = p * time_s + path_terms_m[term, axis, first_scatterer + i]
            position_series[axis, i] = p
            position_series[3 + axis, i] = v * sample_interval_s
            position_series[6 + axis, i] = a * sample_interval_s**2
            position_series[9 + axis, i] = b * sample_interval_s**3


@_compiled
def _longest_cubic_segment(
    path_terms_m: np.ndarray,
    first_scatterer: int,
    n_scatterers: int,
    position_series: np.ndarray,
    middle_s: float,
    step_s: float,
    n_samples: int,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
) -> float:
    """Return the samples over which cubic series of phase and amplitude meet the tolerance.

    A scatterer in straight motion by x ranges is at r sqrt(1 + 2 mu x + x^2), whose terms in x^n
    are
    below 2 / (2 n - 1) (Legendre). In the truncated phase, the frequency multiplies the fourth
    power,
    and the slope the third and one more time.
    """
    half = n_samples / 2
    half_s = half * step_s
    swept_hz = abs(slope_hz_per_s) * half_s
    top_hz = start_frequency_hz + 2 * swept_hz
    latest_s = abs(middle_s) + half_s
    worst = 0.0
    for i in range(n_scatterers):
        x, y, z = position_series[0, i], position_series[1, i], position_series[2, i]
        r = np.inf
        for j in range(len(tx_m)):
            r = min(r, _vector_length(x - tx_m[j, 0], y - tx_m[j, 1], z - tx_m[j, 2]))
        for k in range(len(rx_m)):
            r = min(r, _vector_length(x - rx_m[k, 0], y - rx_m[k, 1], z - rx_m[k, 2]))
        v = half * _vector_length(
            position_series[3, i], position_series[4, i], position_series[5, i]
        )
        a = half**2 * _vector_length(
            position_series[6, i], position_series[7, i], position_series[8, i]
        )
        b = half**3 * _vector_length(
            position_series[9, i], position_series[10, i], position_series[11, i]
        )
        rest = 0.0
        for term in range(4, len(path_terms_m)):
            series = term * (term - 1) * (term - 2) * (term - 3) / 24
            size = _vector_length(
                path_terms_m[term, 0, first_scatterer + i],
                path_terms_m[term, 1, first_scatterer + i],
                path_terms_m[term, 2, first_scatterer + i],
            )
            rest += series * size * latest_s ** (term - 4) * half_s**4
        # Least range in this chirp, at least a tenth of the range for a scatterer that passes an
        # antenna.
        r = max(r - v - a - b - rest, r / 10)
        v, a, b, rest = v / r, a / r, b / r, rest / r
        fourth = rest + 2 * v * b + a * a + 3 * v * v * a + 2 / 7 * v**4
        third = b + 2 * v * a + 2 / 5 * v**3
        cycles = 2 * r / SPEED_OF_LIGHT * (top_hz * fourth + swept_hz * third)
        worst = max(worst, 2 * np.pi * cycles + 2 * fourth)
    return n_samples * min(1.0, (_TOLERANCE / max(worst, _TOLERANCE)) ** 0.25)


@_compiled
def _vector_length(x: float, y: float, z: float) -> float:
    return np.sqrt(x * x + y * y + z * z)


@_compiled
def _block_and_segment_lengths(longest_segment: float, n_samples: int) -> tuple[int, int]:
    """Return the samples of a block, and of a segment, a multiple or the whole chirp."""
    # Vectors need 32 positions or more; 64 cost less if there are many blocks.
    width = _WIDTH if longest_segment >= 16 * _WIDTH else _WIDTH // 2
    longest_segment = max(longest_segment, 1.0)
    while width > longest_segment:
        width //= 2
    if longest_segment >= n_samples and n_samples <= width * _BLOCKS:
        return width, n_samples
    most = min(int(longest_segment) // width, _BLOCKS)
    n_blocks = -(-n_samples // width)
    n_segments = -(-n_blocks // most)
    return width, -(-n_blocks // n_segments) * width


@_compiled
def _expand_ranges_and_log_ranges(
    position_series: np.ndarray,
    n_scatterers: int,
    antennas_m: np.ndarray,
    antenna: int,
    range_series: np.ndarray,
) -> None:
    """Expand the range to one antenna and its logarithm in steps, and store 1 / range."""
    for i in range(n_scatterers):
        x, y, z = (
            position_series[0, i] - antennas_m[antenna, 0],
            position_series[1, i] - antennas_m[antenna, 1],
            position_series[2, i] - antennas_m[antenna, 2],
        )
        vx, vy, vz = position_series[3, i], position_series[4, i], position_series[5, i]
        ax, ay, az = position_series[6, i], position_series[7, i], position_series[8, i]
        bx, vel_by, bz = position_series[9, i], position_series[10, i], position_series[11, i]
        r = np.sqrt(x * x + y * y + z * z)
        inverse = 1 / r
        # Power by power from range^2 = |position|^2.
        r1 = (x * vx + y * vy + z * vz) * inverse
        square = vx * vx + vy * vy + vz * vz + 2 * (x * ax + y * ay + z * az)
        r2 = (square - r1 * r1) * (inverse / 2)
        cube = x * bx + y * vel_by + z * bz + vx * ax + vy * ay + vz * az
        r3 = (cube - r1 * r2) * inverse
        u1, u2, u3 = r1 * inverse, r2 * inverse, r3 * inverse
        range_series[antenna, 0, i] = r
        range_series[antenna, 1, i] = r1
        range_series[antenna, 2, i] = r2
        range_series[antenna, 3, i] = r3
        range_series[antenna, 4, i] = inverse
        range_series[antenna, 5, i] = u1
        range_series[antenna, 6, i] = u2 - u1 * u1 / 2
        range_series[antenna, 7, i] = u3 - u1 * u2 + u1 * u1 * u1 / 3


@_compiled
def _expand_phases_and_amplitudes(
    outbound: np.ndarray,
    tx: int,
    inbound: np.ndarray,
    rx: int,
    n_scatterers: int,
    gap_s: float,
    extra_cycles: float,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    on_ramp_s: float,
    step_s: float,
    echo_series: np.ndarray,
) -> None:
    """Fill rows of `echo_series`: cycles 0-3, spreading, its logarithm 1-3, delay 0-3."""
    slope_a_step = slope_hz_per_s * step_s
    for i in range(n_scatterers):
        delay_s = (outbound[tx, 0, i] + inbound[rx, 0, i]) / SPEED_OF_LIGHT
        d1 = (outbound[tx, 1, i] + inbound[rx, 1, i]) / SPEED_OF_LIGHT
        d2 = (outbound[tx, 2, i] + inbound[rx, 2, i]) / SPEED_OF_LIGHT
        d3 = (outbound[tx, 3, i] + inbound[rx, 3, i]) / SPEED_OF_LIGHT
        # Whole cycles are removed before any sum: 26,000 of them at 50 m.
        cycles = start_frequency_hz * delay_s
        cycles -= np.floor(cycles)
        behind_s = delay_s - gap_s  # delay of its own ramp behind the present one
        cycles += extra_cycles + slope_hz_per_s * behind_s * (on_ramp_s - behind_s / 2)
        received_hz = start_frequency_hz + slope_hz_per_s * (on_ramp_s - behind_s)
        a_step = received_hz * d1 + slope_a_step * behind_s
        echo_series[0, i] = cycles - np.floor(cycles)
        echo_series[1, i] = a_step - np.floor(a_step)
        echo_series[2, i] = received_hz * d2 + slope_a_step * d1 - slope_hz_per_s * d1 * d1 / 2
        echo_series[3, i] = received_hz * d3 + slope_a_step * d2 - slope_hz_per_s * d1 * d2
        echo_series[4, i] = outbound[tx, 4, i] * inbound[rx, 4, i]
        echo_series[5, i] = -outbound[tx, 5, i] - inbound[rx, 5, i]
        echo_series[6, i] = -outbound[tx, 6, i] - inbound[rx, 6, i]
        echo_series[7, i] = -outbound[tx, 7, i] - inbound[rx, 7, i]
        echo_series[8, i] = delay_s
        echo_series[9, i] = d1
        echo_series[10, i] = d2
        echo_series[11, i] = d3


@_compiled
def _add_echoes_of_antenna_pair(
    echo_series: np.ndarray,
    n_scatterers: int,
    earliest_s: float,
    latest_s: float,
    segment_start: int,
    segment_stop: int,
    centre_sample: int,
    block_length: int,
    adc_start_s: float,
    sample_rate_hz: float,
    n_samples: int,
    sums: np.ndarray,
    k: int,
    tables: np.ndarray,
) -> None:
    """Add the echoes of one transmitter on one receiver to the samples that contain them."""
    for i in range(n_scatterers):
        first_sample, end = segment_start, segment_stop
        if earliest_s > -np.inf:
            first_sample = _first_sample_after_arrival(
                earliest_s,
                segment_start,
                segment_stop,
                centre_sample,
                echo_series,
                i,
                adc_start_s,
                sample_rate_hz,
            )
        if latest_s < np.inf:
            end = _first_sample_after_arrival(
                latest_s,
                segment_start,
                segment_stop,
                centre_sample,
                echo_series,
                i,
                adc_start_s,
                sample_rate_hz,
            )
        if first_sample < end:
            # A block may extend past the last sample.
            room = sums.shape[2] if end == n_samples else end
            _add_echo_to_segment(
                echo_series,
                i,
                first_sample,
                end,
                room,
                centre_sample,
                block_length,
                sums,
                k,
                tables,
            )


@_compiled
def _first_sample_after_arrival(
    min_time_since_arrival_s: float,
    segment_start: int,
    segment_stop: int,
    centre_sample: int,
    echo_series: np.ndarray,
    scatterer: int,
    adc_start_s: float,
    sample_rate_hz: float,
) -> int:
    """Return the first sample of a segment at least `min_time_since_arrival_s` after its echo.

    The series of the delay is as exact as the delay itself in double precision.
    """
    estimate = (min_time_since_arrival_s + echo_series[8, scatterer] - adc_start_s) * sample_rate_hz
    n = int(min(max(estimate, segment_start), segment_stop))
    while (
        n > segment_start
        and _time_since_arrival_s(
            n - 1, centre_sample, echo_series, scatterer, adc_start_s, sample_rate_hz
        )
        >= min_time_since_arrival_s
    ):
        n -= 1
    while (
        n < segment_stop
        and _time_since_arrival_s(
            n, centre_sample, echo_series, scatterer, adc_start_s, sample_rate_hz
        )
        < min_time_since_arrival_s
    ):
        n += 1
    return n


@_compiled
def _time_since_arrival_s(
    sample: int,
    centre_sample: int,
    echo_series: np.ndarray,
    scatterer: int,
    adc_start_s: float,
    sample_rate_hz: float,
) -> float:
    """Return the time of a sample on its ramp, minus the delay of its echo."""
    h = sample - centre_sample
    delay_s = echo_series[8, scatterer] + h * (
        echo_series[9, scatterer]
        + h * (echo_series[10, scatterer] + h * echo_series[11, scatterer])
    )
    return adc_start_s + sample / sample_rate_hz - delay_s


@_compiled
def _add_echo_to_segment(
    echo_series: np.ndarray,
    scatterer: int,
    segment_start: int,
    segment_stop: int,
    write_stop: int,
    centre_sample: int,
    block_length: int,
    sums: np.ndarray,
    rx: int,
    tables: np.ndarray,
) -> None:
    """Add one echo to samples from `segment_start` on, writing none from `write_stop` on."""
    c0, c1, c2, c3 = (
        echo_series[0, scatterer],
        echo_series[1, scatterer],
        echo_series[2, scatterer],
        echo_series[3, scatterer],
    )
    e1, e2, e3 = echo_series[5, scatterer], echo_series[6, scatterer], echo_series[7, scatterer]
    n_blocks = (segment_stop - segment_start + block_length - 1) // block_length
    w, middle = float(block_length), (block_length - 1) / 2
    x = segment_start + middle - centre_sample
    # With a constant U from the middle and without V, the error is largest half way between first
    # and last block.
    span = n_blocks * w
    steady = 3 / 8 * w * span**2 * (2 * np.pi * abs(c3) + abs(e3)) < _TOLERANCE
    expansion_point = x + (n_blocks / 2 - 1) * w if steady else x
    _tabulate_cubic_exponentials(
        tables, _RE_I, _IM_I, block_length, -middle, 1.0, 1.0,
        0.0, c1 + x * (2 * c2 + 3 * c3 * x), c2 + 3 * c3 * x, c3,
        e1 + x * (2 * e2 + 3 * e3 * x), e2 + 3 * e3 * x, e3,
    )  # fmt: skip
    _tabulate_cubic_exponentials(
        tables, _RE_U, _IM_U, block_length, -middle, 1.0, 1.0,
        0.0, w * (2 * c2 + 3 * c3 * (w + 2 * expansion_point)), 3 * c3 * w, 0.0,
        w * (2 * e2 + 3 * e3 * (w + 2 * expansion_point)), 3 * e3 * w, 0.0,
    )  # fmt: skip
    if not steady:
        _tabulate_cubic_exponentials(
            tables, _RE_V, _IM_V, block_length, -middle, 1.0, 1.0,
            0.0, 6 * c3 * w * w, 0.0, 0.0, 6 * e3 * w * w, 0.0, 0.0,
        )  # fmt: skip
    # A whole vector of blocks: scalar code would process a remainder.
    _tabulate_cubic_exponentials(
        tables, _RE_G, _IM_G, (n_blocks + 7) // 8 * 8, x, w, echo_series[4, scatterer],
        c0, c1, c2, c3, e1, e2, e3,
    )  # fmt: skip
    whole = min(n_blocks, (write_stop - segment_start) // block_length)
    _add_phasor_blocks_and_advance_tables(
        sums, rx, segment_start, block_length, 0, whole, block_length, steady, tables
    )
    if whole < n_blocks:
        first_sample = segment_start + whole * block_length
        _add_phasor_blocks_and_advance_tables(
            sums,
            rx,
            first_sample,
            write_stop - first_sample,
            whole,
            1,
            block_length,
            steady,
            tables,
        )


@_compiled
def _add_phasor_blocks_and_advance_tables(
    sums: np.ndarray,
    rx: int,
    first_sample: int,
    samples_per_block: int,
    first_block: int,
    n_blocks: int,
    block_length: int,
    steady: bool,
    tables: np.ndarray,
) -> None:
    """Add blocks from `first_sample` on, and advance the tables after each.

    Two loops: vectors of a combined loop would need more checks than short blocks pay for.
    """
    row, real, imaginary = np.uint64(rx), np.uint64(0), np.uint64(1)
    for s in range(n_blocks):
        re = tables[_RE_G + np.uint64(first_block + s)]
        im = tables[_IM_G + np.uint64(first_block + s)]
        start = np.uint64(first_sample + s * block_length)
        for y in range(np.uint64(samples_per_block)):
            a, b = tables[_RE_I + y], tables[_IM_I + y]
            c, d = tables[_RE_U + y], tables[_IM_U + y]
            sums[row, real, start + y] += re * a - im * b
            sums[row, imaginary, start + y] += re * b + im * a
            tables[_RE_I + y] = a * c - b * d
            tables[_IM_I + y] = a * d + b * c
        if not steady:
            for y in range(np.uint64(samples_per_block)):
                a, b = tables[_RE_U + y], tables[_IM_U + y]
                c, d = tables[_RE_V + y], tables[_IM_V + y]
                tables[_RE_U + y] = a * c - b * d
                tables[_IM_U + y] = a * d + b * c


# Taylor series of sine and cosine of pi x, to 1e-14 at half a cycle.
_S0, _S1, _S2, _S3, _S4, _S5, _S6, _S7, _S8, _S9 = (
    (-1) ** k * math.pi ** (2 * k + 1) / math.factorial(2 * k + 1) for k in range(10)
)
_C0, _C1, _C2, _C3, _C4, _C5, _C6, _C7, _C8, _C9 = (
    (-1) ** k * math.pi ** (2 * k) / math.factorial(2 * k) for k in range(10)
)


@_compiled
def _tabulate_cubic_exponentials(
    tables: np.ndarray,
    real_offset: np.uint64,
    imag_offset: np.uint64,
    n: int,
    first: float,
    step: float,
    scale: float,
    c0: float,
    c1: float,
    c2: float,
    c3: float,
    e1: float,
    e2: float,
    e3: float,
) -> None:
    """Fill the parts of size exp(2 pi i c(y) + e(y)) for n equal steps of y, with e below 0.01.

    Series of the half angle, which the compiler vectorises: 0.5 ns each.
    """
    for position in range(np.uint64(n)):
        y = first + step * position
        cycles = c0 + y * (c1 + y * (c2 + y * c3))
        x = cycles - np.floor(cycles + 0.5)
        q = x * x
        s = _S4 + q * (_S5 + q * (_S6 + q * (_S7 + q * (_S8 + q * _S9))))
        s = x * (_S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * s))))
        c = _C4 + q * (_C5 + q * (_C6 + q * (_C7 + q * (_C8 + q * _C9))))
        c = _C0 + q * (_C1 + q * (_C2 + q * (_C3 + q * c)))
        e = y * (e1 + y * (e2 + y * e3))
        amplitude = scale * (1 + e * (1 + e / 2 * (1 + e / 3 * (1 + e / 4))))
        tables[real_offset + position] = amplitude * (1 - 2 * s * s)
        tables[imag_offset + position] = amplitude * (2 * s * c)
