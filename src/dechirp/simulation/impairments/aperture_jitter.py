"""Aperture jitter: random errors of the sampling instants."""

import numpy as np

from dechirp.core.checks import check_non_negative_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.truth import truth
from dechirp.simulation.frequency_response import (
    ImpulseExtent,
    impulse_response,
    make_chirp_convolver,
    significant_impulse_extent,
)
from dechirp.simulation.impairments.base import Receiver

# Phase of the highest beat in one standard deviation, up to which the slope alone suffices.
_MAX_PHASE_RAD = 0.3

_TOLERANCE = 5e-4  # of the slope, which is small for slow beats


@frozen_dataclass
class ApertureJitter(Receiver):
    r"""Random sampling instants t + d, with d normal and independent over samples and receivers.

    .. math:: x(t + d) = x(t) + d \, x'(t), \quad SNR = -20 \log_{10}(2 \pi f \sigma)

    for a tone at frequency f; I and Q are sampled at the same instants. The slope x' is accurate to
    0.05 % of the largest one over nine tenths of the band of beats, see `frequency_response.py`.
    Noise
    added earlier in the list has a slope as well.

    References
    ----------
    R. H. Walden, Analog-to-digital converter survey and analysis, IEEE J. Sel. Areas Commun., 1999.
    W. Kester, Aperture time, aperture jitter, aperture delay time, Analog Devices MT-007.
    """

    rms_s: float
    """Standard deviation of the instants; 0.1 to 1 ps in common ADCs."""

    def __post_init__(self) -> None:
        check_non_negative_fields(self, "rms_s", at_most=1e6)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if the phase error of the highest beat is too large."""
        max_beat_hz = radar.frame.chirp.max_beat_frequency_hz
        max_rms_s = _MAX_PHASE_RAD / (2 * np.pi * max_beat_hz)
        if self.rms_s > max_rms_s:
            raise InvalidSetting(
                "rms",
                value=f"{self.rms_s * 1e12:.4g} ps",
                expected=f"at most {max_rms_s * 1e12:.4g} ps: {_MAX_PHASE_RAD} rad of the highest"
                f" beat, {max_beat_hz / 1e6:.4g} MHz",
                fix="check the unit: ADCs have 0.1 to 1 ps, for example 0.5 ps",
            )

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Return the sum over targets of (2 pi f sigma)^2 times the echo power, in frame 0."""
        if not scene.targets:
            return 0.0
        truth_table = truth(scene, radar, noise_power_w=radar.integration_gain).isel(frame=0)
        beat_hz = radar.frame.chirp.beat_frequency_hz(1.0) * truth_table.range.values
        return float(np.sum((2 * np.pi * beat_hz * self.rms_s) ** 2 * truth_table.snr.values))

    def sample_margins(self, radar: Radar) -> tuple[int, int]:
        return significant_impulse_extent(
            _derivative_impulse_response(radar.frame.chirp), _TOLERANCE
        )

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the slope times the error of each instant."""
        extent = ImpulseExtent(*self.sample_margins(radar))
        chirps = samples.reshape(-1, *samples.shape[2:])
        slope = make_chirp_convolver(
            samples, _derivative_impulse_response(radar.frame.chirp), extent
        )
        real_type = samples.real.dtype.type
        block_length = max(1, 2**16 // chirps[0].size)
        for first in range(0, len(chirps), block_length):
            block = chirps[first : first + block_length]
            errors = slope(block)
            errors *= real_type(self.rms_s) * rng.standard_normal(block.shape, real_type)
            block += errors


def _derivative_impulse_response(chirp: Chirp) -> np.ndarray:
    """Return the impulse response of the time derivative."""
    return impulse_response(lambda frequency_hz: 2j * np.pi * frequency_hz, chirp)
