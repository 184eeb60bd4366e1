"""Receiver noise: white at a given SNR, thermal (k T0 F fs a sample), or of a given density."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from dechirp.core.checks import check_numbers, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.values import frozen_dataclass
from dechirp.radar.budget import noise_power_w
from dechirp.radar.chirp import Chirp
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
        check_positive_fields(self, "snr", at_least=1e-30, at_most=1e30)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise if the target is missing, or has no echo."""
        self.noise_power_w(scene, radar)

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        self.make_sample_operation(scene, radar)(samples, rng)

    def make_sample_operation(
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


_BLOCK_SAMPLES = 2**20  # samples with spectra in memory
_N_FREQUENCIES = 2**13  # frequencies of the mean power


@frozen_dataclass
class ColouredNoise(Receiver):
    """Gaussian noise of a given density over beat frequency, independent in each chirp.

    It is stationary within a chirp, like noise behind settled filters. The density is linear in
    decibels between the given frequencies, and constant beyond them. Beat frequencies range from 0
    to
    the sample rate for complex samples, and to half of it for real ones.
    """

    beat_hz: tuple[float, ...]
    """Frequencies of the density values, ascending."""
    level: tuple[float, ...]
    """Density at each frequency over that of thermal noise, k T0 F: ratios (dB in files)."""

    def __post_init__(self) -> None:
        beats_hz = check_numbers("ColouredNoise.beat_hz", self.beat_hz, at_least=0.0, at_most=1e13)
        levels = check_numbers("ColouredNoise.level", self.level, at_least=1e-15, at_most=1e15)
        if not beats_hz or np.any(np.diff(beats_hz) <= 0):
            raise InvalidSetting(
                "ColouredNoise.beat_hz",
                value=list(beats_hz),
                expected="at least one frequency, in ascending order",
                fix="sort them, with the levels in the same order",
            )
        if len(levels) != len(beats_hz):
            raise InvalidSetting(
                "ColouredNoise.level",
                value=f"{len(levels)} levels for {len(beats_hz)} frequencies",
                expected="one level for each frequency of beat",
                fix="give both lists the same length",
            )
        object.__setattr__(self, "beat_hz", beats_hz)
        object.__setattr__(self, "level", levels)

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Return the mean density over the band, times the power of thermal noise."""
        return float(
            self._densities_over_thermal(radar.frame.chirp, _N_FREQUENCIES).mean()
            * noise_power_w(radar)
        )

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        chirp = radar.frame.chirp
        is_real, n_samples = not np.iscomplexobj(samples), samples.shape[-1]
        # Noise of a transform is periodic, so the period is twice the needed length.
        n_points = 2 * int(scipy.fft.next_fast_len(n_samples, real=True))
        gains = np.sqrt(noise_power_w(radar) * self._densities_over_thermal(chirp, n_points))
        if is_real:  # the other half of the spectrum is its mirror image
            gains = gains[: len(gains) // 2 + 1]
        gains = gains.astype(samples.real.dtype)
        chirps = samples.reshape(-1, *samples.shape[2:])
        block_length = max(1, _BLOCK_SAMPLES // (n_points * chirps.shape[1]))
        for first in range(0, len(chirps), block_length):
            block = chirps[first : first + block_length]
            noise = np.zeros((*block.shape[:-1], n_points), samples.dtype)
            add_white_noise(noise, 1.0, rng)
            if is_real:
                noise = scipy.fft.irfft(scipy.fft.rfft(noise, overwrite_x=True) * gains, n_points)
            else:
                noise = scipy.fft.ifft(
                    scipy.fft.fft(noise, overwrite_x=True) * gains, overwrite_x=True
                )
            block += noise[..., :n_samples]

    def _densities_over_thermal(self, chirp: Chirp, n_points: int) -> np.ndarray:
        """Return the density over that of thermal noise at each FFT bin, (n_points,)."""
        beats_hz = np.arange(n_points) * (chirp.sample_rate_hz / n_points)
        if chirp.sampling == "real":
            beats_hz = np.minimum(beats_hz, chirp.sample_rate_hz - beats_hz)
        levels_db = np.interp(beats_hz, self.beat_hz, 10 * np.log10(self.level))
        return np.asarray(10 ** (levels_db / 10))
