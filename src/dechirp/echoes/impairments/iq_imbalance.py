"""Gain and phase imbalance of an I/Q mixer: an image of every echo at minus its frequency."""

import numpy as np

from dechirp.core.checks import number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.echoes.pieces import in_pieces
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class IqImbalance(Receiver):
    r"""The two halves of an I/Q mixer are unlike, alike in all receivers.

    .. math::
        I' = (I \cos\tfrac\phi2 - Q \sin\tfrac\phi2) / \sqrt g, \quad
        Q' = (Q \cos\tfrac\phi2 - I \sin\tfrac\phi2) \sqrt g

    with g the ratio of the amplitudes, half of each error in each half of the mixer (two Gilbert
    cells). An echo keeps the power (g + 1/g + 2 cos phi) / 4, which is 1 but for squares of the
    errors (0.006 dB at 1 dB and 5 deg), and gets an image weaker by

    .. math:: IRR = \frac{1 + 2 g \cos\phi + g^2}{1 - 2 g \cos\phi + g^2},

    39.6 dB at 0.1 dB and 1 deg. It lies at minus the beat frequency, and so at the sample rate
    less that. Alike at all frequencies.

    References
    ----------
    B. Razavi, RF Microelectronics, 2nd ed., 2011, 4.2.
    """

    gain: float = 1.0
    """Power gain of Q over that of I, a ratio (dB in files)."""
    phase_rad: float = 0.0
    """How far I and Q are from a quarter of a turn apart."""

    def __post_init__(self) -> None:
        positive(self, "gain", at_least=0.01, at_most=100.0)
        number("IqImbalance.phase_rad", self.phase_rad, at_least=-np.pi / 2, at_most=np.pi / 2)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where the radar has one mixer."""
        if radar.frame.chirp.sampling == "real":
            raise InvalidSetting(
                "gain",
                got="of Q over I, and samples are real",
                need="complex samples: one mixer has nothing to be unlike",
                fix="Leave iq-imbalance out, or set radar.frame.chirp.sampling to complex.",
            )

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Mix I and Q."""
        root, half = self.gain**0.25, self.phase_rad / 2
        sum_, difference = (1 / root + root) / 2, (1 / root - root) / 2
        kind = samples.dtype.type
        own = kind(sum_ * np.cos(half) + 1j * difference * np.sin(half))
        image = kind(difference * np.cos(half) - 1j * sum_ * np.sin(half))

        def mix(chirps: np.ndarray) -> None:
            images = np.conj(chirps)
            images *= image
            chirps *= own
            chirps += images

        in_pieces(samples, mix)
