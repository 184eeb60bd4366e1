r"""Mean of logarithms (LOG/CFAR): robust against other targets among the training cells.

The noise level is the geometric mean of N training cells z_i, the exponential of the mean of
their logarithms. One cell at S times the noise raises it S^(1/N) times: 30 dB in one of 100 cells
raise it by 0.3 dB, and their plain mean by 10.4 dB. In noise alone 1.65 N - 0.65 cells have the
detection performance of N in a plain mean.

In independent cells, of K powers each, the false-alarm probability of a factor a over it is

.. math:: \frac{1}{2\pi i} \int_{c - i\infty}^{c + i\infty}
    \frac{\Gamma(K + s)}{s\,\Gamma(K)}
    \left[\frac{\Gamma(K - s/N)}{\Gamma(K)}\right]^N a^{-s}\, ds, \qquad 0 < c < KN:

the inverse Mellin transform of the probability that a gamma variate exceeds a, times the moments
of order -s of the geometric mean.

References
----------
V. G. Hansen and H. R. Ward, Detection performance of the cell averaging LOG/CFAR receiver, IEEE
Trans. AES 8(5), 1972 (the number of cells).
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import loggamma

from dechirp.extensions import (
    NoiseEstimator,
    TrainingWindow,
    frozen_dataclass,
    scaled_window_means,
)

_LEAST = np.finfo(np.float32).tiny  # keeps the logarithm of cells without power finite


@frozen_dataclass
class LogMean(NoiseEstimator):
    """Geometric mean of the training cells."""

    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Exponential of the mean logarithm of the cells."""
        return np.exp(np.log(np.maximum(cells, _LEAST)).mean(axis=-1))

    def threshold(
        self, power: np.ndarray, window: TrainingWindow, factors: np.ndarray
    ) -> np.ndarray:
        """Compute thresholds of a map; logarithms are computed once, not once per window."""
        logs = np.log(np.maximum(power, _LEAST))
        return (
            np.exp(
                scaled_window_means(logs, np.ones_like(factors), *window.training_and_guard_counts)
            )
            * factors
        )

    def independent_cells_threshold_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float:
        """Find the root of the false-alarm law above."""
        log_target = np.log(false_alarm_probability)

        def excess(log_factor: float) -> float:
            return _log_probability(np.exp(log_factor), len(offsets), n_channels) - log_target

        return float(np.exp(brentq(excess, -30, 100)))


def _log_probability(factor: float, n: int, k: int) -> float:
    """Logarithm of the law, integrated through the saddle point to avoid cancellation."""

    def log_law(s: np.ndarray) -> np.ndarray:
        cell_terms = n * (loggamma(k - s / n) - loggamma(k))
        return loggamma(k + s) - np.log(s) - loggamma(k) + cell_terms - s * np.log(factor)

    real = np.linspace(0, n * k, 4000)[1:-1]
    saddle = real[np.argmin(log_law(real))]
    imaginary, step = np.linspace(0, 12 + 8 * np.sqrt(saddle), 2000, retstep=True)
    log_values = log_law(saddle + 1j * imaginary)
    ratios = np.exp(log_values - log_values[0].real).real
    return float(log_values[0].real + np.log(step / np.pi * (ratios.sum() - ratios[0] / 2)))
