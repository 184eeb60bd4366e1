"""Road users of a traffic file whose outlines overlap."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.traffic.base import STRUCTURE_KINDS
from dechirp.traffic.road_bodies import Size, complete_size

_MIN_OVERLAP_M = 0.3
"""Recorded positions and sizes err by up to 0.1 m each, for both objects."""
OVERLAP_FIX = (
    "correct their positions or sizes, or remove one of them if it is a copy of the other or a part"
    " of it, such as a trailer"
)


class Overlap(NamedTuple):
    """Two objects, by their indices, at the first time at which they overlap."""

    first: int
    second: int
    time_s: float
    depth_m: float
    """Least distance by which one of them would have to move."""


def find_overlaps(objects: xr.Dataset) -> list[Overlap]:
    """Return pairs of road users that overlap by more than 0.3 m, seen from above.

    Unknown sizes are those of the kind, and an unknown heading is 0. Of each pair, the first time
    counts.

    Parameters
    ----------
    objects : Dataset
        Objects as `Traffic.objects`.
    """
    is_road_user = ~np.isin(objects["kind"].values, list(STRUCTURE_KINDS))
    sizes_m = np.array(
        [
            complete_size(kind, Size(*size))[:2]
            for kind, *size in zip(
                objects["kind"].values.tolist(),
                *(objects[name].values.tolist() for name in ("length", "width", "height")),
                strict=True,
            )
        ]
    )
    places_m = np.stack([objects["x"].values, objects["y"].values], axis=-1)
    headings_rad = np.nan_to_num(objects["heading"].values)
    overlaps: dict[tuple[int, int], Overlap] = {}
    for index, time_s in enumerate(objects["time"].values.tolist()):
        present = np.flatnonzero(np.isfinite(places_m[:, index, 0]) & is_road_user)
        pairs, depths_m = find_overlapping_pairs(
            places_m[present, index], headings_rad[present, index], sizes_m[present]
        )
        for (first, second), depth_m in zip(
            present[pairs].tolist(), depths_m.tolist(), strict=True
        ):
            overlaps.setdefault((first, second), Overlap(first, second, time_s, depth_m))
    return sorted(overlaps.values(), key=lambda pair: (pair.time_s, pair.first, pair.second))


def find_overlapping_pairs(
    places_m: np.ndarray, headings_rad: np.ndarray, sizes_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of rectangles that overlap by more than 0.3 m, (pair, 2), and the depths.

    Parameters
    ----------
    places_m, sizes_m : array (n, 2)
        Centres, and length and width.
    headings_rad : array (n,)
    """
    from scipy.spatial import KDTree  # 0.2 s, which most commands do not need

    if len(places_m) < 2:
        return np.zeros((0, 2), dtype=int), np.zeros(0)
    largest_diameter_m = np.hypot(*sizes_m.T).max()
    pairs = KDTree(places_m).query_pairs(largest_diameter_m, output_type="ndarray")
    depths_m = _overlap_depths_m(places_m[pairs], headings_rad[pairs], sizes_m[pairs])
    is_deep = depths_m > _MIN_OVERLAP_M
    return pairs[is_deep], depths_m[is_deep]


def _overlap_depths_m(
    places_m: np.ndarray, headings_rad: np.ndarray, sizes_m: np.ndarray
) -> np.ndarray:
    """Return the depth by which two rectangles overlap, (n,); negative if they are apart.

    Convex shapes are apart if they are so along the normal of a side of one of them (separating
    axis theorem).

    Parameters
    ----------
    places_m, sizes_m : array (n, 2, 2)
        Centres, and length and width, of both rectangles of each pair.
    headings_rad : array (n, 2)
    """
    c, s = np.cos(headings_rad), np.sin(headings_rad)
    sides = np.stack([np.stack([c, s], axis=-1), np.stack([-s, c], axis=-1)], axis=2)
    half_sides_m = sides * sizes_m[..., None] / 2  # (pair, rectangle, side, xy)
    normals = sides.reshape(-1, 4, 2)
    reach_m = np.abs(np.einsum("nrsx,nax->nars", half_sides_m, normals)).sum(axis=(2, 3))
    away_m = np.abs(np.einsum("nx,nax->na", places_m[:, 1] - places_m[:, 0], normals))
    return np.asarray((reach_m - away_m).min(axis=1))
