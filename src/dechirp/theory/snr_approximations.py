"""Closed-form approximations of the required SNR: Albersheim and Shnidman.

`theory.detection.required_snr` is exact. The approximations serve to assess the common formulas
and to follow published link budgets that used them.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.checks import (
    broadcast_arguments,
    check_detection_probability,
    check_probabilities,
    check_whole_numbers,
)
from dechirp.core.elementwise import elementwise, scalar_results
from dechirp.core.errors import InvalidSetting
from dechirp.theory.swerling import swerling_shape

__all__ = ["albersheim", "shnidman"]

_MAX_LOSS_DB = 600  # larger ratios are beyond the largest magnitude of the package, 1e60


@scalar_results
def albersheim(
    detection_probability: ArrayLike,
    false_alarm_probability: ArrayLike,
    *,
    n_summed: ArrayLike = 1,
) -> np.ndarray:
    r"""Return the SNR of a steady target in each summed power, by Albersheim's formula.

    .. math::
        10 \lg \chi = -5 \lg K + \left(6.2 + \frac{4.54}{\sqrt{K + 0.44}}\right)
        \lg(A + 0.12 A B + 1.7 B),
        \quad A = \ln\frac{0.62}{P_{fa}}, \quad B = \ln\frac{P_d}{1 - P_d}

    with K the summed powers, Albersheim's N, and chi the snr, a ratio; the shape is that to which
    both probabilities and K broadcast. Meant for detection
    probabilities from 0.1 to 0.9, false-alarm probabilities from 1e-7 to 1e-3, up to 8096
    powers, and a linear detector: amplitudes summed. Against the exact square law it is
    within 0.34 dB from a detection probability of 0.3 (0.07 dB low for one power, 0.9 and
    1e-6), up to 0.9 dB low at 0.2, and up to 4.1 dB low at 0.1.

    Parameters
    ----------
    detection_probability : array
        Probability that the target is detected, above that of a false alarm and below 1.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300, below the detection probability.
    n_summed : array of int
        Powers K of pulses or receivers that are summed, at least 1.

    Raises
    ------
    InvalidSetting
        Unless 1e-300 <= false-alarm probability < detection probability < 1 and K is a whole
        number from 1, or if the formula has no solution near the false-alarm probability.

    References
    ----------
    W. J. Albersheim, A closed-form approximation to Robertson's detection characteristics,
    Proc. IEEE 69(7), 1981.
    """
    arguments = _broadcast(detection_probability, false_alarm_probability, n_summed)
    return np.vectorize(_albersheim_snr, otypes=[float])(*arguments)


def _albersheim_snr(
    detection_probability: float, false_alarm_probability: float, n_summed: int
) -> float:
    check_detection_probability(detection_probability, false_alarm_probability)
    a = math.log(0.62 / false_alarm_probability)
    b = math.log(detection_probability / (1 - detection_probability))
    argument = a + 0.12 * a * b + 1.7 * b
    if not argument > 0:
        raise InvalidSetting(
            "detection_probability",
            value=detection_probability,
            expected="further above the false-alarm probability for Albersheim's formula",
            fix="use required_snr, which is exact",
        )
    slope = 6.2 + 4.54 / math.sqrt(n_summed + 0.44)
    return float(argument ** (slope / 10) / math.sqrt(n_summed))


@elementwise
def shnidman(
    detection_probability: ArrayLike,
    false_alarm_probability: ArrayLike,
    *,
    n_summed: ArrayLike = 1,
    swerling: int = 0,
) -> np.ndarray:
    r"""Return the mean SNR in each summed power, by Shnidman's formula.

    .. math:: \chi = 10^{C/10}\, \eta\, (\eta + 2 \sqrt{K/2 + \alpha - 1/4}) / K

    with K the summed powers, Shnidman's N; eta from both probabilities, alpha 1/4 from 40
    powers, and C, in dB, the fluctuation loss, proportional to 1 / kappa, kappa being the
    shape of `theory.swerling` and Shnidman's K, and is 0 for a steady target. The shape is that to
    which both probabilities and K broadcast. Meant for
    detection probabilities from 0.1 to 0.99, false-alarm probabilities from 1e-9 to 1e-3 and
    up to 100 powers. There it is within 0.3, 1.2, 1.2, 0.9 and 0.6 dB of the exact ratio for
    the cases 0 to 4.

    Parameters
    ----------
    detection_probability : array
        Probability that the target is detected, above that of a false alarm and below 1.
    false_alarm_probability : array
        Probability of a false alarm in a cell, from 1e-300, below the detection probability.
    n_summed : array of int
        Powers K of pulses or receivers that are summed, at least 1.
    swerling : int
        0 for a steady target, 1 to 4 for Swerling's cases.

    Raises
    ------
    InvalidSetting
        Unless 1e-300 <= false-alarm probability < detection probability < 1, K is a whole number
        from 1 and `swerling` one of 0 to 4; and if K is so large that C exceeds 600 dB.

    References
    ----------
    D. A. Shnidman, Determination of required SNR values, IEEE Trans. AES 38(3), 2002.
    """
    swerling_shape(swerling, 1)  # checks the case for empty arrays as well
    arguments = _broadcast(detection_probability, false_alarm_probability, n_summed)
    return np.vectorize(_shnidman_snr, otypes=[float])(*arguments, swerling)


def _shnidman_snr(
    detection_probability: float, false_alarm_probability: float, n_summed: int, swerling: int
) -> float:
    check_detection_probability(detection_probability, false_alarm_probability)
    shape = swerling_shape(int(swerling), int(n_summed))
    pd = detection_probability
    eta = _shnidman_quantile(pd) - _shnidman_quantile(false_alarm_probability)
    alpha = 0.0 if n_summed < 40 else 0.25
    steady = eta * (eta + 2 * math.sqrt(n_summed / 2 + alpha - 0.25)) / n_summed
    cost_db = (((17.7006 * pd - 18.4496) * pd + 14.5339) * pd - 3.525) / shape
    if pd > 0.872:
        near_one = math.exp(27.31 * pd - 25.14)
        alarms = 0.7 * math.log(1e-5 / false_alarm_probability) + (2 * n_summed - 20) / 80
        cost_db += (near_one + (pd - 0.8) * alarms) / shape
    if cost_db > _MAX_LOSS_DB:
        raise InvalidSetting(
            "n_summed",
            value=int(n_summed),
            expected=f"a number whose fluctuation loss is at most {_MAX_LOSS_DB} dB by Shnidman's"
            " formula, which is meant for up to 100",
            fix="compute the exact ratio with dechirp.theory.required_snr",
        )
    return float(10 ** (cost_db / 10) * steady)


def _broadcast(
    detection_probability: ArrayLike, false_alarm_probability: ArrayLike, n_summed: ArrayLike
) -> tuple[np.ndarray, ...]:
    return broadcast_arguments(
        detection_probability=check_probabilities("detection_probability", detection_probability),
        false_alarm_probability=check_probabilities(
            "false_alarm_probability", false_alarm_probability
        ),
        n_summed=check_whole_numbers("n_summed", n_summed, at_least=1),
    )


def _shnidman_quantile(probability: float) -> float:
    """Return Shnidman's quantile of a probability, negative below one half."""
    size = math.sqrt(-0.8 * math.log(4 * probability * (1 - probability)))
    return math.copysign(size, probability - 0.5)
