"""Drift of the slope, for example with temperature, which shifts ranges."""

import numpy as np

from dechirp.core.checks import check_number
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow
from dechirp.simulation.impairments.base import Oscillator
from dechirp.simulation.impairments.frequency_error import (
    max_frequency_error_hz,
    warn_of_large_error,
)


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
        warn_of_large_error(self.kind(), self._max_error_hz(0.0, radar), radar.frame.chirp)

    def phase_error_rad(
        self, window: SampleWindow, radar: Radar, rng: np.random.Generator
    ) -> np.ndarray:
        """Return pi times the slope error times the square of the time since the ramp's start.

        It warns in the first frame in which the error becomes large.
        """
        if window.frame_index:
            period_s, chirp = window.frame_start_s / window.frame_index, radar.frame.chirp
            if self._max_error_hz(window.frame_start_s - period_s, radar) <= max_frequency_error_hz(
                chirp
            ):
                warn_of_large_error(
                    self.kind(), self._max_error_hz(window.frame_start_s, radar), chirp
                )
        chirp_starts_s = window.frame_start_s + window.chirp_starts_s
        slopes = radar.frame.chirp.slope_hz_per_s * self.relative_drift * chirp_starts_s
        return np.pi * slopes[:, None] * np.square(window.times_s)

    def _max_error_hz(self, start_s: float, radar: Radar) -> float:
        """Return the largest error at the end of a frame that begins at `start_s`."""
        frame = radar.frame
        return (
            abs(self.relative_drift) * (start_s + frame.duration_s) * frame.chirp.ramp_bandwidth_hz
        )
