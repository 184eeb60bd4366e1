"""Intervals that hold an unknown value with a stated confidence, from what was measured.

Each is (low, high), two-sided with equal tails: either end is missed with probability
(1 - confidence) / 2. `confidence` is above 0 and below 1, `values` and `counts` are at least
two finite numbers, (n,); `InvalidSetting` is raised where one is not so. The ends have the unit
of the values.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import betainc, betaincc, gammainccinv, gammaincinv, stdtrit

from dechirp.core.checks import number, probability, whole
from dechirp.core.errors import InvalidSetting


def binomial(hits: int, trials: int, *, confidence: float) -> tuple[float, float]:
    """Interval of a probability, from the hits in independent trials.

    Low is the quantile (1 - c) / 2 of Beta(k, n - k + 1), high the quantile (1 + c) / 2 of
    Beta(k + 1, n - k); 0 without a hit and 1 without a miss. Never misses more often than
    stated, whatever the probability.

    Raises `InvalidSetting` unless there is a trial, and hits are 0 to the number of trials.

    References
    ----------
    C. J. Clopper and E. S. Pearson, The use of confidence or fiducial limits, Biometrika 26,
    1934.
    """
    whole("trials", trials, at_least=1, at_most=2**63 - 1)
    whole("hits", hits, at_least=0, at_most=trials)
    tail, misses = _tail(confidence), trials - hits
    low = _root(lambda p: float(betainc(hits, misses + 1, p)) - tail) if hits else 0.0
    high = _root(lambda p: float(betaincc(hits + 1, misses, p)) - tail) if misses else 1.0
    return low, high


def rms(values: ArrayLike, *, confidence: float) -> tuple[float, float]:
    """Interval of a root mean square, from independent normal errors of mean zero.

    The sum of squares over the variance is chi-square with n degrees of freedom (S. M. Kay,
    Fundamentals of Statistical Signal Processing II: Detection Theory, 1998, 2.2.2).
    """
    errors, tail = _sample(values), _tail(confidence)
    half_sum = np.sum(errors**2) / 2
    low = np.sqrt(half_sum / gammainccinv(errors.size / 2, tail))
    high = np.sqrt(half_sum / gammaincinv(errors.size / 2, tail))
    return float(low), float(high)


def mean(values: ArrayLike, *, confidence: float) -> tuple[float, float]:
    """Interval of a mean, from independent values that are normal, or many.

    Mean -+ t s / sqrt(n), with s^2 the sample variance and t Student's quantile for n - 1
    degrees of freedom (Student, The probable error of a mean, Biometrika 6, 1908).
    """
    sample = _sample(values)
    return _student(sample, float(np.var(sample, ddof=1)), confidence)


def rate(counts: ArrayLike, exposure: float, *, confidence: float) -> tuple[float, float]:
    """Interval of a rate, from counts of events in independent blocks of equal exposure.

    Events may come in clusters, as alarms in neighbouring cells do: the scatter between the
    blocks is used, not that of Poisson, by which alarms in fours would have an interval half
    as wide as it must be. Mean count -+ t s / sqrt(n) as `mean`, over the exposure, with s^2
    no less than the mean count and low no less than 0. Without an event, high is the rate of
    single events at which none is seen with the chance of one tail.

    Good from 1,000 events, or clusters, in all: counts are skew, and with fewer of them high
    is missed more often than stated. With single events in 200 blocks and a tail of 5e-6 it
    is missed by up to 2.7e-3 where 10 are expected, 4.9e-5 at 100, 8.0e-6 at 1,000 and 5.4e-6
    at 3,140; with a tail of 0.025 by 0.067, 0.037, 0.027 and 0.026. Low is missed less often.

    Parameters
    ----------
    counts : array (n,)
        Events in each block, none negative.
    exposure : float
        Of each block, above 0: cells, seconds or whatever the rate is per.
    confidence : float
        As for the others.
    """
    events = _sample(counts)
    if np.any(events < 0):
        raise InvalidSetting(
            "counts", got=events.min(), need="0 or more", fix="Give events counted in each block."
        )
    per = number("exposure", exposure, above=0)
    if not events.any():
        return 0.0, float(-np.log(_tail(confidence)) / (events.size * per))
    variance = max(float(np.var(events, ddof=1)), float(np.mean(events)))
    low, high = _student(events, variance, confidence)
    return max(low, 0.0) / per, high / per


def _student(sample: np.ndarray, variance: float, confidence: float) -> tuple[float, float]:
    reach = -stdtrit(sample.size - 1, _tail(confidence)) * np.sqrt(variance / sample.size)
    middle = np.mean(sample)
    return float(middle - reach), float(middle + reach)


def _root(excess: Callable[[float], float]) -> float:
    # Not by SciPy's inverse, betaincinv: 1,000 hits in 1e9 trials give it 1.9e-6 for 0.94e-6.
    return float(brentq(excess, 0.0, 1.0, xtol=1e-300, maxiter=2000))


def _tail(confidence: float) -> float:
    """Probability beyond each end."""
    probability("confidence", confidence)
    return (1 - confidence) / 2


def _sample(values: ArrayLike) -> np.ndarray:
    sample = np.asarray(values, dtype=float)
    if sample.ndim != 1 or sample.size < 2 or not np.all(np.isfinite(sample)):
        raise InvalidSetting(
            "values",
            got=f"an array {sample.shape}, {np.count_nonzero(~np.isfinite(sample))} not finite",
            need="two or more finite values in a row",
            fix="Measure more often, and leave out what failed.",
        )
    return sample
