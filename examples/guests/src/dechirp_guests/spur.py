r"""A spur: a tone of a clock or of a switching regulator that leaks into the receiver.

Of power P at frequency f it adds to every sample, at the time t since the start of its frame,

.. math:: \sqrt{P}\, e^{i (2 \pi f t + \varphi)}.

Its source runs on from chirp to chirp, so transforms gather it as they gather an echo: a false
target at the Doppler frequency f_D, which is f less the nearest multiple of 1 / T, and at

.. math:: v = \frac{\lambda}{2} f_D, \qquad R = \frac{c}{2 S} (f - f_D),

alike in all receivers, as from straight ahead. Real samples hold sqrt(2) times its real part, as
of an echo. Where intervals change from frame to frame, every frame has the tone as the shortest
of them would sample it: that is not modelled.

References
----------
W. Kester (ed.), The Data Conversion Handbook, Analog Devices, 2005, 9 (where spurs come from).
"""

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.base import Receiver


@frozen_dataclass
class Spur(Receiver):
    """A tone of one frequency, its phase drawn for each frame, the same in all receivers."""

    frequency_hz: float
    """After the mixer, where beat frequencies are."""
    power_w: float
    """Referred to the antenna, as that of an echo."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "frequency_hz")
        check_non_negative_fields(self, "power_w", at_most=1e3)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where the filter before the converter would have taken it out."""
        most_hz = radar.frame.chirp.max_beat_frequency_hz
        if self.frequency_hz > most_hz:
            raise InvalidSetting(
                "frequency",
                value=f"{self.frequency_hz / 1e6:.4g} MHz",
                expected=f"at most {most_hz / 1e6:.4g} MHz, the highest beat that is sampled",
                fix="leave it out, or give the frequency at which it aliases into the samples",
            )

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the tone to (n_frames, n_chirps, n_rx, n_samples); the phase takes up the rest."""
        rate_hz = radar.frame.chirp.sample_rate_hz
        sampled_s = np.arange(samples.shape[-1]) / rate_hz
        turns = self.frequency_hz * (radar.frame.chirp_starts_s[:, None] + sampled_s)
        for frame in samples:
            tone = np.sqrt(self.power_w) * np.exp(2j * np.pi * (turns + rng.uniform()))
            if not np.iscomplexobj(frame):
                tone = np.sqrt(2) * tone.real
            frame[...] += tone[:, None].astype(frame.dtype)
