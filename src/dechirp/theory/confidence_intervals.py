"""Confidence intervals of probabilities, root mean squares, means and rates.

Each is (low, high), two-sided with equal tails: either end misses with probability
(1 - confidence) / 2. `confidence` is above 0 and below 1, `values` and `counts` are at least
two finite numbers, (n,); otherwise `InvalidSetting` is raised. The ends have the unit of the
values.
"""

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    SMALLEST_MAGNITUDE,
    check_finite_array,
    check_integer,
    check_number,
    check_probability,
)
from dechirp.core.elementwise import elementwise
from dechirp.core.errors import InvalidSetting

__all__ = ["binomial_interval", "mean_interval", "rate_interval", "rms_interval"]


@elementwise
def binomial_interval(hits: int, trials: int, *, confidence: float) -> tuple[float, float]:
    """Return the interval of a probability from the hits in independent trials.

    Low is the quantile (1 - c) / 2 of Beta(k, n - k + 1), high the quantile (1 + c) / 2 of
    Beta(k + 1, n - k); 0 without a hit and 1 without a miss. Never misses more often than
    stated, whatever the probability.

    Raises `InvalidSetting` unless there is a trial, and hits are 0 to the number of trials.

    Parameters
    ----------
    hits : array of int
        Trials k that succeeded, from 0 to the number of trials.
    trials : array of int
        Independent trials n, at least 1.
    confidence : array
        Probability that the interval contains the true value, between 0 and 1, both excluded.

    References
    ----------
    C. J. Clopper and E. S. Pearson, The use of confidence or fiducial limits, Biometrika 26,
    1934.
    """
    check_integer("trials", trials, at_least=1, at_most=2**63 - 1)
    check_integer("hits", hits, at_least=0, at_most=trials)
    tail, misses = _tail_probability(confidence), trials - hits
    low = (
        _find_probability_root(lambda p: float(scipy.special.betainc(hits, misses + 1, p)) - tail)
        if hits
        else 0.0
    )
    high = (
        _find_probability_root(lambda p: float(scipy.special.betaincc(hits + 1, misses, p)) - tail)
        if misses
        else 1.0
    )
    return low, high


@check_argument_types
def rms_interval(values: ArrayLike, *, confidence: float) -> tuple[float, float]:
    """Return the interval of a root mean square from independent normal errors of zero mean.

    The sum of squares over the variance is chi-square with n degrees of freedom (S. M. Kay,
    Fundamentals of Statistical Signal Processing II: Detection Theory, 1998, 2.2.2).

    Parameters
    ----------
    values : array (n,)
        Two or more independent errors, in any unit.
    confidence : float
        Probability that the interval contains the true value, between 0 and 1, both excluded.
    """
    errors, tail = _check_two_or_more_values("values", values), _tail_probability(confidence)
    half_sum = np.sum(errors**2) / 2
    low = np.sqrt(half_sum / scipy.special.gammainccinv(errors.size / 2, tail))
    high = np.sqrt(half_sum / scipy.special.gammaincinv(errors.size / 2, tail))
    return float(low), float(high)


@check_argument_types
def mean_interval(values: ArrayLike, *, confidence: float) -> tuple[float, float]:
    """Return the interval of a mean from independent values that are normal or numerous.

    Mean -+ t s / sqrt(n), with s^2 the sample variance and t Student's quantile for n - 1
    degrees of freedom (Student, The probable error of a mean, Biometrika 6, 1908).

    Parameters
    ----------
    values : array (n,)
        Two or more independent values, in any unit.
    confidence : float
        Probability that the interval contains the true value, between 0 and 1, both excluded.
    """
    sample = _check_two_or_more_values("values", values)
    return _student_mean_interval(sample, float(np.var(sample, ddof=1)), confidence)


@check_argument_types
def rate_interval(counts: ArrayLike, exposure: float, *, confidence: float) -> tuple[float, float]:
    """Return the interval of a rate from counts of events in independent blocks of equal exposure.

    Events may come in clusters, as alarms in neighbouring cells do, so the interval uses the
    scatter between blocks; Poisson scatter would halve it for alarms in groups of four. The ends
    are mean count -+ t s / sqrt(n), as in `mean_interval`, over the exposure, with s^2 no less
    than the mean count and low no less than 0. Without an event, high is the rate of
    single events at which none occurs with the probability of one tail.

    Accurate from 1,000 events or clusters: counts are skewed, and with fewer of them high is
    missed more often than stated. With single events in 200 blocks and a tail of 5e-6 it
    is missed by up to 2.7e-3 where 10 are expected, 4.9e-5 at 100, 8.0e-6 at 1,000 and 5.4e-6
    at 3,140; with a tail of 0.025 by 0.067, 0.037, 0.027 and 0.026. Low is missed less often.

    Parameters
    ----------
    counts : array (n,)
        Events in each block, none negative.
    exposure : float
        Exposure of each block, above 0: cells, seconds or another unit of the rate.
    confidence : float
        As for the others.
    """
    events = _check_two_or_more_values(
        "counts",
        counts,
        fix="count in two or more blocks of equal exposure: their scatter shows clusters of events",
    )
    if np.any(events < 0):
        raise InvalidSetting(
            "counts",
            value=events.min(),
            expected="0 or more",
            fix="give events counted in each block",
        )
    exposure_per_block = check_number("exposure", exposure, at_least=SMALLEST_MAGNITUDE)
    if not events.any():
        return 0.0, float(
            -np.log(_tail_probability(confidence)) / (events.size * exposure_per_block)
        )
    variance = max(float(np.var(events, ddof=1)), float(np.mean(events)))
    low, high = _student_mean_interval(events, variance, confidence)
    return max(low, 0.0) / exposure_per_block, high / exposure_per_block


def _student_mean_interval(
    sample: np.ndarray, variance: float, confidence: float
) -> tuple[float, float]:
    half_width = -scipy.special.stdtrit(sample.size - 1, _tail_probability(confidence)) * np.sqrt(
        variance / sample.size
    )
    centre = np.mean(sample)
    return float(centre - half_width), float(centre + half_width)


def _find_probability_root(excess: Callable[[float], float]) -> float:
    # SciPy's inverse betaincinv is inaccurate: 1.9e-6 instead of 0.94e-6 for 1,000 hits of 1e9.
    return float(scipy.optimize.brentq(excess, 0.0, 1.0, xtol=1e-300, maxiter=2000))


def _tail_probability(confidence: float) -> float:
    """Return the probability beyond each end."""
    check_probability("confidence", confidence)
    return (1 - confidence) / 2


def _check_two_or_more_values(
    setting: str,
    values: ArrayLike,
    *,
    fix: str = "take more measurements, and omit failed ones",
) -> np.ndarray:
    sample = check_finite_array(setting, values)
    if sample.ndim != 1 or sample.size < 2:
        raise InvalidSetting(
            setting,
            value=f"an array {sample.shape}",
            expected="two or more finite values in a row",
            fix=fix,
        )
    return sample
