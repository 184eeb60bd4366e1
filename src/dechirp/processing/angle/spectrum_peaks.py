"""Peaks of spectra over directions, on the grid and between its points."""

from collections.abc import Callable

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.processing.angle.aperture import Aperture, DirectionGrid

# Halvings of a grid step: to a 256th, a 2000th of a beam on one axis; then a parabola.
_HALVINGS = 8


def find_grid_peak_directions(
    spectrum: np.ndarray, grid: DirectionGrid, n_sources: np.ndarray, max_peaks: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuths and elevations of the highest local maxima, (n, columns) each, highest first.

    A maximum is above its neighbours, eight on two axes; ends of the grid may be maxima. NaN
    beyond the existing maxima, and beyond the `n_sources` (n,) of a detection. `spectrum` is (n,
    n_directions).
    """
    maps = spectrum.reshape(-1, *grid.shape)
    peak_index = _peak_indices_in_maps(np.ascontiguousarray(maps), n_sources, max_peaks)
    row, column = np.divmod(peak_index, grid.shape[1])
    is_peak = peak_index >= 0
    azimuth = np.where(is_peak, grid.azimuth_rad[column], np.nan)
    return azimuth, np.where(is_peak, grid.elevation_rad[row], np.nan)


def _peak_indices_in_numpy(maps: np.ndarray, n_sources: np.ndarray, max_peaks: int) -> np.ndarray:
    """Plain twin of `_peak_indices_in_maps`: equal indices."""
    n, n_rows, n_columns = maps.shape
    padded = np.pad(maps, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    is_peak = np.ones(maps.shape, bool)
    for row, column in np.ndindex(3, 3):
        if (row, column) != (1, 1):
            neighbour = padded[:, row : row + n_rows, column : column + n_columns]
            is_earlier = (row, column) < (1, 1)
            is_peak &= maps > neighbour if is_earlier else maps >= neighbour
    peak_index = np.full((n, max_peaks), -1)
    for i in range(n):
        cells = np.flatnonzero(is_peak[i])
        highest = np.argsort(-maps[i].ravel()[cells], kind="stable")[: n_sources[i]]
        peak_index[i, : len(highest)] = cells[highest]
    return peak_index


@kernel(plain=_peak_indices_in_numpy)
def _peak_indices_in_maps(maps: np.ndarray, n_sources: np.ndarray, max_peaks: int) -> np.ndarray:
    """Return flat indices of the highest local maxima in each map, highest first, -1 for none."""
    n, n_rows, n_columns = maps.shape
    peak_index = np.full((n, max_peaks), -1)
    for i in range(n):
        spectrum, n_found = maps[i], 0
        for row in range(n_rows):
            for column in range(n_columns):
                value = spectrum[row, column]
                is_full = n_found == n_sources[i]
                if is_full and (
                    n_found == 0 or not value > maps[i].flat[peak_index[i, n_found - 1]]
                ):
                    continue
                if not _is_local_maximum(spectrum, row, column):
                    continue
                # Insert in order; the lowest drops out of a full list.
                n_found = min(n_found + 1, n_sources[i])
                k = n_found - 1
                while k > 0 and value > maps[i].flat[peak_index[i, k - 1]]:
                    peak_index[i, k] = peak_index[i, k - 1]
                    k -= 1
                peak_index[i, k] = row * n_columns + column
    return peak_index


@kernel(inline="always")
def _is_local_maximum(spectrum: np.ndarray, row: int, column: int) -> bool:
    """Return True for a local maximum; on a plateau, for its first cell."""
    n_rows, n_columns = spectrum.shape
    for d_row in range(-1, 2):
        for d_column in range(-1, 2):
            r, c = row + d_row, column + d_column
            if (d_row == 0 and d_column == 0) or not (0 <= r < n_rows and 0 <= c < n_columns):
                continue
            is_earlier = d_row < 0 or (d_row == 0 and d_column < 0)
            is_higher = (
                spectrum[r, c] >= spectrum[row, column]
                if is_earlier
                else spectrum[r, c] > spectrum[row, column]
            )
            if is_higher:
                return False
    return True


def refine_spectrum_peaks(
    spectrum_at: Callable[[np.ndarray], np.ndarray],
    aperture: Aperture,
    azimuth_rad: np.ndarray,
    elevation_rad: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Refine peaks of a spectrum near grid points by halving steps, then a parabola.

    `spectrum_at` returns the spectrum (n, m) at steering vectors (n, m, n_elements), a set for
    each of n snapshots; directions are (n, n_sources), NaN where there are fewer.
    """
    is_peak = ~np.isnan(azimuth_rad)
    limit = np.array(aperture.field_of_view.max_angle_sines)
    sines = np.sin(np.stack([azimuth_rad, elevation_rad], axis=-1))
    sines[~is_peak] = 0.0
    # Nine points about each, or three where the array resolves one angle.
    offsets = np.stack(
        np.meshgrid(
            *(
                np.array([-1, 0, 1]) if is_resolved else np.zeros(1)
                for is_resolved in aperture.resolves_azimuth_and_elevation
            )
        ),
        axis=-1,
    ).reshape(-1, 2)
    # On two axes a ridge may lie askew: two steps of each size.
    halvings = np.repeat(np.arange(1, _HALVINGS + 1), sum(aperture.resolves_azimuth_and_elevation))
    for halving in halvings:
        size = np.array(aperture.direction_grid_sine_steps) / 2.0**halving
        candidates = np.clip(sines[:, :, None] + offsets * size, -limit, limit)
        values = _spectrum_at_sines(spectrum_at, aperture, candidates)
        best = np.argmax(values, axis=2)[..., None, None]
        sines = np.take_along_axis(candidates, best, axis=2)[:, :, 0]
    for axis in np.flatnonzero(aperture.resolves_azimuth_and_elevation):
        axis_offsets = np.zeros((3, 2))
        axis_offsets[:, axis] = [-1, 0, 1]
        values = _spectrum_at_sines(
            spectrum_at, aperture, np.clip(sines[:, :, None] + axis_offsets * size, -limit, limit)
        )
        curve = values[..., 0] - 2 * values[..., 1] + values[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = (values[..., 0] - values[..., 2]) / (2 * curve)
        shift = np.where(curve < 0, np.clip(shift, -1, 1), 0.0)
        sines[..., axis] = np.clip(sines[..., axis] + shift * size[axis], -limit[axis], limit[axis])
    azimuth, elevation = np.where(is_peak[..., None], np.arcsin(sines), np.nan).transpose(2, 0, 1)
    return azimuth, elevation


def _spectrum_at_sines(
    spectrum_at: Callable[[np.ndarray], np.ndarray], aperture: Aperture, sines: np.ndarray
) -> np.ndarray:
    """Return the spectrum (n, k, m) at sines of azimuth and elevation, (n, k, m, 2)."""
    n, k, m, _ = sines.shape
    angles = np.arcsin(sines.reshape(n, k * m, 2))
    values = spectrum_at(aperture.steering_vectors(angles[..., 0], angles[..., 1]))
    return values.reshape(n, k, m)
