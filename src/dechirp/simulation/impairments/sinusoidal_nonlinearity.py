"""Sinusoidal sweep nonlinearity, which causes paired echoes."""

import numpy as np

from dechirp.core.checks import check_non_negative, check_number, check_positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.frequency_error import FrequencyError


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
        check_non_negative(self, "deviation_hz", at_most=1e13)
        check_positive(self, "rate_hz", at_least=1e-6, at_most=1e13)
        start_rad = check_number("SinusoidalNonlinearity.start_phase_rad", self.start_phase_rad)
        object.__setattr__(self, "start_phase_rad", start_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a rate above the Nyquist frequency; warn about a large error."""
        nyquist_hz = radar.frame.chirp.sample_rate_hz / 2
        if self.rate_hz >= nyquist_hz:
            raise InvalidSetting(
                "rate",
                value=f"{self.rate_hz / 1e6:.6g} MHz",
                expected=f"below {nyquist_hz / 1e6:.6g} MHz, half the sample rate",
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
