"""Gain and phase imbalance of an I/Q mixer, with an image of every echo."""

import numpy as np

from dechirp.core.checks import check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.blocks import apply_to_chirp_blocks
from dechirp.simulation.impairments.base import Receiver


@frozen_dataclass
class IqImbalance(Receiver):
    r"""Gain and phase imbalance of an I/Q mixer, equal in all receivers.

    .. math::
        I' = (I \cos\tfrac\phi2 - Q \sin\tfrac\phi2) / \sqrt g, \quad
        Q' = (Q \cos\tfrac\phi2 - I \sin\tfrac\phi2) \sqrt g

    with g the ratio of the amplitudes, half of each error in each half of the mixer (two Gilbert
    cells). An echo keeps the power (g + 1/g + 2 cos phi) / 4, which is 1 up to squares of the
    errors
    (0.006 dB at 1 dB and 5 deg), and gets an image weaker by

    .. math:: IRR = \frac{1 + 2 g \cos\phi + g^2}{1 - 2 g \cos\phi + g^2},

    39.6 dB at 0.1 dB and 1 deg. It lies at minus the beat frequency, and so at the sample rate
    minus
    that. The imbalance does not depend on frequency.

    References
    ----------
    B. Razavi, RF Microelectronics, 2nd ed., 2011, 4.2.
    """

    gain: float = 1.0
    """Power gain of Q over that of I, a ratio (dB in files)."""
    phase_rad: float = 0.0
    """Deviation of I and Q from quadrature."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "gain", at_least=0.01, at_most=100.0)
        check_number(
            "IqImbalance.phase_rad", self.phase_rad, at_least=-np.pi / 2, at_most=np.pi / 2
        )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if the radar samples real signals."""
        if radar.frame.chirp.sampling == "real":
            raise InvalidSetting(
                "gain",
                value="I/Q imbalance with real samples",
                expected="complex samples: a single mixer has no imbalance",
                fix="remove iq-imbalance, or set radar.frame.chirp.sampling to complex",
            )

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        gain_root, half_phase = self.gain**0.25, self.phase_rad / 2
        sum_, difference = (1 / gain_root + gain_root) / 2, (1 / gain_root - gain_root) / 2
        sample_type = samples.dtype.type
        direct_factor = sample_type(
            sum_ * np.cos(half_phase) + 1j * difference * np.sin(half_phase)
        )
        image_factor = sample_type(difference * np.cos(half_phase) - 1j * sum_ * np.sin(half_phase))

        def mix(chirps: np.ndarray) -> None:
            images = np.conj(chirps)
            images *= image_factor
            chirps *= direct_factor
            chirps += images

        apply_to_chirp_blocks(samples, mix)
