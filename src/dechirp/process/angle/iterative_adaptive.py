"""Iterative adaptive approach: a sharp spectrum from a single snapshot, for any array."""

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np

from dechirp.core.checks import count
from dechirp.core.values import value
from dechirp.process.angle import likelihood
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.bartlett import beam_power
from dechirp.process.angle.base import Angles, SpectralEstimator

# Steering vectors times powers, for several snapshots at once: 64 MiB.
_MOST_NUMBERS = 2**22


class Differences(NamedTuple):
    """Ways from element to element; pairs that share one see the same phases between them."""

    of_pair: np.ndarray
    """(n_elements, n_elements): which one it is."""
    towards: np.ndarray
    """(n_directions, n_differences) complex: a_i conj(a_j) of a pair, over the grid."""

    def covariance(self, power: np.ndarray) -> np.ndarray:
        """Sum of P_k a_k a_k^H over the grid, (n, N, N), of powers (n, n_directions)."""
        return np.asarray((power @ self.towards)[:, self.of_pair])

    def gain(self, inverse: np.ndarray) -> np.ndarray:
        """a_k^H R^-1 a_k over the grid, (n, n_directions), of inverses (n, N, N)."""
        sums = _summed(inverse, self.of_pair, self.towards.shape[1])
        return np.asarray(sums.real @ self.towards.real.T + sums.imag @ self.towards.imag.T)


@lru_cache(maxsize=4)
def differences(aperture: Aperture) -> Differences | None:
    """Those of elements on an even grid, where they are few."""
    if aperture.places is None:
        return None
    place = aperture.places.place
    ways = (place[:, None] - place).reshape(-1, 2)
    _, one, of_pair = np.unique(ways, axis=0, return_index=True, return_inverse=True)
    if len(one) * len(aperture.grid.steering) > _MOST_NUMBERS:
        return None
    steering = aperture.grid.steering.astype(complex)
    to, away = np.divmod(one, len(place))
    towards = steering[:, to] * steering[:, away].conj()
    return Differences(of_pair.reshape(len(place), -1), towards)


@value
class IterativeAdaptive(SpectralEstimator):
    r"""IAA-APES: each direction's power with the others held down, as last estimated.

    .. math:: R = \sum_k P_k a_k a_k^\mathsf{H} + \sigma^2 I, \quad
        P_k = \left| \frac{a_k^\mathsf{H} R^{-1} x}{a_k^\mathsf{H} R^{-1} a_k} \right|^2

    in turn, beginning with Bartlett's powers. One look is enough, sources may be coherent and
    elements anywhere; sidelobes are far below those of beams. Powers are those of a grid, which
    draws peaks towards its points, so the peaks are refined by likelihood, as the paper does
    by RELAX. On an even grid of elements an iteration takes as many products for each direction
    as there are differences of places, 2 N - 1 on a line, and elsewhere N^2; and an inverse.

    References
    ----------
    T. Yardibi, J. Li, P. Stoica, M. Xue and A. B. Baggeroer, Source localization and sensing: a
    nonparametric iterative adaptive approach based on weighted least squares, IEEE Trans.
    AES 46(1), 2010.
    """

    n_iterations: int = 10
    """Rounds; the paper finds no change beyond 15."""

    def __post_init__(self) -> None:
        super().__post_init__()
        count(self, "n_iterations", at_most=1000)

    def prepared(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        """Inverse covariances and what they make of the looks, (n, N, N + n_looks)."""
        n, n_looks, n_elements = snapshots.shape
        out = np.empty((n, n_elements, n_elements + n_looks), complex)
        at_once = max(1, _MOST_NUMBERS // aperture.grid.steering.size)
        for start in range(0, n, at_once):
            block = slice(start, start + at_once)
            out[block] = self._iterated(snapshots[block], aperture, noise_power[block])
        return out

    def _iterated(
        self, snapshots: np.ndarray, aperture: Aperture, noise_power: np.ndarray
    ) -> np.ndarray:
        steering, between = aperture.grid.steering.astype(complex), differences(aperture)
        columns = np.swapaxes(snapshots, 1, 2)
        power = beam_power(snapshots, steering).astype(float)
        unit = np.eye(snapshots.shape[2])
        # Of snapshots without noise, rounding is the noise: a covariance has an inverse then.
        energy = np.mean(np.abs(snapshots) ** 2, axis=(1, 2))
        floor = np.maximum(noise_power, 1e-12 * energy + 1e-300)
        for _ in range(self.n_iterations):
            if between is None:
                covariance = steering.T @ (power[:, :, None] * steering.conj())
            else:
                covariance = between.covariance(power)
            covariance += floor[:, None, None] * unit
            inverse = np.linalg.inv(covariance)
            kept = np.concatenate([inverse, inverse @ columns], axis=2)
            power = self.over_grid(kept, aperture)
        return kept

    def over_grid(self, prepared: np.ndarray, aperture: Aperture) -> np.ndarray:
        """Power at all directions of the grid, by differences of places where they are even."""
        steering, between = aperture.grid.steering.astype(complex), differences(aperture)
        if between is None:
            return self.at(prepared, steering)
        n_elements = aperture.n_elements
        passed = steering.conj() @ prepared[..., n_elements:]
        return _mean_power(passed, between.gain(prepared[..., :n_elements]))

    def at(self, prepared: np.ndarray, steering: np.ndarray) -> np.ndarray:
        """Power of each direction, with the others held down."""
        n_elements = prepared.shape[1]
        answered = steering.conj() @ prepared
        gain = np.einsum("...mi,...mi->...m", answered[..., :n_elements], steering).real
        return _mean_power(answered[..., n_elements:], gain)

    def refined(
        self, snapshots: np.ndarray, prepared: np.ndarray, aperture: Aperture, coarse: Angles
    ) -> Angles:
        """The most likely directions near the peaks, together."""
        return likelihood.maximised(snapshots, aperture, *coarse)


def _mean_power(passed: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Of amplitudes (n, m, n_looks) over their gains (n, m): the mean over the looks."""
    return np.asarray(np.mean(np.abs(passed / gain[..., None]) ** 2, axis=-1))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _summed(inverse: np.ndarray, of_pair: np.ndarray, n_differences: int) -> np.ndarray:
    """Sums of (n, N, N) over the pairs of each difference, (n, n_differences)."""
    n, n_elements, _ = inverse.shape
    out = np.zeros((n, n_differences), np.complex128)
    for i in range(n):
        for row in range(n_elements):
            for column in range(n_elements):
                out[i, of_pair[row, column]] += inverse[i, row, column]
    return out
