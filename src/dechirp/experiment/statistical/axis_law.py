r"""One axis of a map about a tone: what it gives to cells, and how their noise hangs together.

All that a detection needs of the samples are sums :math:`\sum_n f_n y_n` with few weights f: of
each cell beside the tone that of the window, turned to the cell; and without a window, turned to
the tone, :math:`1`, :math:`p = n - (N - 1) / 2` and :math:`p^2`, from which the
maximum-likelihood frequency follows. White noise makes them jointly Gaussian, of the covariance of
their weights. Over two axes weights multiply, and so do covariances: so noise in all cells about
a tone, and in its estimates, is a few white numbers times the Cholesky factor of each axis.

References
----------
D. C. Rife and R. R. Boorstyn, Single-tone parameter estimation from discrete-time observations,
IEEE Trans. Information Theory 20(5), 1974, for the estimate.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dechirp.process.spectrum import Transform

SUMS = 3
"""Sums without a window: of 1, p and p^2."""
OFFSETS = 32
"""Places between a cell and the next for which there is a covariance."""
FINE = 32
"""Points of a lobe to each bin of the transform, and of its moments to each unpadded bin."""
NEAR = 1.5
"""Unpadded bins within which refinement parts no tones, see `process.refine`."""
_RING_FINE = 8
# Unpadded bins beyond which a lobe has nothing: a rectangular window leaves 2 % of its power.
_RING_REACH = 16
_JITTER = 1e-9  # a rectangular window on a bin is the tone itself: the covariance is singular


class AxisLaw(NamedTuple):
    """Tables of one axis; distances in bins of the transform, but for the moments."""

    half: int
    """Cells on each side of a tone's own that its peak may be in."""
    n_bins: int
    per_point: float
    """Unpadded bins in a bin."""
    loss: float
    """Noise bandwidth of the window, in unpadded bins."""
    spread: float
    """Root mean square of p: sqrt((N^2 - 1) / 12), 1 for one point."""
    lobe: np.ndarray
    """Amplitude in a cell of a tone so far away, 1 on the cell, complex; from -reach to reach."""
    reach: float
    moments: np.ndarray
    """(3, n): means of 1, p / i spread and (p / spread)^2 over a tone so far from where it is
    taken, from -NEAR to NEAR unpadded bins."""
    factors: np.ndarray
    """(OFFSETS + 1, SUMS + n_cells, the same), complex: Cholesky factors of the covariance of the
    sums without a window, of 1, p and p^2, and of the cells about, for offsets -1/2 to 1/2."""
    own: np.ndarray
    """(SUMS + n_cells,), complex: covariance of each with the middle cell, for a tone in it."""

    def energy(self, half: int) -> "Energy":
        """What of a tone's power lies in 2 half + 1 cells about one so far away."""
        away = np.arange(-_span(half, self), _span(half, self) + 1) / _RING_FINE
        cells = np.arange(-half, half + 1)
        return Energy(np.array([np.sum(self._power(one - cells)) for one in away]), away[-1])

    def _power(self, away: np.ndarray) -> np.ndarray:
        away = (away + self.n_bins / 2) % self.n_bins - self.n_bins / 2
        at = np.linspace(-self.reach, self.reach, self.lobe.size)
        return np.asarray(np.interp(abs(away), at, abs(self.lobe) ** 2, right=0.0))


class Energy(NamedTuple):
    """Sums of a lobe's power over cells, at steps of 1 / 8 bin from -reach to reach."""

    table: np.ndarray
    reach: float


def _span(half: int, axis: AxisLaw) -> int:
    far = min(half + _RING_REACH / axis.per_point, axis.n_bins / 2)
    return int(far * _RING_FINE)


@lru_cache(maxsize=32)
def axis_law(transform: Transform) -> AxisLaw:
    """Tables of a transform."""
    n, n_bins, weights = transform.n_points, transform.n_bins, transform.weights
    half = min(-(-n_bins // n), (n_bins - 1) // 2)
    p = np.arange(n) - (n - 1) / 2
    spread = np.sqrt((n**2 - 1) / 12) if n > 1 else 1.0
    reach = min(_RING_REACH * n_bins / n, n_bins / 2)
    away = np.linspace(-reach, reach, 2 * int(np.ceil(reach * FINE)) + 1)
    lobe = np.exp(2j * np.pi / n_bins * np.outer(away, p)) @ weights / weights.sum()
    near = np.linspace(-NEAR, NEAR, 2 * int(NEAR * FINE) + 1)
    turns = 2 * np.pi / n * np.outer(near, p)
    moments = [np.cos(turns), p / spread * np.sin(turns), (p / spread) ** 2 * np.cos(turns)]
    cells = np.arange(-half, half + 1)
    of_cells = weights * np.exp(-2j * np.pi / n_bins * np.outer(cells, p))
    of_cells /= np.sqrt(np.sum(weights**2))
    factors = []
    for offset in np.linspace(-0.5, 0.5, OFFSETS + 1):
        sums = _weights_of(offset, p, spread, n_bins, of_cells)
        gram = sums @ sums.conj().T
        factors.append(np.linalg.cholesky(gram + _JITTER * np.eye(len(gram))))
    in_middle = _weights_of(0.0, p, spread, n_bins, of_cells)
    return AxisLaw(
        half=half,
        n_bins=n_bins,
        per_point=n / n_bins,
        loss=transform.noise_bandwidth_bins,
        spread=float(spread),
        lobe=lobe,
        reach=float(reach),
        moments=np.mean(moments, axis=2),
        factors=np.array(factors),
        own=in_middle @ of_cells[half].conj(),
    )


def _weights_of(
    offset: float, p: np.ndarray, spread: float, n_bins: int, of_cells: np.ndarray
) -> np.ndarray:
    tone = np.exp(-2j * np.pi / n_bins * offset * p) / np.sqrt(p.size)
    return np.array([tone, p / spread * tone, (p / spread) ** 2 * tone, *of_cells])


def worn(weights: np.ndarray, spread_bins: np.ndarray) -> np.ndarray:
    """Amplitude left of a tone whose frequency drifts so many bins over all points, any shape."""
    turns = (np.arange(weights.size) - (weights.size - 1) / 2) / weights.size
    most = 64.0
    drifts = most * np.linspace(0, 1, 257) ** 2
    left = abs(np.exp(1j * np.pi * np.outer(drifts, turns**2)) @ weights) / weights.sum()
    drift = abs(np.asarray(spread_bins))
    beyond = np.sqrt(most / np.maximum(drift, most))
    return np.interp(drift, drifts, left) * beyond


def walked(over_velocity: np.ndarray, over_range: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Amplitude left in its cell of a target that walks so many cells in a frame, any shape."""
    slow, fast = (
        (np.arange(one.size) - (one.size - 1) / 2) / one.size for one in (over_velocity, over_range)
    )
    most = 64.0
    ways = most * np.linspace(0, 1, 129) ** 2
    weight = over_velocity / over_velocity.sum(), over_range / over_range.sum()
    left = [
        abs(weight[0] @ np.exp(2j * np.pi * way * np.outer(slow, fast)) @ weight[1]) for way in ways
    ]
    way = abs(np.asarray(cells))
    return np.interp(way, ways, left) * most / np.maximum(way, most)
