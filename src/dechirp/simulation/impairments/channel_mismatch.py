"""Gain and phase mismatch of the receivers."""

import numpy as np

from dechirp.core.checks import check_non_negative_fields, check_numbers, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.blocks import apply_to_chirp_blocks
from dechirp.simulation.frequency_response import (
    ImpulseExtent,
    impulse_response,
    make_chirp_convolver,
    significant_impulse_extent,
)
from dechirp.simulation.impairments.base import Receiver
from dechirp.simulation.impairments.dc_offset import check_one_per_receiver

# Real samples: the phase changes sign with the frequency, gradually within this distance of 0.
_TRANSITION_BAND = 1 / 32  # of the sample rate
_MAX_STDS = 4.0


@frozen_dataclass
class ChannelMismatch(Receiver):
    """Complex factor of each receiver, sqrt(gain) exp(i phase), the same in all frames.

    Random gains are log-normal and random phases normal, independent over receivers, and drawn once
    for all frames. Real samples come from a single mixer, whose phase error rotates positive and
    negative frequencies in opposite directions: within 1/32 of the sample rate of 0, the phase
    applies only partly. `PositionErrors` models errors of antenna positions, which depend on
    direction.

    References
    ----------
    B. D. Steinberg, Principles of Aperture and Array System Design, 1976, 13 (effect of gain and
    phase errors of elements on a beam).
    """

    gain_std: float = 1.0
    """Standard deviation of the power gain, a ratio of at least 1 (in files for example 0.5 dB)."""
    phase_std_rad: float = 0.0
    """Standard deviation of the phase."""
    gains: tuple[float, ...] | None = None
    """Power gain of each receiver, ratios (dB in files), in place of random ones."""
    phases_rad: tuple[float, ...] | None = None
    """Phase of each receiver, in place of random ones."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "gain_std", at_most=100.0)
        if self.gain_std < 1:
            raise InvalidSetting(
                "ChannelMismatch.gain_std",
                value=f"{self.gain_std:.4g}",
                expected="at least 0 dB, a ratio of 1",
                fix="write half a decibel as 0.5 dB (gain_std=1.122 in Python)",
            )
        check_non_negative_fields(self, "phase_std_rad", at_most=np.pi)
        if self.gains is not None:
            gains = check_numbers("ChannelMismatch.gains", self.gains, above=0.0, at_most=1e12)
            object.__setattr__(self, "gains", gains)
        if self.phases_rad is not None:
            phases_rad = check_numbers("ChannelMismatch.phases_rad", self.phases_rad)
            object.__setattr__(self, "phases_rad", phases_rad)

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise unless fixed gains and phases match the number of receivers."""
        check_one_per_receiver("gains", self.gains, radar)
        check_one_per_receiver("phases", self.phases_rad, radar)

    def sample_margins(self, radar: Radar) -> tuple[int, int]:
        """Return the margins of the phase filter of real samples; else none."""
        max_phase_rad = _MAX_STDS * self.phase_std_rad
        if self.phases_rad is not None:
            max_phase_rad = float(np.abs(self.phases_rad).max(initial=0))
        if radar.frame.chirp.sampling == "complex" or not max_phase_rad:
            return 0, 0
        return significant_impulse_extent(
            _phase_shift_impulse_response(min(max_phase_rad, np.pi / 2), radar)
        )

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        n_rx = samples.shape[2]
        normals = rng.standard_normal((2, n_rx))
        gains, phases_rad = self.gain_std ** normals[0], self.phase_std_rad * normals[1]
        if self.gains is not None:
            gains = np.array(self.gains)
        if self.phases_rad is not None:
            phases_rad = np.array(self.phases_rad)
        if np.iscomplexobj(samples):
            factors = (np.sqrt(gains) * np.exp(1j * phases_rad)).astype(samples.dtype)
        else:
            factors = np.sqrt(gains).astype(samples.dtype)
            self._shift_phases_of_real_samples(samples, phases_rad, radar)

        def scale(chirps: np.ndarray) -> None:
            chirps *= factors[:, None]

        apply_to_chirp_blocks(samples, scale)

    def _shift_phases_of_real_samples(
        self, samples: np.ndarray, phases_rad: np.ndarray, radar: Radar
    ) -> None:
        """Shift the phases of real samples by a filter."""
        if not phases_rad.any():
            return
        impulses = np.stack(
            [_phase_shift_impulse_response(phase_rad, radar) for phase_rad in phases_rad]
        )
        shift_phases = make_chirp_convolver(
            samples, impulses, ImpulseExtent(*self.sample_margins(radar))
        )

        def turn(chirps: np.ndarray) -> None:
            chirps[...] = shift_phases(chirps)

        apply_to_chirp_blocks(samples, turn)


def _phase_shift_impulse_response(phase_rad: float, radar: Radar) -> np.ndarray:
    """Return the impulse response that shifts positive frequencies by a phase.

    Negative frequencies are shifted by the opposite phase.
    """
    chirp = radar.frame.chirp

    def response(frequency_hz: np.ndarray) -> np.ndarray:
        fraction = np.clip(frequency_hz / (_TRANSITION_BAND * chirp.sample_rate_hz), -1, 1)
        return np.cos(phase_rad) + 1j * np.sin(phase_rad) * np.sin(np.pi / 2 * fraction)

    return impulse_response(response, chirp)
