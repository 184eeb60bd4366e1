r"""Spur: tone of a clock or switching regulator that leaks into the receiver.

A spur of power P and frequency f adds to each sample, at time t since the start of the frame,

.. math:: \sqrt{P}\, e^{i (2 \pi f t + \varphi)}.

The source is phase-continuous from chirp to chirp, so transforms integrate it like an echo: a false
target at the Doppler frequency f_D, which is f less the nearest multiple of 1 / T, and at

.. math:: v = \frac{\lambda}{2} f_D, \qquad R = \frac{c}{2 S} (f - f_D),

equal in all receivers, as from boresight. Real samples contain sqrt(2) times the real part, as for
an echo. Chirp intervals that change from frame to frame are not modelled: each frame contains the
tone as sampled with the shortest interval.

References
----------
W. Kester (ed.), The Data Conversion Handbook, Analog Devices, 2005, 9 (origin of spurs).
"""

import numpy as np

from dechirp import InvalidSetting, Radar, Scene
from dechirp.extensions import (
    Receiver,
    check_non_negative_fields,
    check_positive_fields,
    frozen_dataclass,
)


@frozen_dataclass
class Spur(Receiver):
    """Tone with a random phase in each frame, equal in all receivers."""

    frequency_hz: float
    """Frequency after the mixer, on the scale of beat frequencies."""
    power_w: float
    """Referred to the antenna, like the power of an echo."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "frequency_hz")
        check_non_negative_fields(self, "power_w", at_most=1e3)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if the anti-aliasing filter would remove the tone."""
        max_beat_hz = radar.frame.chirp.max_beat_frequency_hz
        if self.frequency_hz > max_beat_hz:
            raise InvalidSetting(
                "frequency",
                value=f"{self.frequency_hz / 1e6:.4g} MHz",
                expected=f"at most {max_beat_hz / 1e6:.4g} MHz, the highest beat that is sampled",
                fix="leave it out, or give the frequency at which it aliases into the samples",
            )

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the tone to (n_frames, n_chirps, n_rx, n_samples)."""
        rate_hz = radar.frame.chirp.sample_rate_hz
        sample_times_s = np.arange(samples.shape[-1]) / rate_hz
        turns = self.frequency_hz * (radar.frame.chirp_starts_s[:, None] + sample_times_s)
        for frame in samples:
            tone = np.sqrt(self.power_w) * np.exp(2j * np.pi * (turns + rng.uniform()))
            if not np.iscomplexobj(frame):
                tone = np.sqrt(2) * tone.real
            frame[...] += tone[:, None].astype(frame.dtype)
