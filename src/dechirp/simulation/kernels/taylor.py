"""Taylor expansion: each echo as one tone in fast and slow time, times a short series.

For one transmitter and one receiver, with t from the middle of a run of chirps, t_n from the
middle of the sampling window, and f the frequency at mid-window, the law of `base.py` is

    c (1 + g1 s + g2 s^2 (1 + e) + g3 s^3 (1 + e) + ...) exp 2 pi i (S tau_0 t_n + D t (1 + e)),

s = t / H over the half duration H of the run, e = S t_n / (f - S tau_r) with tau_r in the middle of
the delays. The factor (1 + e) on slow time is range migration, that on s^2 and s^3 its second
order; D = d/dt (f tau - S tau^2 / 2) is the Doppler frequency. The series contains the changes of
amplitude by approach, and of phase by acceleration and crossing. Its coefficients follow from the
Taylor series of the two ranges, by the rules for roots, logarithms and exponentials of power series
(Knuth, The Art of Computer Programming 2, 4.7).

In a run of one chirp, t is t_n, and all of S tau t_n is included: S tau' t_n^2 joins the series,
and S tau_0 the frequency D.
"""

from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.units import SPEED_OF_LIGHT

ORDER = 7
"""Number of terms of each series."""

LANES = 64
"""Scatterers of a block: every loop over them becomes vector instructions."""

RANGE, DOPPLER, REAL, IMAG, SERIES = (LANES * row for row in range(5))
"""Offsets in a block: frequencies in Hz, then both parts of c, then both parts of g1, of g2 ...
Blocks are flat and offsets constant, so the compiler can prove that they do not overlap."""

BLOCK = SERIES + LANES * 2 * (ORDER - 1)
"""Length of a block."""

_TERMS = 6  # of the Taylor series of a range; of its logarithm, and of the amplitude, 4
_PATH, _SQUARE = 0, LANES * 3 * _TERMS
_LENGTH, _LOGARITHM = 0, LANES * _TERMS
_L0, _L1, _L2, _L3, _L4, _L5 = (_LENGTH + LANES * k for k in range(6))
_U1, _U2, _U3 = (_LOGARITHM + LANES * k for k in range(3))
_Q0, _Q1, _Q2, _Q3, _Q4, _Q5 = (_SQUARE + LANES * k for k in range(6))
_G1, _G2, _G3, _G4, _G5, _G6 = (SERIES + 2 * LANES * k for k in range(6))
_OUTBOUND, _INBOUND = LANES * 4 * _TERMS, LANES * (5 * _TERMS + 3)
WORK = _INBOUND + LANES * (_TERMS + 3)
"""Length of the work array of `fill_tone_block`."""

# Compilers keep divisions: with them a tone took 4.7 ns, with products 2.7.
_PER_M, _THIRD, _FIFTH, _SIXTH = 1 / SPEED_OF_LIGHT, 1 / 3, 1 / 5, 1 / 6

_compiled = kernel(fastmath={"contract"})
# A function that calls others counts references to all of its arrays, 5 ns a tone, unless it is
# inlined.
_inlined = kernel(inline="always", fastmath={"contract"}, cache=False)


class AntennaPairView(NamedTuple):
    """Scatterers relative to one transmitter and one receiver, about a time."""

    path_m: np.ndarray
    """(n_terms, 3, n) float64, contiguous: terms of the positions, in the time of the paths."""
    amplitudes: np.ndarray
    """(n,) float64, with the gains of both antennas."""
    tx_m: np.ndarray
    rx_m: np.ndarray
    mid_s: float
    """Time zero of the tones."""
    half_s: float
    """Half duration, where s is -1 and 1."""
    mid_frequency_hz: float
    slope_hz_per_s: float
    is_single_chirp: bool


@kernel(plain=IN_CALLER, fastmath={"contract"})
def fill_tone_blocks(view: AntennaPairView, blocks: np.ndarray) -> None:
    """Fill all blocks, (n_blocks, BLOCK)."""
    work, shifts = np.zeros(WORK), polynomial_time_shift_matrix(view)
    for b in range(len(blocks)):
        fill_tone_block(view, shifts, b * LANES, work, blocks[b])


@_compiled
def polynomial_time_shift_matrix(view: AntennaPairView) -> np.ndarray:
    """Return the matrix from a polynomial in t to one in (t - mid) / half, (n_terms, n_terms)."""
    n_terms = len(view.path_m)
    shifts = np.zeros((n_terms, n_terms))
    for k in range(n_terms):
        factor = view.half_s**k
        for j in range(k, n_terms):
            shifts[k, j] = factor
            factor *= view.mid_s * (j + 1) / (j + 1 - k)
    return shifts


@_compiled
def fill_tone_block(
    view: AntennaPairView,
    time_shifts: np.ndarray,
    first_scatterer: int,
    work: np.ndarray,
    block: np.ndarray,
) -> None:
    """Fill a block with scatterers from `first_scatterer` on, zero after the last; 12 ns each."""
    positions, outbound, inbound = split_work_into_positions_and_ranges(work)
    expand_positions_and_outbound_ranges(view, time_shifts, first_scatterer, positions, outbound)
    expand_inbound_ranges_and_fill_tones(
        view.rx_m, view.amplitudes, first_scatterer, len(view.path_m), view.mid_frequency_hz,
        view.slope_hz_per_s, view.half_s, view.is_single_chirp, positions, outbound, inbound, block,
    )  # fmt: skip


@_compiled
def split_work_into_positions_and_ranges(
    work: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return views of the work array: positions, outbound series, inbound series."""
    return work[:_OUTBOUND], work[_OUTBOUND:_INBOUND], work[_INBOUND:]


@_compiled
def expand_positions_and_outbound_ranges(
    view: AntennaPairView,
    time_shifts: np.ndarray,
    first_scatterer: int,
    positions: np.ndarray,
    outbound: np.ndarray,
) -> None:
    """Expand positions and outbound ranges: the half of a block that all receivers share."""
    path_m = view.path_m
    n_terms = len(path_m)
    lanes = min(LANES, len(view.amplitudes) - first_scatterer)
    for k in range(min(n_terms, _TERMS)):
        for axis in range(3):
            offset = np.uint64((3 * k + axis) * LANES)
            for i in range(np.uint64(LANES)):
                positions[offset + i] = 0.0
            for j in range(k, n_terms):
                share = time_shifts[k, j]
                if share == 0:
                    continue
                for i in range(np.uint64(lanes)):
                    positions[offset + i] += share * path_m[j, axis, np.uint64(first_scatterer) + i]
                for i in range(np.uint64(lanes), np.uint64(LANES)):
                    positions[offset + i] += share * path_m[j, axis, first_scatterer + lanes - 1]
    _expand_distances_and_logarithms(positions, min(n_terms, _TERMS), view.tx_m, outbound)


@_inlined
def expand_inbound_ranges_and_fill_tones(
    rx_m: np.ndarray,
    amplitudes: np.ndarray,
    first_scatterer: int,
    n_path_terms: int,
    mid_frequency_hz: float,
    slope_hz_per_s: float,
    half_s: float,
    one_chirp: bool,
    positions: np.ndarray,
    outbound: np.ndarray,
    inbound: np.ndarray,
    block: np.ndarray,
) -> None:
    """Expand inbound ranges, and the tones: the second half of `fill_tone_block`."""
    lanes = min(LANES, len(amplitudes) - first_scatterer)
    _expand_distances_and_logarithms(positions, min(n_path_terms, _TERMS), rx_m, inbound)
    _fill_unit_amplitude_tones(
        outbound, inbound, mid_frequency_hz, slope_hz_per_s, half_s, one_chirp, block
    )
    for i in range(np.uint64(lanes)):
        amplitude = amplitudes[np.uint64(first_scatterer) + i]
        block[np.uint64(REAL) + i] *= amplitude
        block[np.uint64(IMAG) + i] *= amplitude
    for i in range(lanes, LANES):
        block[REAL + i], block[IMAG + i] = 0.0, 0.0


@_compiled
def _expand_distances_and_logarithms(
    position_series: np.ndarray, n_path_terms: int, antenna_m: np.ndarray, range_series: np.ndarray
) -> None:
    """Expand the distances to an antenna, and their logarithms without the constant."""
    for i in range(LANES * _TERMS):
        position_series[_SQUARE + i] = 0.0
    for axis in range(3):
        coordinate_m = antenna_m[axis]
        x0 = np.uint64(axis * LANES)
        for i in range(np.uint64(LANES)):
            position_series[x0 + i] -= coordinate_m
        for k in range(n_path_terms):
            for j in range(k, min(n_path_terms, _TERMS - k)):
                multiplicity = 1.0 if j == k else 2.0
                a, b = np.uint64((3 * k + axis) * LANES), np.uint64((3 * j + axis) * LANES)
                target = np.uint64(_SQUARE + (j + k) * LANES)
                for i in range(np.uint64(LANES)):
                    position_series[target + i] += (
                        multiplicity * position_series[a + i] * position_series[b + i]
                    )
        for i in range(np.uint64(LANES)):
            position_series[x0 + i] += coordinate_m
    for i in range(LANES):
        l0 = np.sqrt(position_series[_Q0 + i])
        inverse = 1 / l0
        l1 = position_series[_Q1 + i] / 2 * inverse
        l2 = (position_series[_Q2 + i] / 2 - l1 * l1 / 2) * inverse
        l3 = (position_series[_Q3 + i] / 2 - l1 * l2) * inverse
        l4 = (position_series[_Q4 + i] / 2 - l1 * l3 - l2 * l2 / 2) * inverse
        l5 = (position_series[_Q5 + i] / 2 - l1 * l4 - l2 * l3) * inverse
        u1, u2, u3 = l1 * inverse, l2 * inverse, l3 * inverse
        range_series[_L0 + i], range_series[_L1 + i], range_series[_L2 + i] = l0, l1, l2
        range_series[_L3 + i], range_series[_L4 + i], range_series[_L5 + i] = l3, l4, l5
        range_series[_U1 + i] = u1
        range_series[_U2 + i] = u2 - u1 * u1 / 2
        range_series[_U3 + i] = u3 - u1 * u2 + u1 * u1 * u1 * _THIRD


@_compiled
def _fill_unit_amplitude_tones(
    outbound: np.ndarray,
    inbound: np.ndarray,
    f: float,
    slope: float,
    half_s: float,
    one_chirp: bool,
    block: np.ndarray,
) -> None:
    """Compute tone and series of a block, for amplitude 1, from the series of both ranges."""
    # Contribution of S tau t_n over the run if t is t_n.
    range_rate_term = slope * half_s if one_chirp else 0.0
    per_s = 1 / half_s
    for i in range(LANES):
        t0 = (outbound[_L0 + i] + inbound[_L0 + i]) * _PER_M
        t1 = (outbound[_L1 + i] + inbound[_L1 + i]) * _PER_M
        t2 = (outbound[_L2 + i] + inbound[_L2 + i]) * _PER_M
        t3 = (outbound[_L3 + i] + inbound[_L3 + i]) * _PER_M
        t4 = (outbound[_L4 + i] + inbound[_L4 + i]) * _PER_M
        t5 = (outbound[_L5 + i] + inbound[_L5 + i]) * _PER_M
        received_hz = f - slope * t0
        cycles = (f - slope / 2 * t0) * t0
        block[RANGE + i] = slope * t0
        block[DOPPLER + i] = (received_hz * t1 + range_rate_term * t0) * per_s
        x = np.pi * (cycles - np.rint(cycles))
        y = x * x
        # Sine and cosine of half the angle, by their series, within 1e-11.
        sine = 1.6059043836821613e-10 - y * 7.647163731819816e-13
        sine = 2.7557319223985893e-06 + y * (-2.505210838544172e-08 + y * sine)
        sine = 8.333333333333333e-03 + y * (-1.984126984126984e-04 + y * sine)
        sine = x * (1.0 + y * (-1.6666666666666666e-01 + y * sine))
        cosine = -1.1470745597729725e-11 + y * 4.779477332387385e-14
        cosine = -2.755731922398589e-07 + y * (2.08767569878681e-09 + y * cosine)
        cosine = -1.388888888888889e-03 + y * (2.48015873015873e-05 + y * cosine)
        cosine = 1.0 + y * (-0.5 + y * (4.1666666666666664e-02 + y * cosine))
        size = 1 / (outbound[_L0 + i] * inbound[_L0 + i])
        block[REAL + i] = size * (1 - 2 * sine * sine)
        block[IMAG + i] = size * (2 * sine * cosine)
        # Each term times its power, as in the derivative, from which the exponential follows.
        a1 = -outbound[_U1 + i] - inbound[_U1 + i]
        a2 = -2 * (outbound[_U2 + i] + inbound[_U2 + i])
        a3 = -3 * (outbound[_U3 + i] + inbound[_U3 + i])
        p2 = 4 * np.pi * (received_hz * t2 - slope / 2 * t1 * t1 + range_rate_term * t1)
        p3 = 6 * np.pi * (received_hz * t3 - slope * t1 * t2 + range_rate_term * t2)
        p4 = 8 * np.pi * (received_hz * t4 - slope * (t1 * t3 + t2 * t2 / 2) + range_rate_term * t3)
        p5 = 10 * np.pi * (received_hz * t5 - slope * (t1 * t4 + t2 * t3) + range_rate_term * t4)
        r1, i1 = a1, 0.0
        r2, i2 = (a1 * r1 + a2) / 2, p2 / 2
        r3, i3 = (a1 * r2 + a2 * r1 + a3) * _THIRD, (a1 * i2 + p2 * r1 + p3) * _THIRD
        r4 = (a1 * r3 + a2 * r2 + a3 * r1 - p2 * i2) / 4
        i4 = (a1 * i3 + a2 * i2 + p2 * r2 + p3 * r1 + p4) / 4
        r5 = (a1 * r4 + a2 * r3 + a3 * r2 - p2 * i3 - p3 * i2) * _FIFTH
        i5 = (a1 * i4 + a2 * i3 + a3 * i2 + p2 * r3 + p3 * r2 + p4 * r1 + p5) * _FIFTH
        r6 = (a1 * r5 + a2 * r4 + a3 * r3 - p2 * i4 - p3 * i3 - p4 * i2) * _SIXTH
        i6 = (a1 * i5 + a2 * i4 + a3 * i3 + p2 * r4 + p3 * r3 + p4 * r2 + p5 * r1) * _SIXTH
        block[_G1 + i], block[_G1 + LANES + i] = r1, i1
        block[_G2 + i], block[_G2 + LANES + i] = r2, i2
        block[_G3 + i], block[_G3 + LANES + i] = r3, i3
        block[_G4 + i], block[_G4 + LANES + i] = r4, i4
        block[_G5 + i], block[_G5 + LANES + i] = r5, i5
        block[_G6 + i], block[_G6 + LANES + i] = r6, i6
