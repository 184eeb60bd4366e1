"""White noise at a given signal-to-noise ratio, independent of the link budget."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dechirp.core.checks import check_positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import echo_powers_w
from dechirp.simulation.impairments.base import Receiver


@frozen_dataclass
class WhiteNoise(Receiver):
    """White noise with a given ratio to one target's echo in every sample."""

    snr: float
    """Echo power over noise power in one sample, a ratio (dB in files), before any integration;
    complex samples: power of both parts together."""
    target: str | None = None
    """Name of the reference target; none: the only target of the scene."""

    def __post_init__(self) -> None:
        # Single precision cannot represent noise beyond 300 dB.
        check_positive(self, "snr", at_least=1e-30, at_most=1e30)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if the target is missing, or has no echo."""
        self.noise_power_w(scene, radar)

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        self.prepare(scene, radar)(samples, rng)

    def prepare(
        self, scene: Scene, radar: Radar
    ) -> Callable[[np.ndarray, np.random.Generator], None]:
        """Precompute the power of the noise, which takes half as long as adding it."""
        power_w = self.noise_power_w(scene, radar)
        return lambda samples, rng: add_white_noise(samples, power_w, rng)

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Return the echo power of the target at the middle of the first frame, over the ratio."""
        target = scene.find_target(self.target)
        single_target_scene = replace(scene, targets=(target,))
        echo_power_w = float(
            echo_powers_w(single_target_scene, radar, [radar.frame.mid_frame_s]).item()
        )
        if echo_power_w == 0:
            raise InvalidSetting(
                "target",
                value=f"{self.target or 'the only target'}, without an echo",
                expected="a target in the beams of both antennas",
                fix="name another target, or turn the beam towards it",
            )
        return echo_power_w / self.snr
