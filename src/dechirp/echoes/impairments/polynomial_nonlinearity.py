"""A ramp that bends: its frequency error is a polynomial in time."""

import numpy as np
from numpy.polynomial import Polynomial

from dechirp.core.checks import listed, series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.frequency_error import FrequencyError
from dechirp.radar.radar import Radar


@value
class PolynomialNonlinearity(FrequencyError):
    r"""Frequency error that is the same polynomial over every ramp.

    .. math:: \Delta f(t) = \sum_k e_k (t / T)^k,

    T the duration of the ramp. The beat frequency of an echo changes by its delay times the
    derivative: k = 0 is an error of the carrier, k = 1 one of the slope, k = 2 smears far
    targets over range, the more the later they are.

    References
    ----------
    H. D. Griffiths, New ideas in FM radar, Electronics & Communication Engineering J., 1990.
    """

    error_hz: tuple[float, ...]
    """Coefficients e_0, e_1, e_2 ...: each is what its power makes at the end of the ramp."""

    def __post_init__(self) -> None:
        given = listed(self.error_hz) or ()
        if not 1 <= len(given) <= 16:
            raise InvalidSetting(
                "PolynomialNonlinearity.error_hz",
                got=self.error_hz,
                need="a list of 1 to 16 frequencies, of the powers 0, 1, 2 ... of time",
                fix="Write [0 Hz, 0 Hz, 100 kHz] for a parabola.",
            )
        made = series("PolynomialNonlinearity.error_hz", given, at_least=-1e13, at_most=1e13)
        object.__setattr__(self, "error_hz", made)

    def frequency_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """The polynomial."""
        return Polynomial(self.error_hz)(times_s / radar.frame.chirp.ramp_duration_s)

    def cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Its integral."""
        ramp_s = radar.frame.chirp.ramp_duration_s
        return ramp_s * Polynomial(self.error_hz).integ()(times_s / ramp_s)
