"""Shadowing: amplitudes that are left of the paths between antennas and scatterers.

Each screen between an antenna and a scatterer is seen as a rectangle across the path: from above by
its outermost corners, each with its own distances, and from the side where the path crosses it.
With the fields F of `theory.knife_edge`, signed like a coordinate across the path, the field is

    E = 1 - (F(right) - F(left)) (F(bottom) - F(top)),

that without the screen minus that through an opening of its size (Babinet's principle; P.526-15,
thin screens). Blockage model B of 3GPP TR 38.901, 7.6.4.2, has this form with the approximation
F = 1/2 - arctan(1.39 v) / pi, within 0.2 dB in the shadow of an edge. Fields of several screens
multiply. Only their magnitudes are used: the echo of a shadowed scatterer keeps the phase of the
straight path.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.scene.rcs import scatterer_cross_sections_m2
from dechirp.scene.rotations import from_local_axes
from dechirp.scene.scene import Scene
from dechirp.scene.screens import Screens, screens_of_bodies
from dechirp.scene.shadow_kernel import (
    FADE_END,
    FADE_START,
    MIN_AMPLITUDE,
    MIN_SHARE,
    SLOPE_DB,
    TOLERANCE_DB,
    edge_field_table,
    multiply_by_shadows,
)
from dechirp.theory.knife_edge import field_beyond_edge

# Pairs of scatterers and screens that are evaluated together: some 100 arrays of 2**12 pairs.
_BLOCK_PAIRS = 2**12


class _Edges(NamedTuple):
    """Edges of one screen for each path; the paths are the last axis."""

    width_v: np.ndarray
    """(2, n): parameters of the right and the left edge."""
    height_v: np.ndarray
    """(2, n_bands, n): parameters of the lower and the upper edge of each band."""
    sensitivity: np.ndarray
    """(n,) 1/m: change of v, relative to v above 1, per metre that the antenna moves; the largest
    of all edges."""

    @property
    def clearances(self) -> np.ndarray:
        """Return the parameter v by which the path passes beside the screen, (n,)."""
        beside = np.maximum(self.width_v[0], -self.width_v[1])
        above = np.maximum(self.height_v[0], -self.height_v[1]).min(axis=0)
        return np.asarray(np.maximum(beside, above))

    def amplitudes(self) -> np.ndarray:
        """Return the amplitude ratios, (n,)."""
        right, left = field_beyond_edge(self.width_v)
        bottom, top = field_beyond_edge(self.height_v)
        fade = np.clip((FADE_END - self.clearances) / (FADE_END - FADE_START), 0.0, 1.0)
        share = (right - left) * (bottom - top).sum(axis=0)
        return np.asarray(abs(1 - fade**2 * (3 - 2 * fade) * share))


def shadowed_amplitudes(
    antennas_m: np.ndarray,
    positions_m: np.ndarray,
    targets: np.ndarray,
    screens: Screens,
    wavelength_m: float,
) -> np.ndarray:
    """Return the one-way amplitude ratios with to without screens, (n_antennas, n_scatterers).

    Exactly 1 for paths that pass all screens at a distance. A screen does not shadow the scatterers
    of its own target, whose body models that.

    Antennas of one array differ by a small parameter: if the antenna moves by a across the path, an
    edge at the share s of its length r moves by a (1 - s) relative to the line of sight, and v by
    at most a sqrt(2 / (lambda s r)). Only where that changes the loss by more than 0.2 dB, near the
    edge of a shadow, is each antenna computed. Elsewhere all have the amplitude of their middle, in
    which such changes cancel to first order.

    Parameters
    ----------
    antennas_m : array (n_antennas, 3)
        Relative to the radar, along the axes of the scene.
    positions_m : array (n_scatterers, 3)
        In the same coordinates.
    targets : array (n_scatterers,)
        Target of each scatterer.
    """
    amplitudes = np.ones((len(antennas_m), len(positions_m)))
    near = _find_near_rows(antennas_m, positions_m, targets, screens, wavelength_m)
    _multiply_by_shadows(
        amplitudes, np.ascontiguousarray(antennas_m), np.ascontiguousarray(positions_m),
        *near, np.ascontiguousarray(screens.corners_m), np.ascontiguousarray(screens.bands_m),
        wavelength_m, edge_field_table(),
    )  # fmt: skip
    return amplitudes


def _multiply_pairs_in_blocks(
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
    """Multiply amplitudes by those that screens leave, as `multiply_by_shadows`."""
    screens = Screens(corners_m, bands_m, np.zeros(len(corners_m)))
    log_amplitudes = np.zeros(amplitudes.shape)
    for scatterers, screen_indices in _blocks_of_near_pairs(
        antennas_m.mean(axis=0), positions_m, order, rows, margins_m, corners_m
    ):
        _add_log_amplitudes(
            log_amplitudes, antennas_m, positions_m, scatterers,
            screens.select(screen_indices), wavelength_m,
        )  # fmt: skip
    amplitudes *= np.exp(log_amplitudes)


_multiply_by_shadows = kernel(plain=_multiply_pairs_in_blocks, fastmath={"contract"})(
    multiply_by_shadows
)


def _add_log_amplitudes(
    log_amplitudes: np.ndarray,
    antennas_m: np.ndarray,
    positions_m: np.ndarray,
    scatterers: np.ndarray,
    screens: Screens,
    wavelength_m: float,
) -> None:
    """Add the logarithms for pairs of scatterers and screens, (n_pairs,) each."""
    n_scatterers = log_amplitudes.shape[1]
    middle_m = antennas_m.mean(axis=0)
    radius_m = np.linalg.norm(antennas_m - middle_m, axis=1).max()
    edges = _edges_across_paths(middle_m[None], positions_m[scatterers], screens, wavelength_m)
    change = edges.sensitivity * radius_m
    differs = SLOPE_DB * change > TOLERANCE_DB
    is_near = edges.clearances < FADE_END / np.maximum(1 - change, 1e-3)
    common = np.flatnonzero(is_near & ~differs)
    common_edges = _Edges(*(column.take(common, axis=-1) for column in edges))
    log_amplitudes += _sum_logarithms(common_edges.amplitudes(), scatterers[common], n_scatterers)
    pairs = np.repeat(np.flatnonzero(is_near & differs), len(antennas_m))
    antennas = np.resize(np.arange(len(antennas_m)), len(pairs))
    edges = _edges_across_paths(
        antennas_m[antennas], positions_m[scatterers[pairs]], screens.select(pairs), wavelength_m
    )
    log_amplitudes += _sum_logarithms(
        edges.amplitudes(), antennas * n_scatterers + scatterers[pairs], log_amplitudes.size
    ).reshape(log_amplitudes.shape)


def _sum_logarithms(amplitudes: np.ndarray, indices: np.ndarray, n: int) -> np.ndarray:
    return np.bincount(indices, np.log(np.maximum(amplitudes, MIN_AMPLITUDE)), minlength=n)


class _NearRows(NamedTuple):
    """Pairs of a target and a screen near its paths, seen from above."""

    order: np.ndarray
    """(n_scatterers,): scatterers in the order of their targets."""
    rows: np.ndarray
    """(n, 3): first and end of the scatterers in this order, and the screen."""
    margins_m: np.ndarray
    """(n,): distance within which a path passes near the screen."""


def _find_near_rows(
    antennas_m: np.ndarray,
    positions_m: np.ndarray,
    targets: np.ndarray,
    screens: Screens,
    wavelength_m: float,
) -> _NearRows:
    """Compare targets with screens, as circles about their scatterers and as wedges of paths."""
    antenna_m = antennas_m.mean(axis=0)
    radius_m = float(np.linalg.norm(antennas_m - antenna_m, axis=1).max())
    from_above_m = positions_m[:, 0] + 1j * positions_m[:, 1]
    start_m = complex(antenna_m[0], antenna_m[1])
    owners, owner_of_scatterer, counts = np.unique(targets, return_inverse=True, return_counts=True)
    middles_m = np.zeros(len(owners), dtype=complex)
    np.add.at(middles_m, owner_of_scatterer, from_above_m)
    middles_m /= counts
    spread_m = np.zeros(len(owners))
    np.maximum.at(spread_m, owner_of_scatterer, abs(from_above_m - middles_m[owner_of_scatterer]))
    # Half the width of the zone at the middle of the longest path; narrower elsewhere.
    lengths_m = abs(middles_m - start_m) + spread_m
    margins_m = radius_m + FADE_END * np.sqrt(wavelength_m * lengths_m / 8)
    distances_m = _distances_from_segments_m(start_m, middles_m[:, None], screens.centres_m)
    is_near = distances_m < screens.radii_m + (spread_m + margins_m)[:, None]
    owner, screen = np.nonzero(is_near & (owners[:, None] != screens.targets))
    # The wedge of all paths to a target.
    turn_rad = np.angle((from_above_m - start_m) * (middles_m - start_m).conj()[owner_of_scatterer])
    turns_rad = np.zeros((2, len(owners)))
    np.minimum.at(turns_rad[0], owner_of_scatterer, turn_rad)
    np.maximum.at(turns_rad[1], owner_of_scatterer, turn_rad)
    ends_m = (middles_m - start_m) * np.exp(1j * turns_rad)
    is_narrow = np.ptp(turns_rad, axis=0) < np.pi / 2
    corners_m = screens.corners_m[screen]
    right_m, left_m = (
        _distances_to_left_m(start_m, start_m + end_m[owner], corners_m) for end_m in ends_m
    )
    passes = is_narrow[owner] & (
        (left_m.min(axis=0) > margins_m[owner]) | (right_m.max(axis=0) < -margins_m[owner])
    )
    owner, screen = owner[~passes], screen[~passes]
    stops = np.cumsum(counts)
    return _NearRows(
        np.argsort(owner_of_scatterer, kind="stable"),
        np.stack([(stops - counts)[owner], stops[owner], screen], axis=1),
        margins_m[owner],
    )


def _blocks_of_near_pairs(
    antenna_m: np.ndarray,
    positions_m: np.ndarray,
    order: np.ndarray,
    rows: np.ndarray,
    margins_m: np.ndarray,
    corners_m: np.ndarray,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield blocks of scatterers and the screens near their paths from above, (n_pairs,) each."""
    start_m = complex(antenna_m[0], antenna_m[1])
    starts, ends, screens = rows.T
    stops = np.cumsum(ends - starts)
    for first in range(0, int((ends - starts).sum()), _BLOCK_PAIRS):
        pair = np.arange(first, min(first + _BLOCK_PAIRS, int(stops[-1])))
        row = np.searchsorted(stops, pair, side="right")
        scatterers = order[ends[row] + pair - stops[row]]
        x_m, y_m, _ = positions_m[scatterers].T
        left_m = _distances_to_left_m(start_m, x_m + 1j * y_m, corners_m[screens[row]])
        is_near = (left_m.min(axis=0) < margins_m[row]) & (left_m.max(axis=0) > -margins_m[row])
        yield scatterers[is_near], screens[row][is_near]


def _distances_from_segments_m(
    start_m: complex, ends_m: np.ndarray, points_m: np.ndarray
) -> np.ndarray:
    """Return the distances of complex points from the segments from one start to ends."""
    along_m, to_point_m = ends_m - start_m, points_m - start_m
    length2 = np.maximum(along_m.real**2 + along_m.imag**2, 1e-12)
    share = np.clip((along_m.conj() * to_point_m).real / length2, 0.0, 1.0)
    return np.asarray(abs(to_point_m - share * along_m))


def _distances_to_left_m(start_m: complex, ends_m: np.ndarray, corners_m: np.ndarray) -> np.ndarray:
    """Return the distances of corners (n, 4) to the left of paths to ends (n,), (4, n)."""
    along_m = ends_m - start_m
    towards = along_m.conj() / np.maximum(abs(along_m), 1e-9)
    return ((np.ascontiguousarray(corners_m.T) - start_m) * towards).imag


def _edges_across_paths(
    antennas_m: np.ndarray, positions_m: np.ndarray, screens: Screens, wavelength_m: float
) -> _Edges:
    """Return the edges of the screen of each pair, on the paths from antennas to scatterers.

    Antennas are (n, 3), or (1, 3) for one that all pairs share.
    """
    x, y, z = (positions_m - antennas_m).T
    length_m = np.maximum(np.hypot(x, y), 1e-9)
    cosine = length_m / np.hypot(length_m, z)
    towards = (x - 1j * y) / length_m
    # Adjacent in memory along the pairs, which are the last axis from here on.
    corners_m, bands_m = (
        np.ascontiguousarray(np.moveaxis(ends_m, 0, -1))
        for ends_m in (screens.corners_m, screens.bands_m)
    )
    corners_m = (corners_m - (antennas_m[:, 0] + 1j * antennas_m[:, 1])) * towards
    # Shares of the path, and distances to its left.
    share, left_m = corners_m.real / length_m, corners_m.imag
    v_per_root = np.sqrt(2 * cosine / (wavelength_m * length_m))
    is_cut = (share.min(axis=0) < MIN_SHARE) | (share.max(axis=0) > 1 - MIN_SHARE)
    width_v, crossing, sensitivity = np.empty((2, len(x))), np.empty((2, len(x))), np.empty(len(x))
    for columns, sides in (
        (np.flatnonzero(~is_cut), _Sides.of_corners),
        (np.flatnonzero(is_cut), _Sides.clipped_to_path),
    ):
        # take keeps the order in memory, which indexing reverses.
        outline = sides(*(values.take(columns, axis=-1) for values in (share, left_m, v_per_root)))
        width_v[:, columns], sensitivity[columns] = outline.width_v(), outline.sensitivity()
        crossing[:, columns] = outline.shares_of_crossing()

    per_metre = _v_per_metre(crossing, v_per_root) * cosine
    line_m = antennas_m[:, 2] + crossing * z
    # (n_bands, 2, n): at both crossings.
    below, above = ((bands_m[:, end, None] - line_m) * per_metre for end in (0, 1))
    bottom, top = below.min(axis=1), above.max(axis=1)
    nearest = np.minimum(abs(below), abs(above)).min(axis=(0, 1))
    change = (per_metre * (1 - crossing)).max(axis=0) / np.maximum(nearest, 1)
    sensitivity = np.maximum(sensitivity, change)
    # Bands that overlap, as a long body over its image in the road, leave no gap between them.
    top[:-1] = np.minimum(top[:-1], bottom[1:])
    return _Edges(width_v, np.stack([bottom, top]), sensitivity)


def _v_per_metre(share: np.ndarray, v_per_root: np.ndarray) -> np.ndarray:
    """Return the parameter v of an edge per metre across the path, at a share of the path."""
    ends = np.clip(share, MIN_SHARE, 1 - MIN_SHARE)
    return np.asarray(v_per_root / np.sqrt(ends * (1 - ends)))


class _Sides(NamedTuple):
    """Sides of screens from above, relative to paths: four ends, or both ends of four sides."""

    share: np.ndarray
    """(4 or 8, n): share of the path."""
    left_m: np.ndarray
    """(4 or 8, n): distance to its left."""
    per_metre: np.ndarray
    """(4 or 8, n): v per metre."""
    v: np.ndarray
    """(4 or 8, n): parameters of edges there."""
    is_between: np.ndarray | None
    """(8, n): False for sides entirely before the antenna or beyond the scatterer; None: True."""

    @classmethod
    def of_corners(cls, share: np.ndarray, left_m: np.ndarray, v_per_root: np.ndarray) -> "_Sides":
        """Return the sides of screens that are between the antenna and the scatterer."""
        per_metre = _v_per_metre(share, v_per_root)
        return cls(share, left_m, per_metre, left_m * per_metre, None)

    @classmethod
    def clipped_to_path(
        cls, share: np.ndarray, left_m: np.ndarray, v_per_root: np.ndarray
    ) -> "_Sides":
        """Return the parts of the sides that are between the antenna and the scatterer."""
        step, left_step_m = np.roll(share, -1, axis=0) - share, np.roll(left_m, -1, axis=0) - left_m
        step[abs(step) < 1e-15] = 1e-15
        low, high = (MIN_SHARE - share) / step, (1 - MIN_SHARE - share) / step
        ends = np.clip([np.minimum(low, high), np.maximum(low, high)], 0.0, 1.0)
        clipped = (share + ends * step).reshape(8, -1)
        left_m = (left_m + ends * left_step_m).reshape(8, -1)
        is_between = (clipped > 0.5 * MIN_SHARE) & (clipped < 1 - 0.5 * MIN_SHARE)
        per_metre = _v_per_metre(clipped, v_per_root)
        return cls(clipped, left_m, per_metre, left_m * per_metre, is_between)

    def width_v(self) -> np.ndarray:
        """Return the parameters of the right and the left edge, (2, n)."""
        if self.is_between is None:
            return np.stack([self.v.min(axis=0), self.v.max(axis=0)])
        right, left = (np.where(self.is_between, self.v, end) for end in (np.inf, -np.inf))
        return np.stack([right.min(axis=0), left.max(axis=0)])

    def sensitivity(self) -> np.ndarray:
        """Return `_Edges.sensitivity` of these edges, (n,)."""
        change = self.per_metre * (1 - self.share) / np.maximum(abs(self.v), 1)
        if self.is_between is not None:
            change = np.where(self.is_between, change, 0.0)
        return np.asarray(change.max(axis=0))

    def shares_of_crossing(self) -> np.ndarray:
        """Return the shares of the path between which it crosses the screen, (2, n).

        Of a path that passes beside the screen: the share of the nearest corner, twice.
        """
        share, left_m = self.share[:4], self.left_m[:4]
        if self.is_between is None:
            next_share, next_m = np.roll(share, -1, axis=0), np.roll(left_m, -1, axis=0)
            crosses = left_m * next_m < 0
        else:
            next_share, next_m = self.share[4:], self.left_m[4:]
            crosses = self.is_between[:4] & self.is_between[4:] & (left_m * next_m < 0)
        where = left_m / np.where(crosses, left_m - next_m, 1.0)
        crossing = share + where * (next_share - share)
        first = np.where(crosses, crossing, np.inf).min(axis=0)
        last = np.where(crosses, crossing, -np.inf).max(axis=0)
        if self.is_between is not None:
            # The antenna or the scatterer is above or below the screen.
            for is_at_end, ends, end in (
                (self.is_between & (self.share < 2 * MIN_SHARE), first, 0.0),
                (self.is_between & (self.share > 1 - 2 * MIN_SHARE), last, 1.0),
            ):
                end_left_m = np.where(is_at_end, self.left_m, 0.0)
                ends[(end_left_m > 0).any(axis=0) & (end_left_m < 0).any(axis=0)] = end
        beside = np.flatnonzero(np.isinf(first) | np.isinf(last))
        distance_v = abs(self.v.take(beside, axis=1))
        if self.is_between is not None:
            distance_v[~self.is_between.take(beside, axis=1)] = np.inf
        nearest = distance_v.argmin(axis=0)
        first[beside] = last[beside] = self.share[nearest, beside]
        return np.stack([first, last])


SHADOWED_LOSS = 16.0
"""Two-way loss, a power ratio, at the edge of the geometric shadow of a body: 6.02 dB each way."""


def scatterer_shadow_gains(scene: Scene, time_s: float, wavelength_m: float) -> np.ndarray:
    """Return the two-way power ratio with to without shadows, from the radar's origin, (n,)."""
    if not scene.has_shadows:
        return np.ones(scene.n_scatterers)

    def compute() -> np.ndarray:
        positions_m = from_local_axes(
            scene.ego.axes(np.array([time_s])), scene.scatterer_positions_at_m(time_s)[None]
        )[0]
        (amplitudes,) = shadowed_amplitudes(
            np.zeros((1, 3)), positions_m, scene.target_index_of_scatterer,
            screens_of_bodies(scene, time_s), wavelength_m,
        )  # fmt: skip
        return np.asarray(amplitudes**4)

    return scene.latest_value("shadow gains", (time_s, wavelength_m), compute)


def target_shadow_losses(scene: Scene, times_s: np.ndarray, wavelength_m: float) -> np.ndarray:
    """Return the two-way shadow loss of each target, (n_times, n_targets), a power ratio.

    The sum of the mean cross sections of its scatterers, over that of what shadows leave of them;
    1 for a target that does not reflect.
    """
    losses = np.ones((len(times_s), len(scene.targets)))
    for row, time_s in zip(losses, times_s.tolist() if scene.has_shadows else (), strict=False):
        rcs_m2 = scatterer_cross_sections_m2(scene, time_s, wavelength_m)
        all_m2, left_m2 = (
            np.bincount(scene.target_index_of_scatterer, part_m2)
            for part_m2 in (rcs_m2, rcs_m2 * scatterer_shadow_gains(scene, time_s, wavelength_m))
        )
        np.divide(all_m2, np.maximum(left_m2, 1e-60 * all_m2), out=row, where=all_m2 > 0)
    return losses
