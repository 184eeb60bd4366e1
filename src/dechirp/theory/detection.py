"""Detection of one look in known noise, by a square-law detector.

`snr` is A^2 / E|w|^2 in the cell under test, after integration: the power of the target
over the mean power of complex noise.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chndtr, chndtrinc, gammainccinv

from dechirp.core.errors import InvalidSetting


def threshold(false_alarm_probability: float, *, n_channels: int = 1) -> float:
    """Threshold of the power summed over channels, over the mean noise power of one.

    -ln Pfa for one channel: the power of noise is exponential. The sum over K is a gamma
    variate of K.
    """
    _probability("false_alarm_probability", false_alarm_probability)
    return float(gammainccinv(n_channels, false_alarm_probability))


def detection_probability(
    snr: ArrayLike, false_alarm_probability: float, *, n_channels: int = 1
) -> np.ndarray:
    r"""Probability that a steady target exceeds the threshold.

    .. math:: P_d = Q_K(\sqrt{2K\chi}, \sqrt{2T}), \quad Q(K, T) = P_{fa}

    Twice the power summed over K channels is non-central chi-square with 2 K degrees of
    freedom and non-centrality 2 K chi, so Marcum's Q is one minus its distribution.

    Parameters
    ----------
    snr : array
        Ratio of powers in one channel after integration, chi; any shape.
    false_alarm_probability : float
        For the cell under test, with noise alone.
    n_channels : int
        Receivers whose powers are added, K.

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
    two_t = 2 * threshold(false_alarm_probability, n_channels=n_channels)
    return np.asarray(1.0 - chndtr(two_t, 2.0 * n_channels, 2.0 * n_channels * chi))


def required_snr(
    detection_probability: float, false_alarm_probability: float, *, n_channels: int = 1
) -> float:
    """Ratio in one channel at which a steady target is detected so often; 13.18 dB for 0.9 at 1e-6.

    The inverse of `detection_probability`. Raises `InvalidSetting` unless
    0 < false-alarm probability < detection probability < 1.
    """
    _probability("detection_probability", detection_probability)
    two_t = 2 * threshold(false_alarm_probability, n_channels=n_channels)
    if not detection_probability > false_alarm_probability:
        raise InvalidSetting(
            "detection_probability",
            got=detection_probability,
            need=f"above the false-alarm probability, {false_alarm_probability}",
            fix="Noise alone exceeds the threshold more often than that.",
        )
    noncentral = chndtrinc(two_t, 2.0 * n_channels, 1.0 - detection_probability)
    return float(noncentral / (2 * n_channels))


def _probability(name: str, number: float) -> None:
    if not 0 < number < 1:
        raise InvalidSetting(
            name, got=number, need="between 0 and 1, both left out", fix="Give a probability."
        )
