"""Spatial smoothing: sliding windows over a uniform array, and their covariance data.

Subspace methods need as many independent snapshots as there are sources; a detection usually has a
single one. Shifted parts of a uniform array observe the same sources with other phases, and read
backwards and conjugated they provide further snapshots (forward-backward spatial smoothing: T.-J.
Shan, M. Wax and T. Kailath, IEEE Trans. ASSP 33(4), 1985; S. U. Pillai and B. H. Kwon, IEEE Trans.
ASSP 37(1), 1989).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.processing.angle.aperture import Aperture

__all__ = ["Smoothing"]


@frozen_dataclass
class Smoothing:
    """Size of the windows that slide over a uniform array."""

    share: float = 2 / 3
    """Share of each side of the array that a window takes. Two thirds are near the least variance
    (Y. Hua and T. K. Sarkar, IEEE Trans. ASSP 38(5), 1990)."""

    def __post_init__(self) -> None:
        check_number("Smoothing.share", self.share, above=0, at_most=1)

    def window_length(self, n_elements: int) -> int:
        """Return the elements of a window along a side of n; at least two to resolve directions."""
        return max(min(n_elements, 2), round(self.share * n_elements))


@dataclass(frozen=True, eq=False)
class SlidingWindows:
    """Windows that slide over the points of a uniform array."""

    point_weights: np.ndarray
    """Weight of each element in the mean at each point, (n_points, n_elements)."""
    points: np.ndarray
    """Points of each window, (n_windows, size)."""
    spacing: float = 0.0
    """Spacing of the points of a line, in wavelengths."""
    backward: bool = True
    """True if windows are also read backwards, which requires symmetric ones."""

    @property
    def n_window_points(self) -> int:
        """Number of points of a window."""
        return self.points.shape[1]

    @property
    def first_window_element_indices(self) -> np.ndarray:
        """An element at each point of the first window, (size,)."""
        return np.argmax(self.point_weights[self.points[0]] > 0, axis=1)

    @property
    def n_independent_values_per_snapshot(self) -> float:
        """Independent values in the windows of a snapshot, by the variance of their mean power."""
        use_counts = np.bincount(self.points.ravel(), minlength=len(self.point_weights))
        return float(np.sum(use_counts) ** 2 / np.sum(use_counts**2))

    def max_separable_sources(self, n_snapshots: int) -> int:
        """Return the number of sources that windows over the snapshots can separate."""
        n_columns = n_snapshots * len(self.points) * (2 if self.backward else 1)
        return min(self.n_window_points - 1, n_columns)

    def memory_limited_slices(self, n_detections: int, n_snapshots: int) -> Iterator[slice]:
        """Yield slices of n detections whose data and covariance take 16 MB, or one detection."""
        n_columns = n_snapshots * len(self.points) * 2
        block_size = max(1, 2**20 // (self.n_window_points * (self.n_window_points + n_columns)))
        return (slice(first, first + block_size) for first in range(0, n_detections, block_size))

    def window_data_matrices(self, snapshots: np.ndarray) -> np.ndarray:
        """Return the data of each window, (n, size, columns), of (n, n_snapshots, n_elements).

        A column for each snapshot and window; those read backwards follow.
        """
        forward = self.forward_data_matrices(snapshots)
        if not self.backward:
            return forward
        return np.concatenate([forward, forward[:, ::-1].conj()], axis=2)

    def multiply_data_matrices_from_left(
        self, rows: np.ndarray, snapshots: np.ndarray
    ) -> np.ndarray:
        """Return rows (n, k, size) times `window_data_matrices`, (n, k, columns)."""
        forward = self.forward_data_matrices(snapshots)
        if not self.backward:
            return np.asarray(rows @ forward)
        backward = rows[..., ::-1].conj() @ forward
        return np.concatenate([rows @ forward, backward.conj()], axis=2)

    def forward_data_matrices(self, snapshots: np.ndarray) -> np.ndarray:
        """Return the columns of `window_data_matrices` that are not read backwards."""
        point_values = snapshots @ self.point_weights.T.astype(snapshots.real.dtype)
        columns = point_values[:, :, self.points].reshape(len(snapshots), -1, self.n_window_points)
        return np.swapaxes(columns, 1, 2)

    def real_valued_data_matrices(self, snapshots: np.ndarray) -> np.ndarray:
        """Return real matrices with the rotated covariance of the forward-backward data matrices.

        Sums and differences of elements that mirror each other make it real: a quarter of the
        work (D. A. Linebarger, R. D. DeGroat and E. M. Dowling, IEEE Trans. SP 42(8), 1994).
        """
        # One window a row, as in memory.
        forward = np.swapaxes(self.forward_data_matrices(snapshots), 1, 2)
        half = self.n_window_points // 2
        top, bottom = forward[..., :half], forward[..., : -half - 1 : -1]
        middle = 2**0.5 * forward[..., half : self.n_window_points - half]
        n_rows = forward.shape[1]
        rotated = np.empty((len(forward), 2 * n_rows, self.n_window_points), forward.real.dtype)
        real, imaginary = rotated[:, :n_rows], rotated[:, n_rows:]
        sums, differences = top + bottom, bottom - top
        for out, part in ((real, "real"), (imaginary, "imag")):
            out[..., :half] = getattr(sums, part)
            out[..., half : self.n_window_points - half] = getattr(middle, part)
        real[..., self.n_window_points - half :] = -differences.imag
        imaginary[..., self.n_window_points - half :] = differences.real
        return np.swapaxes(rotated, 1, 2)

    def rotated_vectors(self, vectors: np.ndarray) -> np.ndarray:
        """Rotate vectors (n, size, k) to the basis of `real_valued_data_matrices`."""
        half = self.n_window_points // 2
        top, bottom = vectors[:, :half], vectors[:, : -half - 1 : -1]
        middle = vectors[:, half : self.n_window_points - half]
        even, odd = (top + bottom) / 2**0.5, (top - bottom) / (1j * 2**0.5)
        return np.concatenate([even, middle, odd], axis=1)

    def complex_vectors_from_rotated(self, rotated: np.ndarray) -> np.ndarray:
        """Rotate vectors (n, size, k) of `real_valued_data_matrices` back."""
        half = self.n_window_points // 2
        even, odd = rotated[:, :half], rotated[:, self.n_window_points - half :]
        top, bottom = (even + 1j * odd) / 2**0.5, (even - 1j * odd) / 2**0.5
        middle = rotated[:, half : self.n_window_points - half]
        return np.concatenate([top, middle, bottom[:, ::-1]], axis=1)

    def bilinear_noise_variance(
        self, left_vectors: np.ndarray, right_vectors: np.ndarray
    ) -> np.ndarray:
        """Return the variance of Re(left^H W right), (...), with W the data of unit white noise.

        `left_vectors` is (..., size), `right_vectors` (..., columns). The noise of an element is in
        several windows, conjugated in those read backwards: its contributions are summed, then
        squared.
        """
        n_halves, n_windows = 2 if self.backward else 1, len(self.points)
        columns = right_vectors.reshape(
            -1, n_halves, right_vectors.shape[-1] // (n_halves * n_windows), n_windows
        )
        per_point = np.sum(self.point_weights**2, axis=1)
        rows = np.ascontiguousarray(left_vectors.reshape(-1, self.n_window_points))
        return _bilinear_noise_variances(rows, columns, self.points, per_point).reshape(
            left_vectors.shape[:-1]
        )


@kernel(plain=AS_WRITTEN)
def _bilinear_noise_variances(
    left_vectors: np.ndarray,
    right_vectors: np.ndarray,
    window_points: np.ndarray,
    variance_per_point: np.ndarray,
) -> np.ndarray:
    """Compute the bilinear noise variance of (m, size) and (m, halves, snapshots, windows)."""
    m, n_halves, n_snapshots, n_windows = right_vectors.shape
    size = left_vectors.shape[1]
    out = np.zeros(m)
    for i in range(m):
        for snapshot in range(n_snapshots):
            weights = np.zeros(len(variance_per_point), np.complex128)
            for window in range(n_windows):
                forward = right_vectors[i, 0, snapshot, window]
                for e in range(size):
                    weights[window_points[window, e]] += forward * np.conj(left_vectors[i, e])
                if n_halves == 2:
                    backward = np.conj(right_vectors[i, 1, snapshot, window])
                    for e in range(size):
                        weights[window_points[window, e]] += (
                            backward * left_vectors[i, size - 1 - e]
                        )
            for p in range(len(variance_per_point)):
                out[i] += (weights[p].real ** 2 + weights[p].imag ** 2) * variance_per_point[p] / 2
    return out


@lru_cache(maxsize=32)
def array_smoothing_windows(aperture: Aperture, smoothing: Smoothing) -> SlidingWindows:
    """Return windows over a uniform line or rectangle; the whole array for any other shape."""
    element_grid = aperture.element_grid
    if element_grid is not None:
        n_left, n_up = element_grid.indices.max(axis=0) + 1
        point = element_grid.indices[:, 1] * n_left + element_grid.indices[:, 0]
        if len(np.unique(point)) == n_left * n_up:
            size = smoothing.window_length(n_up), smoothing.window_length(n_left)
            all_elements = np.arange(aperture.n_elements)
            return SlidingWindows(
                _averaging_weights_of_coincident_elements(point, all_elements, aperture),
                _window_point_indices((n_up, n_left), size),
            )
    n = aperture.n_elements
    return SlidingWindows(np.eye(n), np.arange(n)[None], backward=False)


@lru_cache(maxsize=32)
def longest_ula_windows_and_axis(
    aperture: Aperture, smoothing: Smoothing, estimator_name: str
) -> tuple[SlidingWindows, int]:
    """Return windows over the longest even part of a row or column of elements, and its axis.

    The axis is 0 for a row, which resolves azimuth, 1 for a column, which resolves elevation.

    Raises
    ------
    InvalidSetting
        About `estimator_name`, where no three elements follow each other at even steps.
    """
    element_grid = aperture.element_grid
    runs = [] if element_grid is None else list(_evenly_spaced_element_runs(element_grid.indices))
    axis, stride, members, point = max(
        runs, key=lambda run: run[3].max(), default=(0, 1, np.zeros(0, int), np.zeros(1, int))
    )
    n_points = int(point.max()) + 1
    if element_grid is None or n_points < 3:
        raise InvalidSetting(
            f"{estimator_name}.kind",
            value=f"an array of {aperture.n_elements} virtual elements without a uniform line",
            expected="three or more elements at even steps along left or up",
            fix="use maximum-likelihood or iterative-adaptive, which accept any array",
        )
    points = _window_point_indices((1, n_points), (1, smoothing.window_length(n_points)))
    share = _averaging_weights_of_coincident_elements(point, members, aperture)
    return SlidingWindows(share, points, spacing=element_grid.spacing[axis] * stride), axis


def check_windows_separate_sources(
    estimator_name: str, n_sources: object, windows: SlidingWindows, n_snapshots: int
) -> None:
    """Check that windows can separate the requested number of sources."""
    max_sources = windows.max_separable_sources(n_snapshots)
    if isinstance(n_sources, int) and n_sources > max_sources:
        raise InvalidSetting(
            f"{estimator_name}.n_sources",
            value=n_sources,
            expected=f"at most {max_sources}, for windows of {windows.n_window_points} elements in"
            f" {len(windows.points)} place{'s' * (len(windows.points) > 1)},"
            f" snapshots: {n_snapshots}",
            fix="lower n_sources, with smoothing.share near 2/3"
            if windows.backward
            else "use maximum-likelihood or iterative-adaptive, since the array is not uniform",
        )


def _evenly_spaced_element_runs(
    grid_indices: np.ndarray,
) -> Iterator[tuple[int, int, np.ndarray, np.ndarray]]:
    """Yield even parts of rows and columns: axis, step, elements and their points from 0 on.

    `grid_indices` (n_elements, 2) are grid indices; coincident elements share a point.
    """
    for axis in (0, 1):
        for row in np.unique(grid_indices[:, 1 - axis]):
            members = np.flatnonzero(grid_indices[:, 1 - axis] == row)
            coordinates = grid_indices[members, axis]
            occupied = np.unique(coordinates)
            step = int(np.diff(occupied).min(initial=coordinates.max() + 1))
            for run in np.split(occupied, np.flatnonzero(np.diff(occupied) > step) + 1):
                is_inside = np.isin(coordinates, run)
                yield axis, step, members[is_inside], (coordinates[is_inside] - run[0]) // step


def _averaging_weights_of_coincident_elements(
    point_of_member: np.ndarray, members: np.ndarray, aperture: Aperture
) -> np.ndarray:
    """Return the weight of each element in the mean at its point, (n_points, n_elements)."""
    weights = np.zeros((point_of_member.max() + 1, aperture.n_elements))
    weights[point_of_member, members] = 1 / np.bincount(point_of_member)[point_of_member]
    return weights


def _window_point_indices(
    rectangle_shape: tuple[int, int], window_shape: tuple[int, int]
) -> np.ndarray:
    """Return the points of all windows of a size in a rectangle, (n_windows, points)."""
    points = np.arange(rectangle_shape[0] * rectangle_shape[1]).reshape(rectangle_shape)
    windows = np.lib.stride_tricks.sliding_window_view(points, window_shape)
    return windows.reshape(-1, window_shape[0] * window_shape[1])
