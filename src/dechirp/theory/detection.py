"""Detection of one look in known noise, by a square-law detector.

`snr` is A^2 / E|w|^2 in the cell under test, after integration: the power of the target
over the mean power of complex noise.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chndtr, chndtrinc

from dechirp.core.errors import InvalidSetting


def threshold(false_alarm_probability: float) -> float:
    """Threshold over the mean noise power, -ln Pfa: the power of noise is exponential."""
    _probability("false_alarm_probability", false_alarm_probability)
    return float(-np.log(false_alarm_probability))


def detection_probability(snr: ArrayLike, false_alarm_probability: float) -> np.ndarray:
    r"""Probability that a steady target exceeds the threshold.

    .. math:: P_d = Q_1(\sqrt{2\chi}, \sqrt{2T}), \quad T = -\ln P_{fa}

    Twice the power is non-central chi-square with 2 degrees of freedom and non-centrality
    2 chi, so Marcum's Q is one minus its distribution.

    Parameters
    ----------
    snr : array
        Ratio of powers after integration, chi; any shape.
    false_alarm_probability : float
        For the cell under test, with noise alone.

    Returns
    -------
    array
        The shape of `snr`. The absolute error is about 1e-16, so a probability below
        1e-12 has few digits.

    Raises
    ------
    InvalidSetting
        If the probability is not between 0 and 1, or a ratio is negative.

    References
    ----------
    J. I. Marcum, A statistical theory of target detection by pulsed radar, 1947 (IRE
    Trans. IT-6, 1960). M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed.
    """
    chi = np.asarray(snr, dtype=float)
    if not np.all(chi >= 0):
        raise InvalidSetting(
            "snr", got=np.min(chi), need="0 or more", fix="Give a ratio of powers, not dB."
        )
    two_t = 2 * threshold(false_alarm_probability)
    return np.asarray(1.0 - chndtr(two_t, 2.0, 2.0 * chi))


def required_snr(detection_probability: float, false_alarm_probability: float) -> float:
    """Ratio at which a steady target is detected so often; 13.18 dB for 0.9 at 1e-6.

    The inverse of `detection_probability`. Raises `InvalidSetting` unless
    0 < false-alarm probability < detection probability < 1.
    """
    _probability("detection_probability", detection_probability)
    two_t = 2 * threshold(false_alarm_probability)
    if not detection_probability > false_alarm_probability:
        raise InvalidSetting(
            "detection_probability",
            got=detection_probability,
            need=f"above the false-alarm probability, {false_alarm_probability}",
            fix="Noise alone exceeds the threshold more often than that.",
        )
    return float(chndtrinc(two_t, 2.0, 1.0 - detection_probability) / 2)


def _probability(name: str, number: float) -> None:
    if not 0 < number < 1:
        raise InvalidSetting(
            name, got=number, need="between 0 and 1, both left out", fix="Give a probability."
        )
