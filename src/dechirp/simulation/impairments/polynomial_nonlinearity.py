"""Polynomial sweep nonlinearity."""

import numpy as np
from numpy.polynomial import Polynomial

from dechirp.core.checks import as_tuple, check_numbers
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.simulation.impairments.frequency_error import FrequencyError


@frozen_dataclass
class PolynomialNonlinearity(FrequencyError):
    r"""Frequency error that is the same polynomial over every ramp.

    .. math:: \Delta f(t) = \sum_k e_k (t / T)^k,

    with T the duration of the ramp. The beat frequency of an echo changes by its delay times the
    derivative: k = 0 is an error of the carrier, k = 1 one of the slope, and k = 2 smears targets
    over
    range, in proportion to their delay.

    References
    ----------
    H. D. Griffiths, New ideas in FM radar, Electronics & Communication Engineering J., 1990.
    """

    error_hz: tuple[float, ...]
    """Coefficients e_0, e_1, e_2 ...: the contribution of each power at the end of the ramp."""

    def __post_init__(self) -> None:
        coefficients = as_tuple(self.error_hz) or ()
        if not 1 <= len(coefficients) <= 16:
            raise InvalidSetting(
                "PolynomialNonlinearity.error_hz",
                value=self.error_hz,
                expected="a list of 1 to 16 frequencies, for the powers 0, 1, 2 ... of time",
                fix="write [0 Hz, 0 Hz, 100 kHz] for a parabola",
            )
        error_hz = check_numbers(
            "PolynomialNonlinearity.error_hz", coefficients, at_least=-1e13, at_most=1e13
        )
        object.__setattr__(self, "error_hz", error_hz)

    def frequency_error_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        return Polynomial(self.error_hz)(times_s / radar.frame.chirp.ramp_duration_s)

    def phase_error_cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        ramp_s = radar.frame.chirp.ramp_duration_s
        return ramp_s * Polynomial(self.error_hz).integ()(times_s / ramp_s)
