"""Thermal noise of the receiver, k T0 F fs in every sample."""

import numpy as np

from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.values import frozen_dataclass
from dechirp.radar.budget import noise_power_w
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.impairments.base import Receiver


@frozen_dataclass
class ThermalNoise(Receiver):
    """White Gaussian noise with the power of the noise factor and the sample rate."""

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        add_white_noise(samples, self.noise_power_w(scene, radar), rng)

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Return k T0 F fs, independent of the scene."""
        return noise_power_w(radar)
