"""The beat signal as a plain sum over scatterers: the kernel the others are measured by.

Echo by echo in double precision, within 1e-9 of the law in `base` at 50 digits out to 500 m
at 77 GHz. What is left is the rounding of the range, 1e-12 of the echo for each metre.

The samples of a chirp are cut into segments on which phase and logarithm of the amplitude
are cubic in time to 1e-10, by a bound from how fast the scatterer passes the antennas: one
segment a chirp but for near and fast ones. On a segment the echo is exp g, g a complex
cubic, and is added block by block. With x the middle of a block and y a sample from there,

    exp g(x + y) = exp g(x) I(y),    I(y) *= U(y) from block to block,    U(y) *= V(y).

So sines are taken once for each block and some times for each place in a block, and the
places in a block do not wait for each other: 0.3 ns for each sample and scatterer where
vectors are 512 bits wide.
"""

import math
from typing import Literal, NamedTuple

import numba
import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.echoes.kernels.base import Scatterers, Sent

# Scatterers whose paths are expanded together: wide vectors, and tables that stay in L2.
_TOGETHER = 64
# Of an echo: what its series may leave out on a segment, and again what the blocks may.
_TOLERANCE = 1e-10
# Longest block, and most blocks of a segment: rounding grows with their square, to 1e-12.
_WIDTH, _BLOCKS = 64, 128
# Where the tables begin: real and imaginary parts of I, U and V for each place, then of
# exp g for each block. One array, constant places in it, all unsigned: the compiler sees that
# they do not overlap. Views would cost 20 ns each in atomic counts.
_RE_I, _IM_I, _RE_U, _IM_U, _RE_V, _IM_V, _RE_G = (np.uint64(_WIDTH * i) for i in range(7))
_IM_G = np.uint64(6 * _WIDTH + _BLOCKS + 8)

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})


class Before(NamedTuple):
    """What was sent before each chirp, whose echo may still be in the air."""

    gaps_s: np.ndarray
    """(n_chirps,): from the start of the previous ramp to that of this one; nan: there is none."""
    weights: np.ndarray
    """(n_chirps, n_tx) complex: what each transmitter sent of the previous ramp."""
    ramp_duration_s: float
    """From the end of the ramp to the start of the next, transmitters are silent."""

    def of(self, chirps: slice) -> "Before":
        """The same for some of the chirps."""
        return self._replace(gaps_s=self.gaps_s[chirps], weights=self.weights[chirps])


def add(
    out: np.ndarray,
    scatterers: Scatterers,
    sent: Sent,
    *,
    late: Literal["held", "onset", "tail"] = "held",
    before: Before | None = None,
) -> None:
    """Add the echoes of all scatterers to `out`, in place and chirp by chirp.

    Several threads may each add to a part of the chirps.

    Parameters
    ----------
    out : (n_chirps, n_rx, n_samples), complex64 or complex128
        Echoes are summed in double precision and rounded once.
    scatterers, sent
        None of the scatterers at an antenna.
    late : {"held", "onset", "tail"}
        Samples before the echo arrives, at t_n < tau, hold it as if the ramp had begun
        earlier; or nothing; or what is left of the echo of the previous chirp. That one has
        the delay tau - gap against the present ramp, which takes the place of tau in the
        phase and may be negative; its size is that of the present chirp, but for the weights.
        Echoes from two chirps ago are left out.
    before
        Needed for the tail.

    Raises
    ------
    InvalidSetting
        If the tail is wanted without saying what was sent before.
    """
    if late == "tail" and before is None:
        raise InvalidSetting(
            "before", got="none", need="what was sent before each chirp", fix="Give it."
        )
    n_chirps, n_rx, n_samples = out.shape
    gaps_s, low_s, high_s = np.zeros((3, 2, n_chirps))
    sent_by = np.zeros((2, *sent.weights.shape), complex)
    # Present where `low <= t_n - tau < high`: this chirp's echo, then the previous one's.
    sent_by[0] = sent.weights
    low_s[0], high_s[0] = -np.inf if late == "held" else 0.0, np.inf
    if late == "tail" and before is not None:
        has_one = ~np.isnan(before.gaps_s)
        sent_by[1] = np.where(has_one[:, None], before.weights, 0)
        gaps_s[1] = np.where(has_one, before.gaps_s, 0)
        low_s[1], high_s[1] = -gaps_s[1], np.minimum(before.ramp_duration_s - gaps_s[1], 0)
    n_scatterers = scatterers.path_m.shape[1]
    factors = scatterers.chirp_factors
    _add(
        out,
        np.ascontiguousarray(scatterers.path_m.transpose(0, 2, 1), float),
        np.ascontiguousarray(scatterers.amplitudes, float),
        np.ascontiguousarray(scatterers.tx_gains, float),
        np.ascontiguousarray(scatterers.rx_gains, float),
        np.ones((1, n_scatterers)) if factors is None else np.ascontiguousarray(factors, float),
        np.ascontiguousarray(sent.starts_s, float),
        abs(sent_by),
        np.angle(sent_by) / (2 * np.pi),
        gaps_s,
        _cycles(sent.start_frequency_hz, gaps_s),
        low_s,
        high_s,
        np.ascontiguousarray(sent.tx_m, float),
        np.ascontiguousarray(sent.rx_m, float),
        float(sent.start_frequency_hz),
        float(sent.slope_hz_per_s),
        float(sent.adc_start_s),
        float(sent.sample_rate_hz),
        _aligned((n_rx, 2, n_samples + 2 * _WIDTH)),
        _aligned((6 * _WIDTH + 2 * (_BLOCKS + 8),)),
    )


def segments(scatterers: Scatterers, sent: Sent, n_samples: int) -> float:
    """Segments into which `add` cuts a chirp, about: from some scatterers in some chirps."""
    n, last = scatterers.path_m.shape[1], len(sent.starts_s) - 1
    groups = {max(n - _TOGETHER, 0) * part // 3 for part in range(4)}
    some = (np.array(sorted(groups))[:, None] + np.arange(min(n, _TOGETHER))).ravel()
    chirps = [0, last // 2, last]
    return float(
        _segments(
            np.ascontiguousarray(scatterers.path_m[:, some].transpose(0, 2, 1), float),
            np.ascontiguousarray(sent.starts_s[chirps], float),
            np.ascontiguousarray(sent.tx_m, float),
            np.ascontiguousarray(sent.rx_m, float),
            float(sent.start_frequency_hz),
            float(sent.slope_hz_per_s),
            float(sent.adc_start_s),
            float(sent.sample_rate_hz),
            n_samples,
        )
    )


def _cycles(frequency_hz: float, time_s: np.ndarray) -> np.ndarray:
    """Their product less whole cycles, of which there are a million in a chirp of 13 us.

    In parts of 24 bits, whose product is exact: rounded, it would be off by 1e-9 rad.
    """
    high_hz, high_s = float(np.float32(frequency_hz)), time_s.astype(np.float32).astype(float)
    rest = (frequency_hz - high_hz) * high_s + frequency_hz * (time_s - high_s)
    return np.fmod(high_hz * high_s, 1.0) + rest


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros from a multiple of 64 bytes on, rows too: a vector across two lines takes twice."""
    *outer, inner = shape
    inner = -(-inner // 8) * 8
    size = math.prod(outer) * inner
    zeros = np.zeros(size + 8)
    first = -(zeros.ctypes.data // 8) % 8
    return zeros[first : first + size].reshape(*outer, inner)


@_compiled
def _add(
    out: np.ndarray,
    path_m: np.ndarray,
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
    """Chirp by chirp, some scatterers at a time, segment by segment, path by path."""
    n_chirps, n_rx, n_samples = out.shape
    n_tx, n_scatterers = len(tx_m), len(amplitudes)
    step_s = 1 / sample_rate_hz
    local = np.empty((12, _TOGETHER))
    tx_ways, rx_ways = np.empty((n_tx, 8, _TOGETHER)), np.empty((n_rx, 8, _TOGETHER))
    echoes = np.empty((12, _TOGETHER))
    for m in range(n_chirps):
        sums[:] = 0
        varied = m if len(chirp_factors) > 1 else 0
        for i0 in range(0, n_scatterers, _TOGETHER):
            n = min(_TOGETHER, n_scatterers - i0)
            middle_s = starts_s[m] + adc_start_s + (n_samples - 1) / 2 * step_s
            _expand(path_m, i0, n, middle_s, step_s, local)
            longest = _longest_segment(
                path_m, i0, n, local, middle_s, step_s, n_samples, tx_m, rx_m,
                start_frequency_hz, slope_hz_per_s,
            )  # fmt: skip
            width, length = _lengths(longest, n_samples)
            for first in range(0, n_samples, length):
                stop = min(first + length, n_samples)
                # A whole sample, for the cycles that are taken off a step make halves of them.
                centre = (first + stop) // 2
                on_ramp_s = adc_start_s + centre * step_s
                _expand(path_m, i0, n, starts_s[m] + on_ramp_s, step_s, local)
                for j in range(n_tx):
                    if weights[0, m, j] != 0 or weights[1, m, j] != 0:
                        _ways(local, n, tx_m, j, tx_ways)
                for k in range(n_rx):
                    _ways(local, n, rx_m, k, rx_ways)
                # Present chirp and previous one, by transmitter and receiver.
                for path in range(2 * n_tx * n_rx):
                    k, j, turn = path // (2 * n_tx), path // 2 % n_tx, path % 2
                    weight = weights[turn, m, j]
                    if weight == 0:
                        continue
                    _phases(
                        tx_ways, j, rx_ways, k, n, gaps_s[turn, m],
                        weight_cycles[turn, m, j] - gap_cycles[turn, m],
                        start_frequency_hz, slope_hz_per_s, on_ramp_s, step_s, echoes,
                    )  # fmt: skip
                    for i in range(n):
                        factor = weight * chirp_factors[varied, i0 + i] * amplitudes[i0 + i]
                        echoes[4, i] *= factor * tx_gains[j, i0 + i] * rx_gains[k, i0 + i]
                    _add_path(
                        echoes, n, low_s[turn, m], high_s[turn, m], first, stop, centre, width,
                        adc_start_s, sample_rate_hz, n_samples, sums, k, tables,
                    )  # fmt: skip
        for k in range(n_rx):
            for at in range(n_samples):
                out[m, k, at] += complex(sums[k, 0, at], sums[k, 1, at])


@_compiled
def _segments(
    path_m: np.ndarray,
    starts_s: np.ndarray,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    adc_start_s: float,
    sample_rate_hz: float,
    n_samples: int,
) -> float:
    """Mean over chirps and scatterers, some together as in `_add`."""
    step_s, total, n_scatterers = 1 / sample_rate_hz, 0.0, path_m.shape[2]
    local = np.empty((12, _TOGETHER))
    for start_s in starts_s:
        middle_s = start_s + adc_start_s + (n_samples - 1) / 2 * step_s
        for i0 in range(0, n_scatterers, _TOGETHER):
            n = min(_TOGETHER, n_scatterers - i0)
            _expand(path_m, i0, n, middle_s, step_s, local)
            longest = _longest_segment(
                path_m, i0, n, local, middle_s, step_s, n_samples, tx_m, rx_m,
                start_frequency_hz, slope_hz_per_s,
            )  # fmt: skip
            _, length = _lengths(longest, n_samples)
            total += n * -(-n_samples // length)
    return total / (len(starts_s) * n_scatterers)


@_compiled
def _expand(
    path_m: np.ndarray, i0: int, n: int, at_s: float, step_s: float, local: np.ndarray
) -> None:
    """Positions about a time: rows of `local` 3 k + axis, the terms of k-th power in steps."""
    for axis in range(3):
        for i in range(n):
            p, v, a, b = 0.0, 0.0, 0.0, 0.0
            for term in range(len(path_m) - 1, -1, -1):
                b = b * at_s + a
                a = a * at_s + v
                v = v * at_s + p
                p = p * at_s + path_m[term, axis, i0 + i]
            local[axis, i] = p
            local[3 + axis, i] = v * step_s
            local[6 + axis, i] = a * step_s**2
            local[9 + axis, i] = b * step_s**3


@_compiled
def _longest_segment(
    path_m: np.ndarray,
    i0: int,
    n: int,
    local: np.ndarray,
    middle_s: float,
    step_s: float,
    n_samples: int,
    tx_m: np.ndarray,
    rx_m: np.ndarray,
    start_frequency_hz: float,
    slope_hz_per_s: float,
) -> float:
    """Samples over which cubic series of phase and amplitude hold to the tolerance.

    Moving straight by x ranges, a scatterer is at r sqrt(1 + 2 mu x + x^2), whose terms in x^n
    are below 2 / (2 n - 1) (Legendre). Of what is left out of the phase, the frequency
    multiplies the fourth power, and the slope the third and one more time.
    """
    half = n_samples / 2
    half_s = half * step_s
    swept_hz = abs(slope_hz_per_s) * half_s
    top_hz = start_frequency_hz + 2 * swept_hz
    latest_s = abs(middle_s) + half_s
    worst = 0.0
    for i in range(n):
        x, y, z = local[0, i], local[1, i], local[2, i]
        r = np.inf
        for j in range(len(tx_m)):
            r = min(r, _length(x - tx_m[j, 0], y - tx_m[j, 1], z - tx_m[j, 2]))
        for k in range(len(rx_m)):
            r = min(r, _length(x - rx_m[k, 0], y - rx_m[k, 1], z - rx_m[k, 2]))
        v = half * _length(local[3, i], local[4, i], local[5, i])
        a = half**2 * _length(local[6, i], local[7, i], local[8, i])
        b = half**3 * _length(local[9, i], local[10, i], local[11, i])
        rest = 0.0
        for term in range(4, len(path_m)):
            ways = term * (term - 1) * (term - 2) * (term - 3) / 24
            size = _length(
                path_m[term, 0, i0 + i], path_m[term, 1, i0 + i], path_m[term, 2, i0 + i]
            )
            rest += ways * size * latest_s ** (term - 4) * half_s**4
        # Nearest in this chirp; one that passes an antenna is taken at a tenth of its range.
        r = max(r - v - a - b - rest, r / 10)
        v, a, b, rest = v / r, a / r, b / r, rest / r
        fourth = rest + 2 * v * b + a * a + 3 * v * v * a + 2 / 7 * v**4
        third = b + 2 * v * a + 2 / 5 * v**3
        cycles = 2 * r / SPEED_OF_LIGHT * (top_hz * fourth + swept_hz * third)
        worst = max(worst, 2 * np.pi * cycles + 2 * fourth)
    return n_samples * min(1.0, (_TOLERANCE / max(worst, _TOLERANCE)) ** 0.25)


@_compiled
def _length(x: float, y: float, z: float) -> float:
    return np.sqrt(x * x + y * y + z * z)


@_compiled
def _lengths(longest: float, n_samples: int) -> tuple[int, int]:
    """Samples of a block, and of a segment: whole blocks unless it is the whole chirp."""
    # Vectors take 32 places or more; 64 cost less where there are many blocks.
    width = _WIDTH if longest >= 16 * _WIDTH else _WIDTH // 2
    longest = max(longest, 1.0)
    while width > longest:
        width //= 2
    if longest >= n_samples and n_samples <= width * _BLOCKS:
        return width, n_samples
    most = min(int(longest) // width, _BLOCKS)
    n_blocks = -(-n_samples // width)
    n_segments = -(-n_blocks // most)
    return width, -(-n_blocks // n_segments) * width


@_compiled
def _ways(local: np.ndarray, n: int, antennas_m: np.ndarray, j: int, ways: np.ndarray) -> None:
    """Series in steps: range to one antenna, and the logarithm of range; 1 / range."""
    for i in range(n):
        x, y, z = (
            local[0, i] - antennas_m[j, 0],
            local[1, i] - antennas_m[j, 1],
            local[2, i] - antennas_m[j, 2],
        )
        vx, vy, vz = local[3, i], local[4, i], local[5, i]
        ax, ay, az = local[6, i], local[7, i], local[8, i]
        bx, by, bz = local[9, i], local[10, i], local[11, i]
        r = np.sqrt(x * x + y * y + z * z)
        inverse = 1 / r
        # Power by power from range^2 = |position|^2.
        r1 = (x * vx + y * vy + z * vz) * inverse
        square = vx * vx + vy * vy + vz * vz + 2 * (x * ax + y * ay + z * az)
        r2 = (square - r1 * r1) * (inverse / 2)
        cube = x * bx + y * by + z * bz + vx * ax + vy * ay + vz * az
        r3 = (cube - r1 * r2) * inverse
        u1, u2, u3 = r1 * inverse, r2 * inverse, r3 * inverse
        ways[j, 0, i] = r
        ways[j, 1, i] = r1
        ways[j, 2, i] = r2
        ways[j, 3, i] = r3
        ways[j, 4, i] = inverse
        ways[j, 5, i] = u1
        ways[j, 6, i] = u2 - u1 * u1 / 2
        ways[j, 7, i] = u3 - u1 * u2 + u1 * u1 * u1 / 3


@_compiled
def _phases(
    there: np.ndarray,
    j: int,
    back: np.ndarray,
    k: int,
    n: int,
    gap_s: float,
    more_cycles: float,
    start_frequency_hz: float,
    slope_hz_per_s: float,
    on_ramp_s: float,
    step_s: float,
    echoes: np.ndarray,
) -> None:
    """Rows of `echoes`: cycles 0-3, spreading, its logarithm 1-3, delay 0-3."""
    slope_a_step = slope_hz_per_s * step_s
    for i in range(n):
        delay_s = (there[j, 0, i] + back[k, 0, i]) / SPEED_OF_LIGHT
        d1 = (there[j, 1, i] + back[k, 1, i]) / SPEED_OF_LIGHT
        d2 = (there[j, 2, i] + back[k, 2, i]) / SPEED_OF_LIGHT
        d3 = (there[j, 3, i] + back[k, 3, i]) / SPEED_OF_LIGHT
        # Whole cycles off before any sum: 26,000 of them at 50 m.
        cycles = start_frequency_hz * delay_s
        cycles -= np.floor(cycles)
        behind_s = delay_s - gap_s  # of the ramp it comes from, behind the one being sent
        cycles += more_cycles + slope_hz_per_s * behind_s * (on_ramp_s - behind_s / 2)
        received_hz = start_frequency_hz + slope_hz_per_s * (on_ramp_s - behind_s)
        a_step = received_hz * d1 + slope_a_step * behind_s
        echoes[0, i] = cycles - np.floor(cycles)
        echoes[1, i] = a_step - np.floor(a_step)
        echoes[2, i] = received_hz * d2 + slope_a_step * d1 - slope_hz_per_s * d1 * d1 / 2
        echoes[3, i] = received_hz * d3 + slope_a_step * d2 - slope_hz_per_s * d1 * d2
        echoes[4, i] = there[j, 4, i] * back[k, 4, i]
        echoes[5, i] = -there[j, 5, i] - back[k, 5, i]
        echoes[6, i] = -there[j, 6, i] - back[k, 6, i]
        echoes[7, i] = -there[j, 7, i] - back[k, 7, i]
        echoes[8, i] = delay_s
        echoes[9, i] = d1
        echoes[10, i] = d2
        echoes[11, i] = d3


@_compiled
def _add_path(
    echoes: np.ndarray,
    n: int,
    low_s: float,
    high_s: float,
    first: int,
    stop: int,
    centre: int,
    width: int,
    adc_start_s: float,
    sample_rate_hz: float,
    n_samples: int,
    sums: np.ndarray,
    k: int,
    tables: np.ndarray,
) -> None:
    """Add the echoes of one transmitter on one receiver to the samples that they are in."""
    for i in range(n):
        here, end = first, stop
        if low_s > -np.inf:
            here = _arrival(low_s, first, stop, centre, echoes, i, adc_start_s, sample_rate_hz)
        if high_s < np.inf:
            end = _arrival(high_s, first, stop, centre, echoes, i, adc_start_s, sample_rate_hz)
        if here < end:
            # Past the last sample a block may be written whole.
            room = sums.shape[2] if end == n_samples else end
            _add_segment(echoes, i, here, end, room, centre, width, sums, k, tables)


@_compiled
def _arrival(
    least_s: float,
    first: int,
    stop: int,
    centre: int,
    echoes: np.ndarray,
    i: int,
    adc_start_s: float,
    sample_rate_hz: float,
) -> int:
    """First sample of a segment whose time, less the delay then, is at least so much.

    The series of the delay is as exact as the delay itself in double precision.
    """
    about = (least_s + echoes[8, i] - adc_start_s) * sample_rate_hz
    n = int(min(max(about, first), stop))
    while n > first and _since_s(n - 1, centre, echoes, i, adc_start_s, sample_rate_hz) >= least_s:
        n -= 1
    while n < stop and _since_s(n, centre, echoes, i, adc_start_s, sample_rate_hz) < least_s:
        n += 1
    return n


@_compiled
def _since_s(
    n: int, centre: int, echoes: np.ndarray, i: int, adc_start_s: float, sample_rate_hz: float
) -> float:
    """Time of a sample on its ramp, less the delay of the echo that it takes."""
    h = n - centre
    delay_s = echoes[8, i] + h * (echoes[9, i] + h * (echoes[10, i] + h * echoes[11, i]))
    return adc_start_s + n / sample_rate_hz - delay_s


@_compiled
def _add_segment(
    echoes: np.ndarray,
    i: int,
    first: int,
    stop: int,
    room: int,
    centre: int,
    width: int,
    sums: np.ndarray,
    k: int,
    tables: np.ndarray,
) -> None:
    """Add one echo to samples from `first` on, writing none from `room` on."""
    c0, c1, c2, c3 = echoes[0, i], echoes[1, i], echoes[2, i], echoes[3, i]
    e1, e2, e3 = echoes[5, i], echoes[6, i], echoes[7, i]
    n_blocks = (stop - first + width - 1) // width
    w, middle = float(width), (width - 1) / 2
    x = first + middle - centre
    # Without V, and U from between, the error is largest half way from first to last block.
    span = n_blocks * w
    steady = 3 / 8 * w * span**2 * (2 * np.pi * abs(c3) + abs(e3)) < _TOLERANCE
    at = x + (n_blocks / 2 - 1) * w if steady else x
    _exponentials(
        tables, _RE_I, _IM_I, width, -middle, 1.0, 1.0,
        0.0, c1 + x * (2 * c2 + 3 * c3 * x), c2 + 3 * c3 * x, c3,
        e1 + x * (2 * e2 + 3 * e3 * x), e2 + 3 * e3 * x, e3,
    )  # fmt: skip
    _exponentials(
        tables, _RE_U, _IM_U, width, -middle, 1.0, 1.0,
        0.0, w * (2 * c2 + 3 * c3 * (w + 2 * at)), 3 * c3 * w, 0.0,
        w * (2 * e2 + 3 * e3 * (w + 2 * at)), 3 * e3 * w, 0.0,
    )  # fmt: skip
    if not steady:
        _exponentials(
            tables, _RE_V, _IM_V, width, -middle, 1.0, 1.0,
            0.0, 6 * c3 * w * w, 0.0, 0.0, 6 * e3 * w * w, 0.0, 0.0,
        )  # fmt: skip
    # A whole vector of blocks: the rest of one would be taken one by one.
    _exponentials(
        tables, _RE_G, _IM_G, (n_blocks + 7) // 8 * 8, x, w, echoes[4, i],
        c0, c1, c2, c3, e1, e2, e3,
    )  # fmt: skip
    whole = min(n_blocks, (room - first) // width)
    _add_blocks(sums, k, first, width, 0, whole, width, steady, tables)
    if whole < n_blocks:
        here = first + whole * width
        _add_blocks(sums, k, here, room - here, whole, 1, width, steady, tables)


@_compiled
def _add_blocks(
    sums: np.ndarray,
    k: int,
    first: int,
    places: int,
    block: int,
    n_blocks: int,
    width: int,
    steady: bool,
    tables: np.ndarray,
) -> None:
    """Add blocks of so many places from `first` on, and move the tables on with each.

    Two loops, for vectors of one with both would need more checks than short blocks pay for.
    """
    row, real, imaginary = np.uint64(k), np.uint64(0), np.uint64(1)
    for s in range(n_blocks):
        re = tables[_RE_G + np.uint64(block + s)]
        im = tables[_IM_G + np.uint64(block + s)]
        start = np.uint64(first + s * width)
        for y in range(np.uint64(places)):
            a, b = tables[_RE_I + y], tables[_IM_I + y]
            c, d = tables[_RE_U + y], tables[_IM_U + y]
            sums[row, real, start + y] += re * a - im * b
            sums[row, imaginary, start + y] += re * b + im * a
            tables[_RE_I + y] = a * c - b * d
            tables[_IM_I + y] = a * d + b * c
        if not steady:
            for y in range(np.uint64(places)):
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
def _exponentials(
    tables: np.ndarray,
    re: np.uint64,
    im: np.uint64,
    n: int,
    first: float,
    step: float,
    size: float,
    c0: float,
    c1: float,
    c2: float,
    c3: float,
    e1: float,
    e2: float,
    e3: float,
) -> None:
    """Parts of size exp(2 pi i c(y) + e(y)) for n equal steps of y, e below 0.01.

    By series of the half angle, which the compiler makes vectors of: 0.5 ns each.
    """
    for place in range(np.uint64(n)):
        y = first + step * place
        cycles = c0 + y * (c1 + y * (c2 + y * c3))
        x = cycles - np.floor(cycles + 0.5)
        q = x * x
        s = _S4 + q * (_S5 + q * (_S6 + q * (_S7 + q * (_S8 + q * _S9))))
        s = x * (_S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * s))))
        c = _C4 + q * (_C5 + q * (_C6 + q * (_C7 + q * (_C8 + q * _C9))))
        c = _C0 + q * (_C1 + q * (_C2 + q * (_C3 + q * c)))
        e = y * (e1 + y * (e2 + y * e3))
        grown = size * (1 + e * (1 + e / 2 * (1 + e / 3 * (1 + e / 4))))
        tables[re + place] = grown * (1 - 2 * s * s)
        tables[im + place] = grown * (2 * s * c)
