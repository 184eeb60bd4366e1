"""Voxel grid of a surface: cubic cells with the centre of the area in each."""

from dataclasses import dataclass

import numpy as np
import scipy

from dechirp.core.errors import InvalidSetting

_MAX_CUBES = 2_000_000  # of the bounding box: a lorry of 20 m in cells of 5 cm
_MAX_PIECES = 8_000_000  # 72 bytes each


@dataclass(frozen=True, eq=False)
class SurfaceCells:
    """Cubes that contain a part of a surface."""

    low_m: np.ndarray
    """Corner of the grid, (3,)."""
    size_m: float
    """Edge of a cube."""
    centres_m: np.ndarray
    """Centre of the area in each cell, (n_cells, 3)."""
    cell_indices: np.ndarray
    """Cell in each cube of the grid, or the nearest cell, (n_x, n_y, n_z)."""

    def find_cells(self, position_m: np.ndarray) -> np.ndarray:
        """Return the cell of each position; beyond the grid, that of the nearest cube, (n,)."""
        cube = np.floor((position_m - self.low_m) / self.size_m).astype(np.int64)
        x, y, z = np.clip(cube, 0, np.array(self.cell_indices.shape) - 1).T
        return self.cell_indices[x, y, z]


def cut_triangles_into_cells(corners_m: np.ndarray, size_m: float) -> SurfaceCells:
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
    if np.prod(counts) > _MAX_CUBES:
        raise _too_many_cells_error(size_m, f"{np.prod(counts):.2g} of which are in its box")
    # Centred, so that rounding does not decide how a flat mesh is cut.
    low_m = (low_m + high_m - counts * size_m) / 2
    shape = tuple(counts.astype(int).tolist())
    centres_m, area_m2 = _piece_centres_and_areas(corners_m, size_m / 2)
    cube_indices = np.minimum(((centres_m - low_m) / size_m).astype(np.int64), np.array(shape) - 1)
    occupied, cell = np.unique(
        np.ravel_multi_index(tuple(cube_indices.T), shape), return_inverse=True
    )
    sums_m = np.stack([np.bincount(cell, area_m2 * x_m) for x_m in centres_m.T], axis=1)
    cubes = np.stack(np.unravel_index(np.arange(np.prod(shape)), shape), axis=1)
    _, nearest = scipy.spatial.cKDTree(cubes[occupied]).query(cubes)
    return SurfaceCells(
        low_m,
        size_m,
        sums_m / np.bincount(cell, area_m2)[:, None],
        np.reshape(nearest, shape),
    )


def _piece_centres_and_areas(
    corners_m: np.ndarray, max_edge_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return centres (n, 3) and areas (n,) of triangles, halved until no edge is too long."""
    middles_m, areas_m2, n_pieces = [], [], 0
    while len(corners_m):
        edges_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2)
        is_small = edges_m.max(axis=1) <= max_edge_m
        small_m = corners_m[is_small]
        middles_m.append(small_m.mean(axis=1))
        normals_m2 = np.cross(small_m[:, 1] - small_m[:, 0], small_m[:, 2] - small_m[:, 0])
        areas_m2.append(np.linalg.norm(normals_m2, axis=1) / 2)
        n_pieces += len(small_m)
        corners_m, longest = corners_m[~is_small], edges_m[~is_small].argmax(axis=1)
        if n_pieces + 2 * len(corners_m) > _MAX_PIECES:
            raise _too_many_cells_error(2 * max_edge_m, "too many for its area")
        order = (longest[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners_m, order[:, :, None], axis=1), 1, 0)
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        corners_m = np.concatenate(halves)
    return np.concatenate(middles_m), np.concatenate(areas_m2)


def _too_many_cells_error(size_m: float, reason: str) -> InvalidSetting:
    return InvalidSetting(
        "Mesh.cell_size_m",
        value=f"{size_m:.3g} m, {reason}",
        expected=f"at most {_MAX_CUBES:.0e} cells in the bounding box of the mesh",
        fix="increase the cell size, or check the unit of the mesh",
    )
