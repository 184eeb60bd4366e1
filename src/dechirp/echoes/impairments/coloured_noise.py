"""Noise that is not white over the beat frequencies: as filters and phase noise leave it."""

import numpy as np
from scipy import fft

from dechirp.core.checks import series
from dechirp.core.errors import InvalidSetting
from dechirp.core.normal import add_white_noise
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.radar.budget import noise_power_w
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

_AT_ONCE = 2**20  # samples whose spectra are held
_GRID = 2**13  # frequencies over which the mean power is taken


@value
class ColouredNoise(Receiver):
    """Gaussian noise of a given density over beat frequency, chirp by chirp by itself.

    Stationary within a chirp, as noise is that comes through filters which have settled. Its
    density is straight in decibels between the frequencies that are given, and constant beyond
    them. Beats run from 0 to the sample rate for complex samples, to half of it for real ones.
    """

    beat_hz: tuple[float, ...]
    """Frequencies at which the density is given, ascending."""
    level: tuple[float, ...]
    """Density at each over that of thermal noise, k T0 F: ratios (dB in files)."""

    def __post_init__(self) -> None:
        beats_hz = series("ColouredNoise.beat_hz", self.beat_hz, at_least=0.0, at_most=1e13)
        levels = series("ColouredNoise.level", self.level, at_least=1e-15, at_most=1e15)
        if not beats_hz or np.any(np.diff(beats_hz) <= 0):
            raise InvalidSetting(
                "ColouredNoise.beat_hz",
                got=list(beats_hz),
                need="one frequency or more, ascending",
                fix="Sort them, with the levels in the same order.",
            )
        if len(levels) != len(beats_hz):
            raise InvalidSetting(
                "ColouredNoise.level",
                got=f"{len(levels)} levels for {len(beats_hz)} frequencies",
                need="one for each of beat",
                fix="Give as many of the one as of the other.",
            )
        object.__setattr__(self, "beat_hz", beats_hz)
        object.__setattr__(self, "level", levels)

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Mean of the density over the band, times that of thermal noise."""
        return float(self._densities(radar.frame.chirp, _GRID).mean() * noise_power_w(radar))

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Add the noise to every sample."""
        chirp = radar.frame.chirp
        is_real, n_samples = not np.iscomplexobj(samples), samples.shape[-1]
        # Noise repeats after so many points, so twice what is wanted.
        n_points = 2 * int(fft.next_fast_len(n_samples, real=True))
        gains = np.sqrt(noise_power_w(radar) * self._densities(chirp, n_points))
        if is_real:  # the other half of the spectrum is the mirror of this one
            gains = gains[: len(gains) // 2 + 1]
        gains = gains.astype(samples.real.dtype)
        chirps = samples.reshape(-1, *samples.shape[2:])
        at_once = max(1, _AT_ONCE // (n_points * chirps.shape[1]))
        for first in range(0, len(chirps), at_once):
            own = chirps[first : first + at_once]
            noise = np.zeros((*own.shape[:-1], n_points), samples.dtype)
            add_white_noise(noise, 1.0, rng)
            if is_real:
                noise = fft.irfft(fft.rfft(noise, overwrite_x=True) * gains, n_points)
            else:
                noise = fft.ifft(fft.fft(noise, overwrite_x=True) * gains, overwrite_x=True)
            own += noise[..., :n_samples]

    def _densities(self, chirp: Chirp, n_points: int) -> np.ndarray:
        """Density at each frequency of a transform, over that of thermal noise, (n_points,)."""
        beats_hz = np.arange(n_points) * (chirp.sample_rate_hz / n_points)
        if chirp.sampling == "real":
            beats_hz = np.minimum(beats_hz, chirp.sample_rate_hz - beats_hz)
        levels_db = np.interp(beats_hz, self.beat_hz, 10 * np.log10(self.level))
        return np.asarray(10 ** (levels_db / 10))
