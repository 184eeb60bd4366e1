"""A ripple on the ramp: its frequency error is a sinusoid, and echoes come with pairs."""

import numpy as np

from dechirp.core.checks import not_negative, number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.frequency_error import FrequencyError
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class SinusoidalNonlinearity(FrequencyError):
    r"""Frequency error that swings alike over every ramp.

    .. math:: \Delta f(t) = D \cos(2 \pi f_m t + \theta)

    Beside an echo of the delay tau appear paired echoes, f_m above and below its beat
    frequency, at the level J1(beta) / J0(beta) of it, and weaker ones at multiples:

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
    """How often it swings, f_m."""
    start_phase_rad: float = 0.0
    """Of the swing at the start of every ramp, theta."""

    def __post_init__(self) -> None:
        not_negative(self, "deviation_hz", at_most=1e13)
        positive(self, "rate_hz", at_least=1e-6, at_most=1e13)
        start_rad = number("SinusoidalNonlinearity.start_phase_rad", self.start_phase_rad)
        object.__setattr__(self, "start_phase_rad", start_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a rate that samples cannot follow, warn of a large error."""
        nyquist_hz = radar.frame.chirp.sample_rate_hz / 2
        if self.rate_hz >= nyquist_hz:
            raise InvalidSetting(
                "rate",
                got=f"{self.rate_hz / 1e6:.6g} MHz",
                need=f"below {nyquist_hz / 1e6:.6g} MHz, half the sample rate",
                fix="Give a slower ripple, or sample faster.",
            )
        super().check(scene, radar)

    def frequency_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """The swing."""
        return self.deviation_hz * np.cos(self._angle_rad(times_s))

    def cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Its integral."""
        swung = np.sin(self._angle_rad(times_s)) - np.sin(self.start_phase_rad)
        return self.deviation_hz / (2 * np.pi * self.rate_hz) * swung

    def _angle_rad(self, times_s: np.ndarray) -> np.ndarray:
        return 2 * np.pi * self.rate_hz * times_s + self.start_phase_rad
