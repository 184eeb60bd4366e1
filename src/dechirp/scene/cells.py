"""A surface in cells: cubes of a grid, each with the middle of what it holds."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from dechirp.core.errors import InvalidSetting

_MOST_CUBES = 2_000_000  # of the box around it: a lorry of 20 m in cells of 5 cm
_MOST_PIECES = 8_000_000  # 72 bytes each


@dataclass(frozen=True, eq=False)
class Cells:
    """Cubes that hold a part of a surface."""

    low_m: np.ndarray
    """Corner of the grid, (3,)."""
    size_m: float
    """Of a cube."""
    center_m: np.ndarray
    """Middle of the area in each cell, (n_cells, 3)."""
    nearest: np.ndarray
    """Cell of each cube of the grid, or nearest to it, (n_x, n_y, n_z)."""

    def of(self, place_m: np.ndarray) -> np.ndarray:
        """Cell of each place, of those beyond the grid of the cube nearest to it, (n,)."""
        cube = np.floor((place_m - self.low_m) / self.size_m).astype(np.int64)
        x, y, z = np.clip(cube, 0, np.array(self.nearest.shape) - 1).T
        return self.nearest[x, y, z]


def cells_of(corners_m: np.ndarray, size_m: float) -> Cells:
    """Cut triangles into cells.

    Parameters
    ----------
    corners_m : array (n_faces, 3, 3)
    size_m : float
        Edge of a cell.

    Raises
    ------
    InvalidSetting
        Named `Mesh.cell_size_m`, if there would be too many.
    """
    low_m, high_m = corners_m.min(axis=(0, 1)), corners_m.max(axis=(0, 1))
    counts = np.floor((high_m - low_m) / size_m) + 1
    if np.prod(counts) > _MOST_CUBES:
        raise _too_small(size_m, f"{np.prod(counts):.2g} of which are in its box")
    # Centred, so that a flat mesh is not cut where roundings decide.
    low_m = (low_m + high_m - counts * size_m) / 2
    shape = tuple(counts.astype(int).tolist())
    middle_m, area_m2 = _pieces(corners_m, size_m / 2)
    cube = np.minimum(((middle_m - low_m) / size_m).astype(np.int64), np.array(shape) - 1)
    found, cell = np.unique(np.ravel_multi_index(tuple(cube.T), shape), return_inverse=True)
    sums_m = np.stack([np.bincount(cell, area_m2 * x_m) for x_m in middle_m.T], axis=1)
    cubes = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
    _, nearest = cKDTree(cubes[found]).query(cubes)
    return Cells(
        low_m,
        size_m,
        sums_m / np.bincount(cell, area_m2)[:, None],
        nearest.reshape(shape),
    )


def _pieces(corners_m: np.ndarray, longest_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Middle (n, 3) and area (n,) of triangles, cut in halves until no edge is longer."""
    middles_m, areas_m2, n_pieces = [], [], 0
    while len(corners_m):
        edges_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2)
        is_small = edges_m.max(axis=1) <= longest_m
        small_m = corners_m[is_small]
        middles_m.append(small_m.mean(axis=1))
        across_m2 = np.cross(small_m[:, 1] - small_m[:, 0], small_m[:, 2] - small_m[:, 0])
        areas_m2.append(np.linalg.norm(across_m2, axis=1) / 2)
        n_pieces += len(small_m)
        corners_m, longest = corners_m[~is_small], edges_m[~is_small].argmax(axis=1)
        if n_pieces + 2 * len(corners_m) > _MOST_PIECES:
            raise _too_small(2 * longest_m, "too many for its area")
        order = (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners_m, order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        corners_m = np.concatenate(halves)
    return np.concatenate(middles_m), np.concatenate(areas_m2)


def _too_small(size_m: float, why: str) -> InvalidSetting:
    return InvalidSetting(
        "Mesh.cell_size_m",
        got=f"{size_m:.3g} m, {why}",
        need=f"so large that at most {_MOST_CUBES:.0e} cells fill the box around the mesh",
        fix="Make them larger, or check the unit of the mesh.",
    )
