"""Sweep nonlinearity of the oscillator: polynomial, sinusoidal, and drift of the slope."""

import numpy as np
from numpy.polynomial import Polynomial

from dechirp.core.checks import (
    as_tuple_or_none,
    check_non_negative_fields,
    check_number,
    check_numbers,
    check_positive_fields,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow
from dechirp.simulation.impairments.base import Oscillator
from dechirp.simulation.impairments.frequency_error import (
    FrequencyError,
    max_accurate_frequency_error_hz,
    warn_of_large_frequency_error,
)


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
        coefficients = as_tuple_or_none(self.error_hz) or ()
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


@frozen_dataclass
class SinusoidalNonlinearity(FrequencyError):
    r"""Sinusoidal frequency error, the same over every ramp.

    .. math:: \Delta f(t) = D \cos(2 \pi f_m t + \theta)

    An echo of the delay tau gets paired echoes, f_m above and below its beat frequency, at the
    level
    J1(beta) / J0(beta), and weaker ones at multiples:

    .. math:: \beta = 2 (D / f_m) \sin(\pi f_m \tau)

    References
    ----------
    H. D. Griffiths, The effect of phase and amplitude errors in FM radar, IEE Colloquium on
    High Time-Bandwidth Product Waveforms in Radar and Sonar, 1991.
    S. O. Piper, Homodyne FMCW radar range resolution effects with sinusoidal nonlinearities in
    the frequency sweep, IEEE Int. Radar Conf., 1995.
    """

    deviation_hz: float
    """Largest frequency error, D."""
    rate_hz: float
    """Frequency of the ripple, f_m."""
    start_phase_rad: float = 0.0
    """Phase of the ripple at the start of every ramp, theta."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "deviation_hz", at_most=1e13)
        check_positive_fields(self, "rate_hz", at_least=1e-6, at_most=1e13)
        start_rad = check_number("SinusoidalNonlinearity.start_phase_rad", self.start_phase_rad)
        object.__setattr__(self, "start_phase_rad", start_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a rate above the sample rate; warn about a large error."""
        highest_hz = radar.frame.chirp.sample_rate_hz
        if self.rate_hz >= highest_hz:
            raise InvalidSetting(
                "rate",
                value=f"{self.rate_hz / 1e6:.6g} MHz",
                expected=f"below {highest_hz / 1e6:.6g} MHz, the sample rate",
                fix="lower the rate, or sample faster",
            )
        super().check(scene, radar)

    def frequency_error_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        return self.deviation_hz * np.cos(self._ripple_phase_rad(times_s))

    def phase_error_cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        swung = np.sin(self._ripple_phase_rad(times_s)) - np.sin(self.start_phase_rad)
        return self.deviation_hz / (2 * np.pi * self.rate_hz) * swung

    def _ripple_phase_rad(self, times_s: np.ndarray) -> np.ndarray:
        return 2 * np.pi * self.rate_hz * times_s + self.start_phase_rad


@frozen_dataclass
class SlopeDrift(Oscillator):
    """Slope that grows linearly from chirp to chirp and from frame to frame.

    .. math:: S(t) = S (1 + r t),

    with t the start of the chirp since the first frame; the slope is constant within a chirp.
    Echoes
    drift by r R each second, outwards for r above 0.
    """

    relative_drift: float
    """Relative change of the slope each second, r, for example 1e-6."""

    def __post_init__(self) -> None:
        check_number("SlopeDrift.relative_drift", self.relative_drift, at_least=-1.0, at_most=1.0)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn if the error is large at the end of the first frame."""
        warn_of_large_frequency_error(
            self.kind(), self._max_frequency_error_hz(0.0, radar), radar.frame.chirp
        )

    def phase_error_rad(
        self, window: SampleWindow, radar: Radar, rng: np.random.Generator
    ) -> np.ndarray:
        """Return pi times the slope error times the square of the time since the ramp's start.

        It warns in the first frame in which the error becomes large.
        """
        if window.frame_index:
            period_s, chirp = window.frame_start_s / window.frame_index, radar.frame.chirp
            if self._max_frequency_error_hz(
                window.frame_start_s - period_s, radar
            ) <= max_accurate_frequency_error_hz(chirp):
                warn_of_large_frequency_error(
                    self.kind(), self._max_frequency_error_hz(window.frame_start_s, radar), chirp
                )
        chirp_starts_s = window.frame_start_s + window.chirp_starts_s
        slopes = radar.frame.chirp.slope_hz_per_s * self.relative_drift * chirp_starts_s
        return np.pi * slopes[:, None] * np.square(window.times_s)

    def _max_frequency_error_hz(self, frame_start_s: float, radar: Radar) -> float:
        """Return the largest error at the end of a frame that begins at `frame_start_s`."""
        frame = radar.frame
        return (
            abs(self.relative_drift)
            * (frame_start_s + frame.duration_s)
            * frame.chirp.ramp_bandwidth_hz
        )
