"""Peaks of spectra over directions: on the grid, and between its points."""

from collections.abc import Callable

import numba
import numpy as np

from dechirp.process.angle.aperture import Aperture, Grid

# Halvings of a grid step: to a 256th, a 2000th of a beam on one axis; then a parabola.
_HALVINGS = 8


def highest(
    spectrum: np.ndarray, grid: Grid, most: np.ndarray, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """Azimuths and elevations of the highest local maxima, (n, columns) each, highest first.

    A maximum is above its neighbours, eight on two axes; ends of the grid may be maxima. NaN
    beyond those that there are, and beyond the `most` (n,) that are sought in a snapshot.
    `spectrum` is (n, n_directions).
    """
    maps = spectrum.reshape(-1, *grid.shape)
    place = _highest(np.ascontiguousarray(maps), most, columns)
    row, column = np.divmod(place, grid.shape[1])
    found = place >= 0
    azimuth = np.where(found, grid.azimuth_rad[column], np.nan)
    return azimuth, np.where(found, grid.elevation_rad[row], np.nan)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _highest(maps: np.ndarray, most: np.ndarray, columns: int) -> np.ndarray:
    """Places of the highest local maxima in each map, highest first, -1 for none."""
    n, n_rows, n_columns = maps.shape
    place = np.full((n, columns), -1)
    for i in range(n):
        one, taken = maps[i], 0
        for row in range(n_rows):
            for column in range(n_columns):
                top = one[row, column]
                full = taken == most[i]
                if full and (taken == 0 or not top > maps[i].flat[place[i, taken - 1]]):
                    continue
                if not _above_neighbours(one, row, column):
                    continue
                # Inserted in order; the lowest falls out where the list is full.
                taken = min(taken + 1, most[i])
                k = taken - 1
                while k > 0 and top > maps[i].flat[place[i, k - 1]]:
                    place[i, k] = place[i, k - 1]
                    k -= 1
                place[i, k] = row * n_columns + column
    return place


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _above_neighbours(one: np.ndarray, row: int, column: int) -> bool:
    """Whether a cell is a local maximum; of a level top, its first cell."""
    n_rows, n_columns = one.shape
    for d_row in range(-1, 2):
        for d_column in range(-1, 2):
            r, c = row + d_row, column + d_column
            if (d_row == 0 and d_column == 0) or not (0 <= r < n_rows and 0 <= c < n_columns):
                continue
            earlier = d_row < 0 or (d_row == 0 and d_column < 0)
            higher = one[r, c] >= one[row, column] if earlier else one[r, c] > one[row, column]
            if higher:
                return False
    return True


def climbed(
    at: Callable[[np.ndarray], np.ndarray],
    aperture: Aperture,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Tops of a spectrum near points of the grid, by steps that halve, then a parabola.

    `at` gives the spectrum (n, m) at steering vectors (n, m, n_elements), a set for each of n
    snapshots; directions are (n, most), NaN where there are fewer.
    """
    known = ~np.isnan(azimuth_rad)
    limit = np.array(aperture.field_of_view.sines)
    sines = np.sin(np.stack([azimuth_rad, elevation_rad], axis=-1))
    sines[~known] = 0.0
    # Nine points about each, or three where the array tells one angle.
    offsets = np.stack(
        np.meshgrid(*(np.array([-1, 0, 1]) if t else np.zeros(1) for t in aperture.tells)), axis=-1
    ).reshape(-1, 2)
    # On two axes a ridge may lie askew: two steps of each size.
    halvings = np.repeat(np.arange(1, _HALVINGS + 1), sum(aperture.tells))
    for halving in halvings:
        size = np.array(aperture.steps) / 2.0**halving
        around = np.clip(sines[:, :, None] + offsets * size, -limit, limit)
        values = _values(at, aperture, around)
        best = np.argmax(values, axis=2)[..., None, None]
        sines = np.take_along_axis(around, best, axis=2)[:, :, 0]
    for axis in np.flatnonzero(aperture.tells):
        along = np.zeros((3, 2))
        along[:, axis] = [-1, 0, 1]
        values = _values(at, aperture, np.clip(sines[:, :, None] + along * size, -limit, limit))
        curve = values[..., 0] - 2 * values[..., 1] + values[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = (values[..., 0] - values[..., 2]) / (2 * curve)
        shift = np.where(curve < 0, np.clip(shift, -1, 1), 0.0)
        sines[..., axis] = np.clip(sines[..., axis] + shift * size[axis], -limit[axis], limit[axis])
    azimuth, elevation = np.where(known[..., None], np.arcsin(sines), np.nan).transpose(2, 0, 1)
    return azimuth, elevation


def _values(
    at: Callable[[np.ndarray], np.ndarray], aperture: Aperture, sines: np.ndarray
) -> np.ndarray:
    """Spectrum (n, k, m) at sines of azimuth and elevation, (n, k, m, 2)."""
    n, k, m, _ = sines.shape
    angles = np.arcsin(sines.reshape(n, k * m, 2))
    values = at(aperture.steering(angles[..., 0], angles[..., 1]))
    return values.reshape(n, k, m)
