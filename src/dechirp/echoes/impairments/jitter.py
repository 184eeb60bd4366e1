"""Aperture jitter: samples taken a little early or late."""

import numpy as np

from dechirp.core.checks import not_negative
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.analog import Reach, convolution, impulse_response, reach
from dechirp.echoes.impairments.base import Receiver
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth

# Turn of the highest beat in one standard deviation, up to which the slope alone tells enough.
_MOST_RAD = 0.3

_TOLERANCE = 5e-4  # of the slope: slow beats have little of it


@value
class Jitter(Receiver):
    r"""Each sample is taken at t + d, d normal, independent from sample to sample and receiver.

    .. math:: x(t + d) = x(t) + d \, x'(t), \quad SNR = -20 \log_{10}(2 \pi f \sigma)

    of a tone at frequency f; I and Q are taken together. The slope x' is right to 0.05 % of the
    highest one over nine tenths of the band of beats, see `analog.py`. Noise that was added before
    has a slope as well.

    References
    ----------
    R. H. Walden, Analog-to-digital converter survey and analysis, IEEE J. Sel. Areas Commun., 1999.
    W. Kester, Aperture time, aperture jitter, aperture delay time, Analog Devices MT-007.
    """

    rms_s: float
    """Standard deviation of the instants; 0.1 to 1 ps in converters."""

    def __post_init__(self) -> None:
        not_negative(self, "rms_s", at_most=1e6)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise where the highest beat turns too far meanwhile."""
        most_hz = radar.frame.chirp.max_beat_frequency_hz
        most_s = _MOST_RAD / (2 * np.pi * most_hz)
        if self.rms_s > most_s:
            raise InvalidSetting(
                "rms",
                got=f"{self.rms_s * 1e12:.4g} ps",
                need=f"at most {most_s * 1e12:.4g} ps: {_MOST_RAD} rad of the highest beat,"
                f" {most_hz / 1e6:.4g} MHz",
                fix="Check the unit: converters have 0.1 to 1 ps, as 0.5 ps.",
            )

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """(2 pi f sigma)^2 of each target's echo, in the first frame."""
        if not scene.targets:
            return 0.0
        known = truth(scene, radar, noise_power_w=radar.integration_gain).isel(frame=0)
        beat_hz = radar.frame.chirp.beat_frequency_hz(1.0) * known.range.values
        return float(np.sum((2 * np.pi * beat_hz * self.rms_s) ** 2 * known.snr.values))

    def margins(self, radar: Radar) -> tuple[int, int]:
        """Samples that the slope needs."""
        return reach(_impulse(radar.frame.chirp), _TOLERANCE)

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the slope times what each instant is off."""
        far = Reach(*self.margins(radar))
        chirps = samples.reshape(-1, *samples.shape[2:])
        slope = convolution(samples, _impulse(radar.frame.chirp), far)
        kind = samples.real.dtype.type
        at_once = max(1, 2**16 // chirps[0].size)
        for first in range(0, len(chirps), at_once):
            some = chirps[first : first + at_once]
            added = slope(some)
            added *= kind(self.rms_s) * rng.standard_normal(some.shape, kind)
            some += added


def _impulse(chirp: Chirp) -> np.ndarray:
    return impulse_response(lambda frequency_hz: 2j * np.pi * frequency_hz, chirp)
