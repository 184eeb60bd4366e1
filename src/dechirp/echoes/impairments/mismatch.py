"""Receivers that are not alike: gain and phase of each."""

import numpy as np

from dechirp.core.checks import not_negative, positive, series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.analog import Reach, convolution, impulse_response, reach
from dechirp.echoes.impairments.base import Receiver
from dechirp.echoes.impairments.dc_offset import must_be_for_each_receiver
from dechirp.echoes.pieces import in_pieces
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

# Real samples: phases turn with the sign of the frequency, gradually within this much of 0.
_BAND = 1 / 32  # of the sample rate
_MOST_STDS = 4.0


@value
class Mismatch(Receiver):
    """A complex factor of each receiver, sqrt(gain) exp(i phase), the same in all frames.

    Gains are log-normal and phases normal where they are drawn: each by itself, once for all
    frames. Real samples are of one mixer, whose phase error turns positive and negative
    frequencies in opposite ways: within 1/32 of the sample rate of 0 the phase is only partly
    there. Errors of antenna places are another matter, `PositionErrors`: they depend on direction.

    References
    ----------
    B. D. Steinberg, Principles of Aperture and Array System Design, 1976, 13 (what gain and phase
    errors of elements do to a beam).
    """

    gain_std: float = 1.0
    """Standard deviation of the power gain, a ratio of at least 1: 0.5 dB in files."""
    phase_std_rad: float = 0.0
    """Standard deviation of the phase."""
    gains: tuple[float, ...] | None = None
    """Power gain of each receiver, ratios (dB in files), instead of drawn ones."""
    phases_rad: tuple[float, ...] | None = None
    """Phase of each receiver, instead of drawn ones."""

    def __post_init__(self) -> None:
        positive(self, "gain_std", at_most=100.0)
        if self.gain_std < 1:
            raise InvalidSetting(
                "Mismatch.gain_std",
                got=f"{self.gain_std:.4g}",
                need="a ratio of at least 1 (0 dB)",
                fix="Half a decibel is written 0.5 dB, or 1.122.",
            )
        not_negative(self, "phase_std_rad", at_most=np.pi)
        if self.gains is not None:
            gains = series("Mismatch.gains", self.gains, above=0.0, at_most=1e12)
            object.__setattr__(self, "gains", gains)
        if self.phases_rad is not None:
            phases_rad = series("Mismatch.phases_rad", self.phases_rad)
            object.__setattr__(self, "phases_rad", phases_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless what is given is for each receiver."""
        must_be_for_each_receiver("gains", self.gains, radar)
        must_be_for_each_receiver("phases", self.phases_rad, radar)

    def margins(self, radar: Radar) -> tuple[int, int]:
        """None but for phases of real samples."""
        most_rad = _MOST_STDS * self.phase_std_rad
        if self.phases_rad is not None:
            most_rad = float(np.abs(self.phases_rad).max(initial=0))
        if radar.frame.chirp.sampling == "complex" or not most_rad:
            return 0, 0
        return reach(_turn(min(most_rad, np.pi / 2), radar))

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Multiply the samples of each receiver by its factor."""
        n_rx = samples.shape[2]
        drawn = rng.standard_normal((2, n_rx))
        gains, phases_rad = self.gain_std ** drawn[0], self.phase_std_rad * drawn[1]
        if self.gains is not None:
            gains = np.array(self.gains)
        if self.phases_rad is not None:
            phases_rad = np.array(self.phases_rad)
        if np.iscomplexobj(samples):
            factors = (np.sqrt(gains) * np.exp(1j * phases_rad)).astype(samples.dtype)
        else:
            factors = np.sqrt(gains).astype(samples.dtype)
            self._turn(samples, phases_rad, radar)

        def scale(chirps: np.ndarray) -> None:
            chirps *= factors[:, None]

        in_pieces(samples, scale)

    def _turn(self, samples: np.ndarray, phases_rad: np.ndarray, radar: Radar) -> None:
        """Turn the phases of real samples."""
        if not phases_rad.any():
            return
        impulses = np.stack([_turn(phase_rad, radar) for phase_rad in phases_rad])
        convolved = convolution(samples, impulses, Reach(*self.margins(radar)))

        def turn(chirps: np.ndarray) -> None:
            chirps[...] = convolved(chirps)

        in_pieces(samples, turn)


def _turn(phase_rad: float, radar: Radar) -> np.ndarray:
    """Response of real samples that turns positive frequencies by a phase, negative ones back."""
    chirp = radar.frame.chirp

    def response(frequency_hz: np.ndarray) -> np.ndarray:
        away = np.clip(frequency_hz / (_BAND * chirp.sample_rate_hz), -1, 1)
        return np.cos(phase_rad) + 1j * np.sin(phase_rad) * np.sin(np.pi / 2 * away)

    return impulse_response(response, chirp)
