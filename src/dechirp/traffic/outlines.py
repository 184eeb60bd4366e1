"""Outlines of objects seen from above, as rectangles around a radar at the origin."""

import numpy as np

QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Rotation of vectors seen from above by 90 degrees to the left."""
_N_RAYS = 1441  # over half a circle: 0.125 degrees, a car's width at 800 m


def rotation(angle_rad: float) -> np.ndarray:
    """Return the rotation to the left by an angle, (2, 2)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s], [s, c]])


def rectangle_corners_m(
    centre_m: np.ndarray, heading_rad: float, length_m: float, width_m: float
) -> np.ndarray:
    """Return the corners of a rectangle in order around it, (4, 2)."""
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2 * [length_m, width_m]
    return np.asarray(corners @ rotation(heading_rad).T + centre_m)


def contains_origin(corners_m: np.ndarray) -> np.ndarray:
    """Return True if the origin is inside a rectangle (..., 4, 2) or on its edge, (...)."""
    edges_m = np.roll(corners_m, -1, axis=-2) - corners_m
    sides = edges_m[..., 0] * corners_m[..., 1] - edges_m[..., 1] * corners_m[..., 0]
    return np.asarray(np.all(sides <= 0, axis=-1) | np.all(sides >= 0, axis=-1))


def nearest_point_m(corners_m: np.ndarray) -> np.ndarray:
    """Return the point of an outline (..., 4, 2) that is nearest to the origin, (..., 2)."""
    edges_m = np.roll(corners_m, -1, axis=-2) - corners_m
    along = -np.sum(corners_m * edges_m, axis=-1) / np.sum(edges_m**2, axis=-1)
    points_m = corners_m + np.clip(along, 0, 1)[..., None] * edges_m
    nearest = np.argmin(np.sum(points_m**2, axis=-1), axis=-1)[..., None, None]
    return np.asarray(np.take_along_axis(points_m, nearest, axis=-2)[..., 0, :])


def distances_from_outlines_m(points_m: np.ndarray, outlines_m: np.ndarray) -> np.ndarray:
    """Return the distance of each point (..., 2) from the nearest of outlines (n, 4, 2), (...).

    It is 0 inside, and infinite without outlines or for NaN.
    """
    distances_m = np.full(points_m.shape[:-1], np.inf)
    for corners_m in outlines_m:
        around_m = corners_m - points_m[..., None, :]
        away_m = np.linalg.norm(nearest_point_m(around_m), axis=-1)
        away_m = np.where(contains_origin(around_m), 0.0, away_m)
        distances_m = np.fmin(distances_m, away_m)
    return distances_m


def visible_shares(outlines_m: np.ndarray) -> np.ndarray:
    """Return the share of each outline that no other hides from the origin, (n,).

    It is the share of the angle under which the part in front of the radar (x > 0) appears; 0 for
    outlines behind it.

    Parameters
    ----------
    outlines_m : array (n, 4, 2)
        Corners of rectangles that do not contain the origin.
    """
    if not len(outlines_m):
        return np.zeros(0)
    azimuths_rad = np.linspace(-np.pi / 2, np.pi / 2, _N_RAYS)[1:-1]
    rays = np.stack([np.cos(azimuths_rad), np.sin(azimuths_rad)])
    distances_m = np.full((len(outlines_m), azimuths_rad.size), np.inf)
    for index, corners_m in enumerate(outlines_m):
        distances_m[index] = _distances_along_rays_m(corners_m, rays)
    hits = np.isfinite(distances_m)
    is_first = hits & (distances_m <= distances_m.min(axis=0))
    n_hits = hits.sum(axis=1)
    return np.asarray(np.where(n_hits > 0, is_first.sum(axis=1) / np.maximum(n_hits, 1), 0.0))


def _distances_along_rays_m(corners_m: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return the distance to a rectangle along unit vectors, (2, n); infinite if they miss it."""
    sides_m = corners_m[[0, 1]] - corners_m[[1, 2]]
    lengths_m = np.linalg.norm(sides_m, axis=1)
    axes, centre_m = sides_m / lengths_m[:, None], corners_m.mean(axis=0)
    with np.errstate(divide="ignore"):
        slopes = 1 / (axes @ rays)
    offsets_m = axes @ centre_m
    with np.errstate(invalid="ignore"):
        near_m = (offsets_m[:, None] - np.sign(slopes) * lengths_m[:, None] / 2) * slopes
        far_m = (offsets_m[:, None] + np.sign(slopes) * lengths_m[:, None] / 2) * slopes
    entry_m, exit_m = near_m.max(axis=0), far_m.min(axis=0)
    return np.where((entry_m <= exit_m) & (entry_m > 0), entry_m, np.inf)
