"""Ramps whose frequency is not what it should be, alike in all chirps."""

import warnings
from abc import abstractmethod

import numpy as np

from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.echoes.impairments.base import Oscillator
from dechirp.echoes.parts import Window
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


class FrequencyError(Oscillator):
    """An error of the frequency over the ramp; before and after it that of its ends holds.

    So echoes that are late are those of a ramp that began earlier, as without the error.
    """

    @abstractmethod
    def frequency_hz(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Frequency less that of the linear ramp, (n_times,), times since the ramp's start."""

    @abstractmethod
    def cycles(self, times_s: np.ndarray, radar: Radar) -> np.ndarray:
        """Its integral from the start of the ramp, (n_times,)."""

    def phase_rad(self, window: Window, radar: Radar, rng: np.random.Generator) -> np.ndarray:
        """2 pi times the cycles, the same in all chirps."""
        times_s = window.times_s
        within_s = np.clip(times_s, 0.0, radar.frame.chirp.ramp_duration_s)
        beyond = self.frequency_hz(within_s, radar) * (times_s - within_s)
        phase = 2 * np.pi * (self.cycles(within_s, radar) + beyond)
        return np.broadcast_to(phase, (len(window.starts_s), len(phase)))

    def check(self, scene: Scene, radar: Radar) -> None:
        """Warn of errors that are large for the band of the samples."""
        chirp = radar.frame.chirp
        times_s = chirp.adc_start_s + np.linspace(0, chirp.sampled_duration_s, 257)
        within_s = np.minimum(times_s, chirp.ramp_duration_s)
        largest_hz = float(np.abs(self.frequency_hz(within_s, radar)).max())
        warn_of_large(self.kind(), largest_hz, chirp)


def warn_of_large(kind: str, frequency_hz: float, chirp: Chirp) -> None:
    """Warn where a frequency error is above `most_error_hz`."""
    most_hz = most_error_hz(chirp)
    if frequency_hz > most_hz:
        finding = Finding(
            level="warning",
            setting=f"impairments.{kind}",
            got=f"frequency errors up to {frequency_hz / 1e6:.4g} MHz while samples are taken",
            need=f"at most {most_hz / 1e6:.4g} MHz, a quarter of the sample rate and an eighth of"
            " the sampled bandwidth, for all samples to be right",
            fix="Make the error smaller, or start sampling when it has settled.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


def most_error_hz(chirp: Chirp) -> float:
    """A quarter of the sample rate, and an eighth of what is swept while sampling.

    As far in time as the error needs echoes.
    """
    return min(chirp.sample_rate_hz / 4, chirp.sampled_bandwidth_hz / 8)
