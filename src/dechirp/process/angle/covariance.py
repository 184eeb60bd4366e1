"""Few snapshots as many: windows that slide over a uniform array.

Subspace methods need as many independent looks as there are sources; a detection is one.
Parts of a uniform array that differ by a shift see the same sources with other phases, and
read backwards and conjugated they see them again (forward-backward spatial smoothing: T.-J.
Shan, M. Wax and T. Kailath, IEEE Trans. ASSP 33(4), 1985; S. U. Pillai and B. H. Kwon, IEEE
Trans. ASSP 37(1), 1989).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numba
import numpy as np

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.angle.aperture import Aperture


@value
class Smoothing:
    """How large the windows are that slide over a uniform array."""

    share: float = 2 / 3
    """Part of each side of the array that a window takes. Two thirds are near the least
    variance (Y. Hua and T. K. Sarkar, IEEE Trans. ASSP 38(5), 1990)."""

    def __post_init__(self) -> None:
        number("Smoothing.share", self.share, above=0, at_most=1)

    def side(self, n: int) -> int:
        """Elements of a window along a side of n; two or more, which tell a direction."""
        return max(min(n, 2), round(self.share * n))


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows that slide over the points of a uniform array."""

    share: np.ndarray
    """(n_points, n_elements): what each element adds to the mean of those at a point."""
    points: np.ndarray
    """(n_windows, size): points that each window takes."""
    step: float = 0.0
    """Between points of a line, in wavelengths."""
    backward: bool = True
    """Whether windows are read backwards too, which takes symmetric ones."""

    @property
    def size(self) -> int:
        """Points of a window."""
        return self.points.shape[1]

    @property
    def elements(self) -> np.ndarray:
        """An element at each point of the first window, (size,)."""
        return np.argmax(self.share[self.points[0]] > 0, axis=1)

    @property
    def independent(self) -> float:
        """Independent numbers in the windows of one look, by the variance of their mean power."""
        times = np.bincount(self.points.ravel(), minlength=len(self.share))
        return float(np.sum(times) ** 2 / np.sum(times**2))

    def rank(self, n_looks: int) -> int:
        """Sources that data of so many looks can part."""
        n_columns = n_looks * len(self.points) * (2 if self.backward else 1)
        return min(self.size - 1, n_columns)

    def blocks(self, n: int, n_looks: int) -> Iterator[slice]:
        """Slices of n detections whose data and covariance take 16 MB, or one detection."""
        n_columns = n_looks * len(self.points) * 2
        each = max(1, 2**20 // (self.size * (self.size + n_columns)))
        return (slice(first, first + each) for first in range(0, n, each))

    def data(self, snapshots: np.ndarray) -> np.ndarray:
        """What each window saw, (n, size, columns), of snapshots (n, n_looks, n_elements).

        A column for each look and window; those read backwards follow.
        """
        forward = self.forward(snapshots)
        if not self.backward:
            return forward
        return np.concatenate([forward, forward[:, ::-1].conj()], axis=2)

    def seen(self, rows: np.ndarray, snapshots: np.ndarray) -> np.ndarray:
        """Rows (n, k, size) times `data`, (n, k, columns)."""
        forward = self.forward(snapshots)
        if not self.backward:
            return np.asarray(rows @ forward)
        backward = rows[..., ::-1].conj() @ forward
        return np.concatenate([rows @ forward, backward.conj()], axis=2)

    def forward(self, snapshots: np.ndarray) -> np.ndarray:
        """The columns of `data` that are not read backwards."""
        at_points = snapshots @ self.share.T.astype(snapshots.real.dtype)
        taken = at_points[:, :, self.points].reshape(len(snapshots), -1, self.size)
        return np.swapaxes(taken, 1, 2)

    def real_data(self, snapshots: np.ndarray) -> np.ndarray:
        """Real columns with the covariance of `data`, turned; of windows that are read both ways.

        Sums and differences of elements that mirror each other make it real: a quarter of the
        work (D. A. Linebarger, R. D. DeGroat and E. M. Dowling, IEEE Trans. SP 42(8), 1994).
        """
        forward = np.swapaxes(self.forward(snapshots), 1, 2)  # a window a row, as it lies
        half = self.size // 2
        top, bottom = forward[..., :half], forward[..., : -half - 1 : -1]
        middle = 2**0.5 * forward[..., half : self.size - half]
        n_rows = forward.shape[1]
        turned = np.empty((len(forward), 2 * n_rows, self.size), forward.real.dtype)
        real, imaginary = turned[:, :n_rows], turned[:, n_rows:]
        both, apart = top + bottom, bottom - top
        for out, part in ((real, "real"), (imaginary, "imag")):
            out[..., :half] = getattr(both, part)
            out[..., half : self.size - half] = getattr(middle, part)
        real[..., self.size - half :] = -apart.imag
        imaginary[..., self.size - half :] = apart.real
        return np.swapaxes(turned, 1, 2)

    def vectors_back(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors over the elements, (n, size, k), of real ones over rows of `real_data`."""
        half = self.size // 2
        even, odd = vectors[:, :half], vectors[:, self.size - half :]
        top = (even + 1j * odd) / 2**0.5
        return np.concatenate(
            [top, vectors[:, half : self.size - half], top[:, ::-1].conj()], axis=1
        )

    def noise_variance(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Variance of Re(left^H W right), (...), W being `data` of white noise of unit power.

        `left` is (..., size) and `right` (..., columns). The noise of an element is in several
        windows, conjugated in those read backwards: what it adds to all is summed, then squared.
        """
        n_halves, n_windows = 2 if self.backward else 1, len(self.points)
        columns = right.reshape(-1, n_halves, right.shape[-1] // (n_halves * n_windows), n_windows)
        per_point = np.sum(self.share**2, axis=1)
        rows = np.ascontiguousarray(left.reshape(-1, self.size))
        return _variances(rows, columns, self.points, per_point).reshape(left.shape[:-1])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _variances(
    left: np.ndarray, right: np.ndarray, points: np.ndarray, per_point: np.ndarray
) -> np.ndarray:
    """`Windows.noise_variance` of (m, size) and (m, halves, looks, windows), (m,)."""
    m, n_halves, n_looks, n_windows = right.shape
    size = left.shape[1]
    out = np.zeros(m)
    for i in range(m):
        for look in range(n_looks):
            weights = np.zeros(len(per_point), np.complex128)
            for window in range(n_windows):
                forward = right[i, 0, look, window]
                for e in range(size):
                    weights[points[window, e]] += forward * np.conj(left[i, e])
                if n_halves == 2:
                    backward = np.conj(right[i, 1, look, window])
                    for e in range(size):
                        weights[points[window, e]] += backward * left[i, size - 1 - e]
            for p in range(len(per_point)):
                out[i] += (weights[p].real ** 2 + weights[p].imag ** 2) * per_point[p] / 2
    return out


@lru_cache(maxsize=32)
def windows(aperture: Aperture, smoothing: Smoothing) -> Windows:
    """Windows over a uniform line or rectangle; the whole array alone where it is neither."""
    found = aperture.places
    if found is not None:
        n_left, n_up = found.place.max(axis=0) + 1
        point = found.place[:, 1] * n_left + found.place[:, 0]
        if len(np.unique(point)) == n_left * n_up:
            size = smoothing.side(n_up), smoothing.side(n_left)
            everyone = np.arange(aperture.n_elements)
            return Windows(_means(point, everyone, aperture), _slid((n_up, n_left), size))
    n = aperture.n_elements
    return Windows(np.eye(n), np.arange(n)[None], backward=False)


@lru_cache(maxsize=32)
def line_windows(aperture: Aperture, smoothing: Smoothing, who: str) -> tuple[Windows, int]:
    """Windows over the longest even part of a row or a column of elements, and its axis.

    The axis is 0 for a row, which tells the azimuth, 1 for a column, which tells the elevation.

    Raises
    ------
    InvalidSetting
        About `who`, where no three elements follow each other at even steps.
    """
    found = aperture.places
    runs = [] if found is None else list(_runs(found.place))
    axis, stride, members, point = max(
        runs, key=lambda run: run[3].max(), default=(0, 1, np.zeros(0, int), np.zeros(1, int))
    )
    n_points = int(point.max()) + 1
    if found is None or n_points < 3:
        raise InvalidSetting(
            f"{who}.kind",
            got=f"asked of {aperture.n_elements} virtual elements without a uniform line",
            need="three or more elements at even steps along left or up",
            fix="Take maximum-likelihood or iterative-adaptive, which any array will do for.",
        )
    points = _slid((1, n_points), (1, smoothing.side(n_points)))
    share = _means(point, members, aperture)
    return Windows(share, points, step=found.step[axis] * stride), axis


def fits(who: str, n_sources: object, windows: Windows, n_looks: int) -> None:
    """Raise `InvalidSetting`, about `who`, where windows cannot part so many sources."""
    most = windows.rank(n_looks)
    if isinstance(n_sources, int) and n_sources > most:
        raise InvalidSetting(
            f"{who}.n_sources",
            got=n_sources,
            need=f"at most {most}, for windows of {windows.size} elements in"
            f" {len(windows.points)} place{'s' * (len(windows.points) > 1)} and looks: {n_looks}",
            fix="Seek fewer, with smoothing.share near 2/3."
            if windows.backward
            else "The array is not uniform: take maximum-likelihood or iterative-adaptive.",
        )


def _runs(place: np.ndarray) -> Iterator[tuple[int, int, np.ndarray, np.ndarray]]:
    """Even parts of rows and columns: axis, step, elements and their points from 0 on.

    `place` (n_elements, 2) are whole steps; elements at one place share a point.
    """
    for axis in (0, 1):
        for row in np.unique(place[:, 1 - axis]):
            members = np.flatnonzero(place[:, 1 - axis] == row)
            along = place[members, axis]
            taken = np.unique(along)
            step = int(np.diff(taken).min(initial=along.max() + 1))
            for run in np.split(taken, np.flatnonzero(np.diff(taken) > step) + 1):
                inside = np.isin(along, run)
                yield axis, step, members[inside], (along[inside] - run[0]) // step


def _means(point: np.ndarray, members: np.ndarray, aperture: Aperture) -> np.ndarray:
    """What each element adds to the mean at its point, (n_points, n_elements)."""
    share = np.zeros((point.max() + 1, aperture.n_elements))
    share[point, members] = 1 / np.bincount(point)[point]
    return share


def _slid(shape: tuple[int, int], size: tuple[int, int]) -> np.ndarray:
    """Points of all windows of a size in a rectangle, (n_windows, points)."""
    points = np.arange(shape[0] * shape[1]).reshape(shape)
    slid = np.lib.stride_tricks.sliding_window_view(points, size)
    return slid.reshape(-1, size[0] * size[1])
