"""Leakage: direct coupling from transmitters to receivers."""

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import SampleWindow
from dechirp.simulation.impairments.base import Propagation


@frozen_dataclass
class Leakage(Propagation):
    """Tone of each antenna pair at the frequency S d / c, near zero range.

    Its power in each receiver is P_t / isolation. Of the oscillator's phase noise it carries the
    residue after its short delay. Mutual coupling later in the list mixes it too.

    References
    ----------
    A. Melzer, A. Onic, F. Starzer, M. Huemer, Short-range leakage cancelation in FMCW radar
    transceivers using an artificial on-chip target, IEEE J. Sel. Topics Signal Process. 9, 2015.
    """

    isolation: float
    """Transmitted over received power of each antenna pair, a ratio of at least 1, for example
    30 dB."""
    extra_length_m: float = 0.0
    """Electrical length of the path from a transmitter to a receiver beyond their distance, for
    example of a cable."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "isolation", at_most=1e30)
        if self.isolation < 1:
            raise InvalidSetting(
                "Leakage.isolation",
                value=f"{self.isolation:.4g}",
                expected="at least 0 dB, a ratio of 1",
                fix="write an isolation of 30 dB as 30 dB, not -30 dB",
            )
        check_non_negative_fields(self, "extra_length_m", at_most=1e6)

    def added_delay_bounds_s(self, radar: Radar) -> tuple[float, float]:
        lengths_m = self._path_lengths_m(radar)
        return lengths_m.min() / SPEED_OF_LIGHT, lengths_m.max() / SPEED_OF_LIGHT

    def add_signals(
        self,
        samples: np.ndarray,
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        lengths_m = self._path_lengths_m(radar)
        power_w = radar.require_hardware().transmit_power_w / self.isolation
        amplitudes = np.full(lengths_m.shape, np.sqrt(power_w))
        add_constant_path_signals(samples, window, radar, amplitudes, lengths_m)

    def _path_lengths_m(self, radar: Radar) -> np.ndarray:
        """Return the path lengths of all antenna pairs, (n_tx, n_rx)."""
        separations_m = np.array(radar.array.tx_m)[:, None] - np.array(radar.array.rx_m)
        return np.asarray(np.linalg.norm(separations_m, axis=-1) + self.extra_length_m)


def add_constant_path_signals(
    samples: np.ndarray,
    window: SampleWindow,
    radar: Radar,
    amplitudes: np.ndarray,
    path_lengths_m: np.ndarray,
) -> None:
    """Add paths of constant length to complex samples, (n_chirps, n_rx, n_times), in place.

    `amplitudes`, sqrt(W), and `path_lengths_m` are (n_tx, n_rx). See `kernels/base.py` for the
    phase. Samples taken before the wave arrives contain it all the same.
    """
    frame, chirp = radar.frame, radar.frame.chirp
    delays_s = path_lengths_m[..., None] / SPEED_OF_LIGHT
    # Chirps of one slot are equal in all rounds.
    first_chirp = int(abs(frame.chirp_starts_s - window.chirp_starts_s[0]).argmin())
    for row in range(min(frame.n_slots, len(samples))):
        slot = (first_chirp + row) % frame.n_slots
        ramp, weights = frame.ramps[slot], np.array(frame.weights[slot])
        start_hz, slope = chirp.start_frequency_hz + ramp.shift_hz, ramp.sign * chirp.slope_hz_per_s
        cycles = delays_s * (start_hz + slope * (window.times_s - delays_s / 2))
        tones = amplitudes[..., None] * np.exp(2j * np.pi * cycles)
        samples[row :: frame.n_slots] += np.tensordot(weights, tones, axes=1)
