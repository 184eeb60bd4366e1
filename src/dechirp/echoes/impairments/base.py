"""What an impairment is: something the receiver does to the samples of the echoes."""

from abc import abstractmethod
from typing import ClassVar

import numpy as np
import xarray as xr

from dechirp.core.families import Family
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


class Impairment(Family):
    """Acts on the samples, in the order in which impairments are listed."""

    group: ClassVar[str] = "dechirp.impairment"

    @abstractmethod
    def apply(
        self, cube: xr.DataArray, *, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Change the samples of `cube`, (frame, chirp, rx, sample), in place."""

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Mean power of the noise that it adds to each sample, W; none by default."""
        return 0.0
