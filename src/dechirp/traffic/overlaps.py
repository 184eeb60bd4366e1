"""Road users of a traffic file whose outlines overlap."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.traffic.base import STRUCTURE_KINDS
from dechirp.traffic.road_bodies import Size, complete_size

_MIN_OVERLAP_M = 0.3
"""Recorded positions and sizes err by up to 0.1 m each, for both objects."""


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
    from scipy.spatial import KDTree  # 0.2 s, which most commands do not need

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
    radii_m = np.hypot(*sizes_m.T) / 2
    places_m = np.stack([objects["x"].values, objects["y"].values], axis=-1)
    headings_rad = np.nan_to_num(objects["heading"].values)
    n_objects = len(radii_m)
    overlaps: dict[int, Overlap] = {}
    for index, time_s in enumerate(objects["time"].values.tolist()):
        present = np.flatnonzero(np.isfinite(places_m[:, index, 0]) & is_road_user)
        if present.size < 2:
            continue
        tree = KDTree(places_m[present, index])
        near = tree.query_pairs(2 * radii_m[present].max(), output_type="ndarray")
        pairs = present[near]
        pairs = pairs[~np.isin(pairs @ (n_objects, 1), list(overlaps))]
        depths_m = _overlap_depths_m(
            places_m[pairs, index], headings_rad[pairs, index], sizes_m[pairs]
        )
        for row in np.flatnonzero(depths_m > _MIN_OVERLAP_M).tolist():
            first, second = pairs[row].tolist()
            overlaps[first * n_objects + second] = Overlap(
                first, second, time_s, float(depths_m[row])
            )
    return sorted(overlaps.values(), key=lambda pair: (pair.time_s, pair.first, pair.second))


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
