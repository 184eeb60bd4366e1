"""Leakage: what is sent goes straight into the receivers."""

import numpy as np

from dechirp.core.checks import not_negative, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@value
class Leakage(Propagation):
    """A tone for each pair of antennas, at the frequency S d / c, near zero range.

    Of the power P_t / isolation in each receiver. Of the oscillator's phase noise it carries
    what is left after so short a delay. Coupling that is listed after it mixes it too.

    References
    ----------
    A. Melzer, A. Onic, F. Starzer, M. Huemer, Short-range leakage cancelation in FMCW radar
    transceivers using an artificial on-chip target, IEEE J. Sel. Topics Signal Process. 9, 2015.
    """

    isolation: float
    """Power sent over power received, of each pair of antennas, a ratio of at least 1,
    as 30 dB."""
    extra_length_m: float = 0.0
    """Of the way from a transmitter to a receiver beyond the distance between them, as in a
    cable; the electrical length."""

    def __post_init__(self) -> None:
        positive(self, "isolation", at_most=1e30)
        if self.isolation < 1:
            raise InvalidSetting(
                "Leakage.isolation",
                got=f"{self.isolation:.4g}",
                need="a ratio of at least 1 (0 dB)",
                fix="An isolation of 30 dB is written 30 dB, not -30 dB.",
            )
        not_negative(self, "extra_length_m", at_most=1e6)

    def added_delays_s(self, radar: Radar) -> tuple[float, float]:
        """Those of all pairs."""
        lengths_m = self._lengths_m(radar)
        return lengths_m.min() / SPEED_OF_LIGHT, lengths_m.max() / SPEED_OF_LIGHT

    def add(
        self,
        samples: np.ndarray,
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Add the tones of all pairs."""
        lengths_m = self._lengths_m(radar)
        power_w = radar.known_hardware().transmit_power_w / self.isolation
        amplitudes = np.full(lengths_m.shape, np.sqrt(power_w))
        add_pairs(samples, window, radar, amplitudes, lengths_m)

    def _lengths_m(self, radar: Radar) -> np.ndarray:
        """(n_tx, n_rx)."""
        between_m = np.array(radar.array.tx_m)[:, None] - np.array(radar.array.rx_m)
        return np.asarray(np.linalg.norm(between_m, axis=-1) + self.extra_length_m)


def add_pairs(
    samples: np.ndarray,
    window: Window,
    radar: Radar,
    amplitudes: np.ndarray,
    lengths_m: np.ndarray,
) -> None:
    """Add ways of constant lengths to samples, (n_chirps, n_rx, n_times), complex, in place.

    `amplitudes`, sqrt(W), and `lengths_m`: (n_tx, n_rx). See `kernels/base.py` for the phase.
    They are held in samples that are taken before they arrive.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    delays_s = lengths_m[..., None] / SPEED_OF_LIGHT
    # Chirps of one slot of the round are alike.
    first = int(abs(frame.chirps_s - window.starts_s[0]).argmin())
    for row in range(min(frame.n_slots, len(samples))):
        slot = (first + row) % frame.n_slots
        ramp, weights = frame.ramps[slot], np.array(frame.weights[slot])
        start_hz, slope = chirp.start_frequency_hz + ramp.shift_hz, ramp.sign * chirp.slope_hz_per_s
        cycles = delays_s * (start_hz + slope * (window.times_s - delays_s / 2))
        tones = amplitudes[..., None] * np.exp(2j * np.pi * cycles)
        samples[row :: frame.n_slots] += np.tensordot(weights, tones, axes=1)
