"""A frame: equal chirps at equal intervals, processed together."""

import numpy as np

from dechirp.core.checks import count, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.chirp import Chirp
from dechirp.radar.multiplexing.base import Multiplexing


@value
class Frame:
    """The chirps of one coherent interval, and how often it comes.

    Velocities use the wavelength at the middle of the sampling window.
    """

    chirp: Chirp
    n_chirps: int
    """Chirps of each transmitter; one alone tells no velocity. Under a code in which
    transmitters send together: how often the code repeats, 1 where it is as long as the frame."""
    interval_s: float
    """From the start of a chirp to the start of the next, whichever transmitter sends it."""
    period_s: float | None = None
    """From the start of a frame to the start of the next; none: without a gap."""
    multiplexing: Multiplexing | None = None
    """How transmitters share the chirps; none: one transmitter sends them all."""

    def __post_init__(self) -> None:
        count(self, "n_chirps")
        positive(self, "interval_s", at_least=1e-12, at_most=1e6)  # the bounds of a ramp
        if self.interval_s < self.chirp.ramp_duration_s * (1 - 1e-9):
            raise InvalidSetting(
                "Frame.interval_s",
                got=f"{self.interval_s:.6g} s",
                need=f"at least {self.chirp.ramp_duration_s:.6g} s, the duration of the ramp",
                fix="Lengthen the interval or shorten the ramp.",
            )
        if not isinstance(self.multiplexing, Multiplexing | None):
            raise InvalidSetting(
                "Frame.multiplexing",
                got=self.multiplexing,
                need="a member of the family, or none",
                fix="Give Tdm(order=(0, 1)) where two transmitters take turns.",
            )
        if self.period_s is None:
            return
        positive(self, "period_s", at_least=1e-12, at_most=1e6)
        if self.period_s < self.duration_s * (1 - 1e-9):
            raise InvalidSetting(
                "Frame.period_s",
                got=f"{self.period_s:.6g} s",
                need=f"at least {self.duration_s:.6g} s, the time the chirps take",
                fix="Lengthen the period, or send fewer chirps at a shorter interval.",
            )

    @property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """Factor of each transmitter's echo in each slot of a round, (n_slots, n_tx).

        See `Multiplexing.weights`; without multiplexing one transmitter sends in every chirp.
        """
        return ((1 + 0j,),) if self.multiplexing is None else self.multiplexing.weights

    def sent_weights(self) -> np.ndarray:
        """Factor of each transmitter's echo in each chirp of the frame, (n_sent, n_tx) complex."""
        return np.tile(np.array(self.weights, np.complex128), (self.n_chirps, 1))

    @property
    def slots(self) -> tuple[tuple[int, ...], ...]:
        """Transmitters that send in each slot of a round; the first alone without multiplexing."""
        return ((0,),) if self.multiplexing is None else self.multiplexing.slots

    @property
    def turns(self) -> tuple[int, ...] | None:
        """Transmitter of each slot where they take turns, each once; none under other codes."""
        alone = tuple(slot[0] for slot in self.slots if len(slot) == 1)
        return alone if len(set(alone)) == self.n_slots else None

    @property
    def n_slots(self) -> int:
        """Chirps in a round of the transmitters, 1 without multiplexing."""
        return len(self.weights)

    @property
    def n_sent(self) -> int:
        """All chirps of the frame, n_chirps x n_slots."""
        return self.n_chirps * self.n_slots

    @property
    def repetition_s(self) -> float:
        """From a chirp of a transmitter to its next; under a code from round to round."""
        return self.n_slots * self.interval_s

    @property
    def duration_s(self) -> float:
        """From the start of the first chirp to the end of the last interval."""
        return self.n_sent * self.interval_s

    @property
    def mid_frame_s(self) -> float:
        """Mean of all sampling instants, from the start of the frame.

        Estimates and truth refer to this instant.
        """
        return (self.n_sent - 1) / 2 * self.interval_s + self.chirp.mid_window_s

    @property
    def velocity_resolution_m_per_s(self) -> float:
        """Width of a velocity bin, lambda / 2 M T, T from a chirp of a transmitter to its next."""
        return self.chirp.wavelength_m / (2 * self.duration_s)

    @property
    def max_velocity_m_per_s(self) -> float:
        """Largest unambiguous velocity of either sign, lambda / 4T, T as above."""
        return self.chirp.wavelength_m / (4 * self.repetition_s)

    def velocity_bins_m_per_s(self, n_bins: int | None = None) -> np.ndarray:
        """Velocity of each bin of a Doppler spectrum of n_bins points; none: n_chirps.

        (n_bins,), ascending from minus the largest velocity in steps of lambda / 2 n_bins T,
        zero at n_bins // 2.
        """
        doppler_hz = np.fft.fftshift(np.fft.fftfreq(n_bins or self.n_chirps, self.repetition_s))
        return doppler_hz * self.chirp.wavelength_m / 2

    def start_s(self, index: int) -> float:
        """Start of a frame, counted from 0."""
        return index * (self.duration_s if self.period_s is None else self.period_s)
