"""Compiled loop over pairs of scatterers and screens: the amplitudes that shadows leave.

It has the equations of `shadowing`, one pair at a time. Fields beyond edges come from a table with
their derivatives, within 1e-7 of the integrals.
"""

import math
from functools import cache

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.theory.knife_edge import field_beyond_edge

FADE_START, FADE_END = 3.0, 6.0
"""Parameters v of the clearance between which the ripple of the field beside an edge, 0.6 dB at
v = 3, is faded out, so that paths further away remain exactly unshadowed."""
TOLERANCE_DB = 0.2
"""Antennas use the amplitude of the middle of their array if they differ by less; one way."""
SLOPE_DB = 8.7
"""The loss of an edge changes by at most 8.7 dB per unit of v, and by 8.7 dB / v in its shadow."""
MIN_SHARE = 1e-9
"""Distance from the ends of a path, a share, within which edges count as infinitely sharp."""
MIN_AMPLITUDE = 1e-30
"""Least amplitude of one screen: 600 dB."""
# Between points of the table, a cubic errs by the fourth derivative, (pi v)^3 / sqrt(2), times
# step^4 / 384; beyond its end, three terms of the asymptotic series err by 1e-9.
_TABLE_END, _POINTS_PER_UNIT = 8.0, 128


@cache
def edge_field_table() -> np.ndarray:
    """Return the field beyond an edge and its derivative, (n, 2), for v from 0 to 8."""
    v = np.arange(0, _TABLE_END + 1.5 / _POINTS_PER_UNIT, 1 / _POINTS_PER_UNIT)
    slopes = -(0.5 + 0.5j) * np.exp(-0.5j * np.pi * v**2)
    return np.stack([field_beyond_edge(v), slopes / _POINTS_PER_UNIT], axis=1)


@kernel(fastmath={"contract"})
def edge_field(v: float, table: np.ndarray) -> complex:
    """Return the field beyond an edge, from the table or its asymptotic series."""
    size = abs(v)
    if size < _TABLE_END:
        place = size * _POINTS_PER_UNIT
        i = int(place)
        t = place - i
        u = 1.0 - t
        field = u * u * ((1.0 + 2.0 * t) * table[i, 0] + t * table[i, 1]) + t * t * (
            (1.0 + 2.0 * u) * table[i + 1, 0] - u * table[i + 1, 1]
        )
    elif size < 1e6:
        z = math.pi * size * size
        f = (1.0 - 3.0 / z**2 + 105.0 / z**4) / (math.pi * size)
        g = (1.0 - 15.0 / z**2 + 945.0 / z**4) / (math.pi * size * z)
        sine, cosine = math.sin(z / 2), math.cos(z / 2)
        field = (0.5 + 0.5j) * complex(g * cosine - f * sine, -(f * cosine + g * sine))
    else:
        field = 0.0j
    return field if v >= 0 else 1.0 - field


@kernel(fastmath={"contract"})
def _v_per_metre(share: float, v_per_root: float) -> float:
    end = min(max(share, MIN_SHARE), 1.0 - MIN_SHARE)
    return v_per_root / math.sqrt(end * (1.0 - end))


@kernel(fastmath={"contract"})
def _clip_side(share: float, step: float, is_cut: bool) -> tuple[float, float]:
    """Return the parts of a side from which and up to which it is between both ends of a path."""
    if not is_cut:
        return 0.0, 1.0
    step = step if abs(step) >= 1e-15 else 1e-15
    low, high = (MIN_SHARE - share) / step, (1.0 - MIN_SHARE - share) / step
    return min(max(min(low, high), 0.0), 1.0), min(max(low, high, 0.0), 1.0)


@kernel(fastmath={"contract"})
def _crossing_of_sides(
    corners: np.ndarray, is_cut: bool, has_side: np.ndarray, nearest_share: float
) -> tuple[float, float]:
    """Return the shares between which a path crosses a screen; else the nearest one twice.

    `has_side`, (2, 2), is True if the screen reaches to the right, or left, of the antenna, or of
    the scatterer. An end of the path with both is above or below the screen.
    """
    first, last = math.inf, -math.inf
    for k in range(4):
        share, left_m = corners[k, 0], corners[k, 1]
        step, left_step_m = corners[(k + 1) % 4, 0] - share, corners[(k + 1) % 4, 1] - left_m
        start, end = _clip_side(share, step, is_cut)
        if is_cut and not (_is_between(share + start * step) and _is_between(share + end * step)):
            continue
        from_m, to_m = left_m + start * left_step_m, left_m + end * left_step_m
        if from_m * to_m < 0:
            crossing = share + (start + from_m / (from_m - to_m) * (end - start)) * step
            first, last = min(first, crossing), max(last, crossing)
    if has_side[0, 0] and has_side[0, 1]:
        first = 0.0
    if has_side[1, 0] and has_side[1, 1]:
        last = 1.0
    if math.isinf(first) or math.isinf(last):
        return nearest_share, nearest_share
    return first, last


@kernel(fastmath={"contract"})
def _is_between(share: float) -> bool:
    return 0.5 * MIN_SHARE < share < 1.0 - 0.5 * MIN_SHARE


@kernel(fastmath={"contract"})
def _scan_sides(
    corners: np.ndarray, is_cut: bool, v_per_root: float, edges_v: np.ndarray, has_side: np.ndarray
) -> tuple[float, float]:
    """Write the parameters of the right and the left edge, and `has_side`.

    Returns the sensitivity, and the share of the path at the nearest corner.
    """
    right_v, left_v, sensitivity = math.inf, -math.inf, 0.0
    nearest_v, nearest_share = math.inf, corners[0, 0]
    has_side[:] = False
    for k in range(4):
        step = corners[(k + 1) % 4, 0] - corners[k, 0]
        left_step_m = corners[(k + 1) % 4, 1] - corners[k, 1]
        parts = _clip_side(corners[k, 0], step, is_cut)
        for side in range(2 if is_cut else 1):
            share = corners[k, 0] + parts[side] * step
            left_m = corners[k, 1] + parts[side] * left_step_m
            if is_cut and not _is_between(share):
                continue
            per_metre = _v_per_metre(share, v_per_root)
            v = left_m * per_metre
            right_v, left_v = min(right_v, v), max(left_v, v)
            sensitivity = max(sensitivity, per_metre * (1.0 - share) / max(abs(v), 1.0))
            if abs(v) < nearest_v:
                nearest_v, nearest_share = abs(v), share
            for at_end in range(2):
                if (share if at_end == 0 else 1.0 - share) < 2 * MIN_SHARE and left_m != 0:
                    has_side[at_end, int(left_m > 0)] = True
    edges_v[0], edges_v[1] = right_v, left_v
    return sensitivity, nearest_share


@kernel(fastmath={"contract"})
def _edges_of_pair(
    antenna_m: np.ndarray,
    position_m: np.ndarray,
    corners_m: np.ndarray,
    bands_m: np.ndarray,
    wavelength_m: float,
    corners: np.ndarray,
    has_side: np.ndarray,
    edges_v: np.ndarray,
) -> tuple[float, float]:
    """Write the parameters v of the right and the left edge, then of each band.

    `corners` and `has_side` are buffers. Returns the clearance, and the sensitivity of
    `shadowing._Edges`.
    """
    x, y = position_m[0] - antenna_m[0], position_m[1] - antenna_m[1]
    z = position_m[2] - antenna_m[2]
    length_m = max(math.hypot(x, y), 1e-9)
    cosine = length_m / math.hypot(length_m, z)
    v_per_root = math.sqrt(2.0 * cosine / (wavelength_m * length_m))
    is_cut = False
    for k in range(4):
        dx, dy = corners_m[k].real - antenna_m[0], corners_m[k].imag - antenna_m[1]
        corners[k, 0] = (dx * x + dy * y) / length_m**2
        corners[k, 1] = (dy * x - dx * y) / length_m
        is_cut |= corners[k, 0] < MIN_SHARE or corners[k, 0] > 1.0 - MIN_SHARE
    sensitivity, nearest_share = _scan_sides(corners, is_cut, v_per_root, edges_v, has_side)
    first, last = _crossing_of_sides(corners, is_cut, has_side, nearest_share)
    first_per_metre = _v_per_metre(first, v_per_root) * cosine
    last_per_metre = _v_per_metre(last, v_per_root) * cosine
    nearest, above = math.inf, math.inf
    for end in range(2, len(edges_v)):
        height_m = bands_m[end // 2 - 1, end % 2] - antenna_m[2]
        at_first, at_last = (
            (height_m - first * z) * first_per_metre,
            (height_m - last * z) * last_per_metre,
        )
        nearest = min(nearest, abs(at_first), abs(at_last))
        edges_v[end] = max(at_first, at_last) if end % 2 else min(at_first, at_last)
    for end in range(2, len(edges_v), 2):
        # Bands that overlap, as a long body over its image in the road, leave no gap between them.
        if end + 2 < len(edges_v):
            edges_v[end + 1] = min(edges_v[end + 1], edges_v[end + 2])
        above = min(above, max(edges_v[end], -edges_v[end + 1]))
    change = max(first_per_metre * (1.0 - first), last_per_metre * (1.0 - last))
    sensitivity = max(sensitivity, change / max(nearest, 1.0))
    return max(edges_v[0], -edges_v[1], above), sensitivity


@kernel(fastmath={"contract"})
def _amplitude_of_edges(edges_v: np.ndarray, clearance: float, table: np.ndarray) -> float:
    if clearance >= FADE_END:
        return 1.0
    height = 0.0j
    for band in range(1, len(edges_v) // 2):
        height += edge_field(edges_v[2 * band], table) - edge_field(edges_v[2 * band + 1], table)
    share = (edge_field(edges_v[0], table) - edge_field(edges_v[1], table)) * height
    fade = min(max((FADE_END - clearance) / (FADE_END - FADE_START), 0.0), 1.0)
    return max(abs(1.0 - fade**2 * (3.0 - 2.0 * fade) * share), MIN_AMPLITUDE)


def multiply_by_shadows(
    amplitudes: np.ndarray,
    antennas_m: np.ndarray,
    positions_m: np.ndarray,
    order: np.ndarray,
    rows: np.ndarray,
    margins_m: np.ndarray,
    corners_m: np.ndarray,
    bands_m: np.ndarray,
    wavelength_m: float,
    table: np.ndarray,
) -> None:
    """Multiply amplitudes, (n_antennas, n_scatterers), by those that the screens of rows leave.

    A row, (first, end, screen), contains the scatterers `order[first:end]`, of which paths pass the
    screen within a margin. The middle of the array stands for all antennas where they differ
    little.
    """
    n_antennas = len(antennas_m)
    middle_m = np.zeros(3)
    for antenna in range(n_antennas):
        middle_m += antennas_m[antenna] / n_antennas
    radius_m = 0.0
    for antenna in range(n_antennas):
        away_m = antennas_m[antenna] - middle_m
        radius_m = max(radius_m, math.sqrt(away_m[0] ** 2 + away_m[1] ** 2 + away_m[2] ** 2))
    corners, has_side = np.empty((4, 2)), np.empty((2, 2), np.bool_)
    edges_v = np.empty(2 + 2 * bands_m.shape[1])
    for row in range(len(rows)):
        screen, margin_m = rows[row, 2], margins_m[row]
        outline_m, bands = corners_m[screen], bands_m[screen]
        for index in range(rows[row, 0], rows[row, 1]):
            scatterer = order[index]
            position_m = positions_m[scatterer]
            x, y = position_m[0] - middle_m[0], position_m[1] - middle_m[1]
            length_m = max(math.hypot(x, y), 1e-9)
            least_m, most_m = math.inf, -math.inf
            for k in range(4):
                dx, dy = outline_m[k].real - middle_m[0], outline_m[k].imag - middle_m[1]
                left_m = (dy * x - dx * y) / length_m
                least_m, most_m = min(least_m, left_m), max(most_m, left_m)
            if least_m >= margin_m or most_m <= -margin_m:
                continue
            clearance, sensitivity = _edges_of_pair(
                middle_m,
                position_m,
                outline_m,
                bands,
                wavelength_m,
                corners,
                has_side,
                edges_v,
            )
            change = sensitivity * radius_m
            if not clearance < FADE_END / max(1.0 - change, 1e-3):
                continue
            if SLOPE_DB * change <= TOLERANCE_DB:
                amplitude = _amplitude_of_edges(edges_v, clearance, table)
                for antenna in range(n_antennas):
                    amplitudes[antenna, scatterer] *= amplitude
                continue
            for antenna in range(n_antennas):
                clearance, _ = _edges_of_pair(
                    antennas_m[antenna],
                    position_m,
                    outline_m,
                    bands,
                    wavelength_m,
                    corners,
                    has_side,
                    edges_v,
                )
                amplitudes[antenna, scatterer] *= _amplitude_of_edges(edges_v, clearance, table)
