"""False-alarm law of an ordered statistic whose cells are sums of several noise powers.

Each cell is a gamma variate of shape K. The k-th smallest of N has the density

    N! / ((k - 1)! (N - k)!) P(K, s)^(k - 1) Q(K, s)^(N - k) s^(K - 1) exp(-s) / Gamma(K)

with P and Q the lower and upper incomplete gamma functions, regularised, and the cell under
test exceeds factor times it with probability Q(K, factor s). Their product over ln s has a
single peak and decays at both ends, so equal steps are as accurate as any quadrature.
For K = 1 this is Rohling's product.

References
----------
H. Rohling, Radar CFAR thresholding in clutter and multiple target situations, IEEE Trans.
AES 19(4), 1983. H. A. David and H. N. Nagaraja, Order Statistics, 3rd ed., 2003.
"""

import math

import numpy as np
import scipy

from dechirp.core.checks import check_integer
from dechirp.core.values import frozen_dataclass
from dechirp.theory.training_cells import likely_event_counts

_LOG_CUTOFF = -45.0  # omits 3e-20 of the peak at each end
_N_STEPS = 400


@frozen_dataclass
class OrderedStatisticLaw:
    """Law of the k-th smallest of N cells, each the sum of K noise powers."""

    n_training: int
    rank: int
    n_summed: int

    def __post_init__(self) -> None:
        check_integer("n_training", self.n_training, at_least=1)
        check_integer("rank", self.rank, at_least=1, at_most=self.n_training)
        check_integer("n_summed", self.n_summed, at_least=1)

    def log_false_alarm_probability(self, factor: float) -> float:
        """Return ln of the probability that noise exceeds factor times the statistic."""
        first, last = -60.0, math.log(self.n_summed + 1000.0)
        while True:  # the peak may be a thousand times narrower than the search range
            log_s = np.linspace(first, last, 65)
            height = self._log_density_times_exceedance(log_s, factor)
            high = np.flatnonzero(height > height.max() + _LOG_CUTOFF)
            bounds = log_s[max(high[0] - 1, 0)], log_s[min(high[-1] + 1, 64)]
            if bounds[1] - bounds[0] > 0.5 * (last - first):
                break
            first, last = bounds
        log_s, step = np.linspace(*bounds, _N_STEPS, retstep=True)
        return float(
            scipy.special.logsumexp(self._log_density_times_exceedance(log_s, factor))
            + math.log(step)
        )

    def _log_density_times_exceedance(self, log_s: np.ndarray, factor: float) -> np.ndarray:
        """Return the logarithm of density times exceedance probability, over ln s."""
        n, k, shape = self.n_training, self.rank, self.n_summed
        choose = (
            scipy.special.gammaln(n + 1)
            - scipy.special.gammaln(k)
            - scipy.special.gammaln(n - k + 1)
        )
        s = np.exp(log_s)
        below = scipy.special.gammainc(shape, s)
        with np.errstate(divide="ignore"):
            # May be as small as s^K / K!, which underflows.
            log_below = np.where(
                below > 1e-280, np.log(below), shape * log_s - s - scipy.special.gammaln(shape + 1)
            )
        density = shape * log_s - s - scipy.special.gammaln(shape)
        log_beyond, exceeds = (
            self._log_noise_exceedance_probability(s),
            self._log_noise_exceedance_probability(factor * s),
        )
        return choose + (k - 1) * log_below + (n - k) * log_beyond + density + exceeds

    def _log_noise_exceedance_probability(self, threshold: np.ndarray) -> np.ndarray:
        """Return ln of Q(K, x) = exp(-x) sum_{j<K} x^j / j!."""
        tail = scipy.special.gammaincc(self.n_summed, threshold)
        is_tiny = tail < 1e-280
        with np.errstate(divide="ignore"):
            log_tail = np.asarray(np.log(tail))
        if is_tiny.any():
            j, tiny = likely_event_counts(self.n_summed), threshold[is_tiny]
            log_tail[is_tiny] = (
                scipy.special.logsumexp(
                    np.log(tiny)[:, None] * j - scipy.special.gammaln(j + 1), axis=1
                )
                - tiny
            )
        return log_tail
