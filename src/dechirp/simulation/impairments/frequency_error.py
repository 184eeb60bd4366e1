"""Base class of frequency errors that are equal in all chirps."""

import warnings
from abc import abstractmethod

import numpy as np

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow
from dechirp.simulation.impairments.base import Oscillator


class FrequencyError(Oscillator):
    """Frequency error over the ramp; outside the ramp, that of its ends continues.

    Late echoes are therefore those of a ramp that began earlier, as without the error.
    """

    @abstractmethod
    def frequency_error_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Return the error at times since the start of the ramp, (n_times,)."""

    @abstractmethod
    def phase_error_cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Return its integral from the start of the ramp, (n_times,)."""

    def phase_error_rad(
        self, window: SampleWindow, radar: Radar, rng: np.random.Generator
    ) -> np.ndarray:
        times_s = window.times_s
        within_s = np.clip(times_s, 0.0, radar.frame.chirp.ramp_duration_s)
        outside_cycles = self.frequency_error_hz(within_s, radar) * (times_s - within_s)
        phase = 2 * np.pi * (self.phase_error_cycles(within_s, radar) + outside_cycles)
        return np.broadcast_to(phase, (len(window.chirp_starts_s), len(phase)))

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn about errors that are large for the band of the samples."""
        chirp = radar.frame.chirp
        times_s = chirp.adc_start_s + np.linspace(0, chirp.sampled_duration_s, 257)
        within_s = np.minimum(times_s, chirp.ramp_duration_s)
        largest_hz = float(np.abs(self.frequency_error_hz(within_s, radar)).max())
        warn_of_large_frequency_error(self.kind(), largest_hz, chirp)


def warn_of_large_frequency_error(
    impairment_kind: str, frequency_error_hz: float, chirp: Chirp
) -> None:
    """Warn if a frequency error exceeds `max_accurate_frequency_error_hz`."""
    max_hz = max_accurate_frequency_error_hz(chirp)
    if frequency_error_hz > max_hz:
        finding = Finding(
            level="warning",
            setting=f"impairments.{impairment_kind}",
            value=f"frequency errors up to {frequency_error_hz / 1e6:.4g} MHz during sampling",
            expected=f"at most {max_hz / 1e6:.4g} MHz, a quarter of the sample rate and an eighth"
            " of the sampled bandwidth, for accuracy in all samples",
            fix="reduce the error, or start sampling after it has settled",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


def max_accurate_frequency_error_hz(chirp: Chirp) -> float:
    """Return a quarter of the sample rate, or an eighth of the sampled bandwidth if that is less.

    The margins of the echoes extend as far in time as an error of this size needs.
    """
    return min(chirp.sample_rate_hz / 4, chirp.sampled_bandwidth_hz / 8)
