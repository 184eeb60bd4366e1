"""White noise at a stated signal-to-noise ratio, whatever the link budget says."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.normal import add_white_noise
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import echo_powers_w


@value
class WhiteNoise(Receiver):
    """Noise so strong that one target's echo has the given ratio in every sample."""

    snr: float
    """Echo power over noise power in one sample, a ratio (dB in files), before any
    integration; complex samples: power of both parts together."""
    target: str | None = None
    """Name of the target whose echo is meant; none: the only one there is."""

    def __post_init__(self) -> None:
        # 300 dB either way: beyond, single precision has no such noise.
        positive(self, "snr", at_least=1e-30, at_most=1e30)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where the target is not there, or has no echo."""
        self.noise_power_w(scene, radar)

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the noise to every sample."""
        self.prepared(scene, radar)(samples, rng)

    def prepared(
        self, scene: Scene, radar: Radar
    ) -> Callable[[np.ndarray, np.random.Generator], None]:
        """Find the power of the noise, which takes as long as half of the noise itself."""
        power_w = self.noise_power_w(scene, radar)
        return lambda samples, rng: add_white_noise(samples, power_w, rng)

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Echo power of the target at the middle of the first frame, over the ratio."""
        target = scene.target(self.target)
        alone = replace(scene, targets=(target,))
        echo_w = float(echo_powers_w(alone, radar, [radar.frame.mid_frame_s]).item())
        if echo_w == 0:
            raise InvalidSetting(
                "target",
                got=f"{self.target or 'the only one'}, without an echo",
                need="one that both antennas see",
                fix="Name another target, or turn the beam towards it.",
            )
        return echo_w / self.snr
