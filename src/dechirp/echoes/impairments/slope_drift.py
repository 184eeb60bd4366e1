"""A ramp whose slope drifts, as with temperature: ranges drift with it."""

import numpy as np

from dechirp.core.checks import number
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Oscillator
from dechirp.echoes.impairments.frequency_error import most_error_hz, warn_of_large
from dechirp.echoes.parts import Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class SlopeDrift(Oscillator):
    r"""Slope that grows linearly, from chirp to chirp and from frame to frame.

    .. math:: S(t) = S (1 + r t),

    t the start of the chirp since the first frame: in a chirp the slope is constant. Echoes
    drift by r R each second, away for r above 0.
    """

    relative_drift: float
    """Of the slope in each second, r, as 1e-6."""

    def __post_init__(self) -> None:
        number("SlopeDrift.relative_drift", self.relative_drift, at_least=-1.0, at_most=1.0)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn of what is large by the end of the first frame."""
        warn_of_large(self.kind(), self._error_hz(0.0, radar), radar.frame.chirp)

    def phase_rad(self, window: Window, radar: Radar, rng: np.random.Generator) -> np.ndarray:
        """Pi times the error of the slope times the square of the time since the ramp's start.

        Warns in the first frame by whose end that is large.
        """
        if window.frame:
            period_s, chirp = window.start_s / window.frame, radar.frame.chirp
            if self._error_hz(window.start_s - period_s, radar) <= most_error_hz(chirp):
                warn_of_large(self.kind(), self._error_hz(window.start_s, radar), chirp)
        begun_s = window.start_s + window.starts_s
        slopes = radar.frame.chirp.slope_hz_per_s * self.relative_drift * begun_s
        return np.pi * slopes[:, None] * np.square(window.times_s)

    def _error_hz(self, start_s: float, radar: Radar) -> float:
        """Largest error by the end of a frame that begins at a time."""
        frame = radar.frame
        return (
            abs(self.relative_drift) * (start_s + frame.duration_s) * frame.chirp.ramp_bandwidth_hz
        )
