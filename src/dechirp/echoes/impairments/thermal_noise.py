"""Thermal noise of the receiver: k T0 F fs in every sample."""

import numpy as np

from dechirp.core.normal import add_white_noise
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class ThermalNoise(Receiver):
    """White Gaussian noise whose power follows from the noise factor and the sample rate."""

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the noise to every sample."""
        add_white_noise(samples, self.noise_power_w(scene, radar), rng)

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """K T0 F fs, whatever the scene."""
        return noise_power_w(radar)
