"""Iterative adaptive approach: a sharp spectrum from a single snapshot, for any array."""

import numpy as np

from dechirp.core.checks import count
from dechirp.core.values import value
from dechirp.process.angle import differences, likelihood
from dechirp.process.angle.aperture import Aperture
from dechirp.process.angle.bartlett import beam_power
from dechirp.process.angle.base import Angles, SpectralEstimator

# Steering vectors times powers, for several snapshots at once: 64 MiB.
_MOST_NUMBERS = 2**22


@value
class IterativeAdaptive(SpectralEstimator):
    r"""IAA-APES: each direction's power with the others held down, as last estimated.

    .. math:: R = \sum_k P_k a_k a_k^\mathsf{H} + \sigma^2 I, \quad
        P_k = \left| \frac{a_k^\mathsf{H} R^{-1} x}{a_k^\mathsf{H} R^{-1} a_k} \right|^2

    in turn, beginning with Bartlett's powers. One look is enough, sources may be coherent and
    elements anywhere; sidelobes are far below those of beams. Powers are those of a grid, which
    draws peaks towards its points, so the peaks are refined by likelihood, as the paper does
    by RELAX. On two axes the grid has four points to a beam, and a source between them is several
    coherent ones to it. Two arms do not tell which of their azimuths goes with which elevation:
    on an L of six and five elements at 20 dB, 1 in 200 sources is put on such a ghost. There
    take maximum-likelihood.

    On an even grid of elements an iteration takes as many products for each direction as there
    are differences of places, 2 N - 1 on a line, and elsewhere N^2; and an inverse.

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
        steering, everyone = aperture.grid.steering.astype(complex), _everyone(aperture)
        towards = differences.over_grid(aperture, everyone)
        of_pair = differences.differences(aperture, everyone).of_pair
        columns = np.swapaxes(snapshots, 1, 2)
        power = beam_power(snapshots, steering).astype(float)
        unit = np.eye(snapshots.shape[2])
        # Of snapshots without noise, rounding is the noise: a covariance has an inverse then.
        energy = np.mean(np.abs(snapshots) ** 2, axis=(1, 2))
        floor = np.maximum(noise_power, 1e-12 * energy + 1e-300)
        for _ in range(self.n_iterations):
            if towards is None:
                covariance = steering.T @ (power[:, :, None] * steering.conj())
            else:
                covariance = (power @ towards)[:, of_pair]
            covariance += floor[:, None, None] * unit
            inverse = np.linalg.inv(covariance)
            kept = np.concatenate([inverse, inverse @ columns], axis=2)
            power = self.over_grid(kept, aperture)
        return kept

    def over_grid(self, prepared: np.ndarray, aperture: Aperture) -> np.ndarray:
        """Power at all directions of the grid, by differences of places where they are even."""
        steering, everyone = aperture.grid.steering.astype(complex), _everyone(aperture)
        towards = differences.over_grid(aperture, everyone)
        if towards is None:
            return self.at(prepared, steering)
        n_elements = aperture.n_elements
        passed = steering.conj() @ prepared[..., n_elements:]
        inverse = differences.differences(aperture, everyone).sums(prepared[..., :n_elements])
        return _mean_power(passed, differences.powers(inverse, towards))

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


def _everyone(aperture: Aperture) -> tuple[int, ...]:
    return tuple(range(aperture.n_elements))


def _mean_power(passed: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Of amplitudes (n, m, n_looks) over their gains (n, m): the mean over the looks."""
    return np.asarray(np.mean(np.abs(passed / gain[..., None]) ** 2, axis=-1))
