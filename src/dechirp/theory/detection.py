"""Detection in known noise by a square-law detector, in one look or noncoherently integrated.

`snr` is A^2 / E|w|^2 in the cell under test, after integration: the power of the target
over the mean power of complex noise, a ratio and never dB. Each of the K powers, `n_summed`,
of pulses or of receivers, that are summed noncoherently has this ratio; a target that
fluctuates has it on average. `swerling` is 0 for a steady target, 1 to 4 for Swerling's cases; see
`theory.swerling`.

The sum of K powers, over the mean noise power of one, exceeds T with the probability

    Pd = sum_j w(j) Q(K + j, T),   Q the upper incomplete gamma function, regularised,

where w(j) is the probability that the target contributes j events: Poisson of mean K snr for a
steady target, negative binomial for one that fluctuates. The noise is known here; for
estimated noise see `theory.cfar_detection`.

References
----------
J. I. Marcum, A statistical theory of target detection by pulsed radar, 1947 (IRE Trans.
IT-6, 1960). P. Swerling, Probability of detection for fluctuating targets, 1954 (IRE Trans.
IT-6, 1960). D. A. Shnidman, Expanded Swerling target models, IEEE Trans. AES 39(3), 2003.
M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed., 2014.
"""

import math
from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    broadcast_arguments,
    check_detection_probability,
    check_false_alarm_probability,
    check_integer,
    check_non_negative_ratios,
    check_number,
    check_probabilities,
    check_whole_numbers,
)
from dechirp.core.elementwise import elementwise
from dechirp.theory.swerling import (
    probability_count_at_least,
    probability_count_below,
    swerling_shape,
)

__all__ = [
    "coherent_detection_probability",
    "coherent_required_snr",
    "detection_probability",
    "detection_threshold",
    "exceedance_probability",
    "required_snr",
]


@elementwise
def detection_threshold(false_alarm_probability: float, *, n_summed: int = 1) -> float:
    """Return the threshold of the sum of powers, relative to the mean noise power of one.

    -ln Pfa for one power: that of noise is exponential. The sum of K, `n_summed`, is a gamma
    variate of shape K. Raises `InvalidSetting` unless the false-alarm probability is from
    1e-300 to 1 - 1e-9 and K a whole number from 1.

    Parameters
    ----------
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_summed : array of int
        Powers K of pulses or receivers that are summed, at least 1.
    """
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    check_integer("n_summed", n_summed, at_least=1)
    if n_summed == 1:
        # Without SciPy's special functions, whose import takes 0.1 s of CPU time.
        return -math.log(false_alarm_probability)
    return float(scipy.special.gammainccinv(n_summed, false_alarm_probability))


@elementwise
def exceedance_probability(
    snr: ArrayLike, threshold: float, *, n_summed: int = 1, swerling: int = 0
) -> np.ndarray:
    r"""Return the probability that the sum of powers of target and noise exceeds a threshold.

    .. math:: P = \sum_j w(j)\, Q(K + j, T)

    For a steady target this is Marcum's function, :math:`Q_K(\sqrt{2 K \chi}, \sqrt{2 T})`
    with chi the snr: the tail beyond 2 T of noncentral chi-square with 2 K degrees of freedom
    and noncentrality 2 K chi.

    Parameters
    ----------
    snr : array
        Mean ratio of each of the summed powers; any shape.
    threshold : array
        T, over the mean noise power of one.
    n_summed : array of int
        Powers that are summed, K: pulses, or receivers.
    swerling : array of int
        0 for a steady target. 1 and 2 fluctuate as a sum of many scatterers, 3 and 4 as one
        strong among many; 1 and 3 are constant over the sum, 2 and 4 independent from power
        to power.

    Returns
    -------
    array
        The shape to which all arguments broadcast. Relative error below 1e-12, however small the
        probability, and absolute below 1e-15 near 1: for K to 1e4, -30 to 40 dB, and thresholds
        that noise alone exceeds with 1e-12 to 0.5.

    Raises
    ------
    InvalidSetting
        If a ratio is negative or not finite, the threshold not one finite number
        above zero, K not a whole number from 1, or there is no such case of Swerling's.
    """
    chi = check_non_negative_ratios("snr", snr)
    law = _GammaMixture(threshold, n_summed, swerling)
    probabilities = [law.exceedance_probability(ratio) for ratio in chi.ravel()]
    return np.array(probabilities, dtype=float).reshape(chi.shape)


@elementwise
def detection_probability(
    snr: ArrayLike,
    false_alarm_probability: ArrayLike,
    *,
    n_summed: ArrayLike = 1,
    swerling: int = 0,
) -> np.ndarray:
    """Return the probability that a target exceeds the threshold of a false-alarm probability.

    `exceedance_probability` at that threshold, in the shape to which SNR, probability and number
    of summed powers broadcast. For
    one power, 0.9 at 1e-6 takes 13.18 dB of a steady target, 21.14 dB of Swerling's 1 and 2,
    and 17.30 dB of 3 and 4. Raises `InvalidSetting` as that does, and as `detection_threshold`
    does.

    Parameters
    ----------
    snr : array
        Mean power of the target over that of noise in each summed power, a ratio, 0 or more.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    n_summed : array of int
        Powers K of pulses or receivers that are summed, from 1 to 9e8.
    swerling : int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    chi, pfa, n_powers = broadcast_arguments(
        snr=check_non_negative_ratios("snr", snr),
        false_alarm_probability=check_probabilities(
            "false_alarm_probability", false_alarm_probability
        ),
        n_summed=check_whole_numbers("n_summed", n_summed, at_least=1, at_most=_MAX_SUMMED),
    )
    swerling_shape(swerling, 1)  # checks the case for empty arrays as well
    probability = np.empty(chi.shape)
    # One law for all ratios that share a threshold.
    for single_pfa, n in set(zip(pfa.flat, n_powers.flat, strict=True)):
        limit = detection_threshold(float(single_pfa), n_summed=int(n))
        cells = (pfa == single_pfa) & (n_powers == n)
        probability[cells] = exceedance_probability(
            chi[cells], limit, n_summed=int(n), swerling=swerling
        )
    return probability


@elementwise
def required_snr(
    detection_probability: ArrayLike,
    false_alarm_probability: ArrayLike,
    *,
    n_summed: ArrayLike = 1,
    swerling: int = 0,
) -> np.ndarray:
    """Return the mean SNR in each summed power that reaches a detection probability.

    The inverse of `detection_probability`, to a relative error of 1e-10, in the shape to which
    both probabilities and the number of summed powers, K, broadcast. Raises `InvalidSetting` unless
    1e-300 <= false-alarm probability < detection probability < 1, K is a whole number from 1 and
    `swerling` one of 0 to 4.

    Parameters
    ----------
    detection_probability : array
        Probability that the target is detected, above that of a false alarm and below 1.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300, below the detection probability.
    n_summed : array of int
        Powers K of pulses or receivers that are summed, from 1 to 9e8.
    swerling : int
        0 for a steady target, 1 to 4 for Swerling's cases.
    """
    pd, pfa, n_powers = broadcast_arguments(
        detection_probability=check_probabilities("detection_probability", detection_probability),
        false_alarm_probability=check_probabilities(
            "false_alarm_probability", false_alarm_probability
        ),
        n_summed=check_whole_numbers("n_summed", n_summed, at_least=1, at_most=_MAX_SUMMED),
    )
    swerling_shape(swerling, 1)  # checks the case for empty arrays as well
    snr = [
        _required_snr(float(single_pd), float(single_pfa), int(n), swerling)
        for single_pd, single_pfa, n in zip(pd.flat, pfa.flat, n_powers.flat, strict=True)
    ]
    return np.array(snr, float).reshape(pd.shape)


def _required_snr(
    detection_probability: float, false_alarm_probability: float, n_summed: int, swerling: int
) -> float:
    """Return `required_snr` of one pair of probabilities."""
    check_detection_probability(detection_probability, false_alarm_probability)
    limit = detection_threshold(false_alarm_probability, n_summed=n_summed)
    law = _GammaMixture(limit, n_summed, swerling)

    gain, miss = detection_probability - false_alarm_probability, 1 - detection_probability

    # The smaller of both keeps its digits, and has a slope in logarithms.
    def excess(log_snr: float) -> float:
        ratio = math.exp(log_snr)
        if gain < miss:
            return math.log(law.exceedance_added_by_target(ratio) + _TINY) - math.log(gain)
        return math.log(miss) - math.log(law.miss_probability(ratio) + _TINY)

    # From 1e-26 to 1e26: beyond the SNR of any two distinct probabilities.
    return math.exp(_find_root(excess, -60.0, 60.0, tolerance=1e-12))


def _find_root(
    function: Callable[[float], float], low: float, high: float, *, tolerance: float
) -> float:
    """Return the root of a continuous function in a bracket, by Ridders' method.

    C. J. F. Ridders, IEEE Trans. Circuits Syst. 26(11), 979-980, 1979. Every `dechirp run` solves
    one equation, and SciPy's solvers take 0.15 s of CPU time to import.
    """
    at_low, at_high = function(low), function(high)
    root = math.inf
    while True:
        middle, earlier = (low + high) / 2, root
        at_middle = function(middle)
        scale = math.sqrt(at_middle**2 - at_low * at_high)
        if scale == 0:
            return middle
        root = middle + (middle - low) * math.copysign(1, at_low - at_high) * at_middle / scale
        if abs(root - earlier) <= tolerance or high - low <= tolerance:
            return root
        at_root = function(root)
        if at_middle * at_root <= 0:
            (low, at_low), (high, at_high) = sorted([(middle, at_middle), (root, at_root)])
        elif at_low * at_root <= 0:
            high, at_high = root, at_root
        else:
            low, at_low = root, at_root


@elementwise
def coherent_detection_probability(snr: ArrayLike, false_alarm_probability: float) -> np.ndarray:
    r"""Return the detection probability of a coherent detector, with known target phase.

    .. math:: P_d = \tfrac12 \operatorname{erfc}(\operatorname{erfc}^{-1}(2 P_{fa}) - \sqrt\chi)

    An upper bound for detectors of one power: 0.6 dB less than the square law needs for 0.9 at
    1e-6. Arguments broadcast. Raises `InvalidSetting` if a ratio is
    negative or not finite, or as `detection_threshold` does.

    Parameters
    ----------
    snr : array
        Power of the target over the mean power of noise, a ratio, 0 or more.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300 to 1 - 1e-9.
    """
    chi = check_non_negative_ratios("snr", snr)
    check_false_alarm_probability("false_alarm_probability", false_alarm_probability)
    return np.asarray(
        scipy.special.erfc(scipy.special.erfcinv(2 * false_alarm_probability) - np.sqrt(chi)) / 2
    )


@elementwise
def coherent_required_snr(detection_probability: float, false_alarm_probability: float) -> float:
    """Return the SNR that a coherent detector needs: 12.60 dB for 0.9 at 1e-6.

    The inverse of `coherent_detection_probability`. Raises `InvalidSetting` unless
    1e-300 <= false-alarm probability < detection probability < 1.

    Parameters
    ----------
    detection_probability : array
        Probability that the target is detected, above that of a false alarm and below 1.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300, below the detection probability.
    """
    check_detection_probability(detection_probability, false_alarm_probability)
    amplitude = scipy.special.erfcinv(2 * false_alarm_probability) - scipy.special.erfcinv(
        2 * detection_probability
    )
    return float(amplitude**2)


_TINY = 5e-324  # keeps the logarithm of a probability that underflows


# Its mixture has 52 terms for each unit of the square root: a second at most.
_MAX_THRESHOLD = 1e9
# Its threshold is below that: 9.011e8 at 1e-300, the smallest false-alarm probability.
_MAX_SUMMED = 9 * 10**8


class _GammaMixture:
    """Mixture of gamma laws, summed by parts so that all terms are positive and few suffice.

    Q(K + j, T) grows with j by p(K + j), the Poisson probabilities of mean T. So

        Pd = Q(K, T) + sum_i p(K + i) P(j > i),   1 - Pd = sum_i p(K + i) P(j <= i),

    The terms end where p does, whatever the ratio: twelve standard
    deviations beyond T, 90 terms for one power at 1e-6 and 1,750 for ten thousand.
    """

    def __init__(self, threshold: float, n_summed: int, swerling: int) -> None:
        self._n_summed = n_summed
        self._shape = swerling_shape(swerling, n_summed)
        threshold = check_number("threshold", threshold, above=0, at_most=_MAX_THRESHOLD)
        # Below 40 deviations p is 0 in floating point; above 12 it is 1e-31 of what is kept.
        deviation = math.sqrt(max(threshold, n_summed))
        first = max(threshold - n_summed - 40 * deviation, 0)
        last = max(threshold - n_summed, 0) + 12 * deviation + 30
        self._i = np.arange(math.floor(first), math.ceil(last))
        # From ratios, since p itself underflows; the sum is known.
        log_p = np.cumsum(np.log(threshold / (n_summed + self._i)))
        p = np.exp(log_p - log_p.max())
        self._p = p * (scipy.special.gammainc(n_summed, threshold) / p.sum())
        self._noise = float(scipy.special.gammaincc(n_summed, threshold))

    def exceedance_probability(self, snr: float) -> float:
        """Return the probability that the sum exceeds the threshold."""
        probability = self._noise + self.exceedance_added_by_target(snr)
        return probability if probability < 0.5 else 1 - self.miss_probability(snr)

    def exceedance_added_by_target(self, snr: float) -> float:
        """Return the excess of that probability over the one of noise alone."""
        return float(
            self._p @ probability_count_at_least(self._i + 1, self._n_summed * snr, self._shape)
        )

    def miss_probability(self, snr: float) -> float:
        """Return the probability that the sum stays below the threshold."""
        return float(
            self._p @ probability_count_below(self._i + 1, self._n_summed * snr, self._shape)
        )
