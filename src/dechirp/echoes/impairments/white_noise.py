"""White noise at a stated signal-to-noise ratio, whatever the link budget says."""

from dataclasses import replace

import numba
import numpy as np

from dechirp.core.checks import positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.threads import in_threads
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import echo_powers_w

# Numbers that are drawn at a time.
_PIECE = 2**18


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
        add_white_noise(samples, self.noise_power_w(scene, radar), rng)

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


def add_white_noise(samples: np.ndarray, power_w: float, rng: np.random.Generator) -> None:
    """Add circular Gaussian noise of so much power to each sample, in place.

    `samples` is contiguous, of any shape. Drawn in pieces of 2^18 numbers (1 MiB), which stay
    in the cache and hold no second cube; each has a stream of its own, so that noise does not
    depend on how many threads draw it.
    """
    real = np.empty(0, samples.dtype).real.dtype.type
    std = real(np.sqrt(power_w / 2 if np.iscomplexobj(samples) else power_w))
    parts = samples.reshape(-1, copy=False).view(real)
    firsts = range(0, parts.size, _PIECE)
    # Drawn, not spawned: generators of the same state give the same noise.
    seeds = rng.integers(2**63, size=(len(firsts), 2))

    def one(job: tuple[int, np.ndarray]) -> None:
        first, seed = job
        piece = parts[first : first + _PIECE]
        noise = np.random.default_rng(seed).standard_normal(piece.size, dtype=real)
        noise *= std
        piece += noise

    in_threads(min(numba.get_num_threads(), len(firsts)), one, zip(firsts, seeds, strict=True))
