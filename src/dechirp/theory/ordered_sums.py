"""False-alarm law of an ordered statistic whose cells are sums of several noise powers.

Each cell is a gamma variate of shape K. The k-th smallest of N has the density

    N! / ((k - 1)! (N - k)!) P(K, s)^(k - 1) Q(K, s)^(N - k) s^(K - 1) exp(-s) / Gamma(K)

with P and Q the lower and upper incomplete gamma functions, regularised, and the cell under
test exceeds factor times it with probability Q(K, factor s). Their product over ln s is a
single hump that falls off at both ends, for which equal steps are as good as any quadrature.
For K = 1 this is Rohling's product.

References
----------
H. Rohling, Radar CFAR thresholding in clutter and multiple target situations, IEEE Trans.
AES 19(4), 1983. H. A. David and H. N. Nagaraja, Order Statistics, 3rd ed., 2003.
"""

import math

import numpy as np
from scipy.special import gammainc, gammaln, logsumexp

from dechirp.core.checks import whole
from dechirp.core.values import value

_LOG_LEAST = -45.0  # 3e-20 of the hump is left out at each end
_N_STEPS = 400


@value
class OrderedSums:
    """The k-th smallest of N cells, each the sum of K noise powers."""

    n_training: int
    rank: int
    n_summed: int

    def __post_init__(self) -> None:
        whole("n_training", self.n_training, at_least=1)
        whole("rank", self.rank, at_least=1, at_most=self.n_training)
        whole("n_summed", self.n_summed, at_least=1)

    def log_probability(self, factor: float) -> float:
        """Natural logarithm of the probability that noise exceeds factor times the statistic."""
        first, last = -60.0, math.log(self.n_summed + 1000.0)
        while True:  # the hump may be a thousand times narrower than where it may lie
            log_s = np.linspace(first, last, 65)
            height = self._log_share(log_s, factor)
            high = np.flatnonzero(height > height.max() + _LOG_LEAST)
            now = log_s[max(high[0] - 1, 0)], log_s[min(high[-1] + 1, 64)]
            if now[1] - now[0] > 0.5 * (last - first):
                break
            first, last = now
        log_s, step = np.linspace(*now, _N_STEPS, retstep=True)
        return float(logsumexp(self._log_share(log_s, factor)) + math.log(step))

    def _log_share(self, log_s: np.ndarray, factor: float) -> np.ndarray:
        """Logarithm of density times exceedance, over ln s."""
        n, k, shape = self.n_training, self.rank, self.n_summed
        choose = gammaln(n + 1) - gammaln(k) - gammaln(n - k + 1)
        s = np.exp(log_s)
        below = gammainc(shape, s)
        with np.errstate(divide="ignore"):
            # As small as s^K / K!, of which no float may be left.
            log_below = np.where(below > 1e-280, np.log(below), shape * log_s - gammaln(shape + 1))
        density = shape * log_s - s - gammaln(shape)
        log_beyond, exceeds = self._log_beyond(s), self._log_beyond(factor * s)
        return choose + (k - 1) * log_below + (n - k) * log_beyond + density + exceeds

    def _log_beyond(self, x: np.ndarray) -> np.ndarray:
        """Ln of Q(K, x) = exp(-x) sum_{j<K} x^j / j!."""
        j = np.arange(self.n_summed)
        return np.asarray(logsumexp(np.log(x)[:, None] * j - gammaln(j + 1), axis=1) - x)
