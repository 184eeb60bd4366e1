"""A frame: chirps in equal rounds at equal intervals, processed together."""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from dechirp.core.checks import count, listed, number, positive, series
from dechirp.core.displayed import Displayed, Table, follows, settings, several
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.core.words import in_unit
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp
from dechirp.radar.multiplexing.base import Multiplexing

_MOST_FOLDS = 64
_ALIKE = 0.02  # of a cycle: 7 degrees, by which noise turns two slots of 18 dB


@value
class Frame(Displayed):
    """The chirps of one coherent interval, and how often it comes.

    Velocities use the wavelength at the middle of the sampling window.
    """

    chirp: Chirp
    n_chirps: int
    """Chirps of each transmitter; one alone tells no velocity. Under a code in which
    transmitters send together: how often the code repeats, 1 where it is as long as the frame;
    under a modulation: rounds of its ramps."""
    interval_s: float | tuple[float, ...]
    """From the start of a chirp to the start of the next, whichever transmitter sends it; a
    list: one for each frame in turn, see `at`."""
    period_s: float | None = None
    """From the start of a frame to the start of the next; none: without a gap."""
    multiplexing: Multiplexing | None = None
    """How transmitters share the chirps; none: one transmitter sends them all."""
    modulation: Modulation | None = None
    """How the ramps of a round differ, all sent by one transmitter; none: all are alike."""

    def __post_init__(self) -> None:
        count(self, "n_chirps")
        self._check_intervals()
        if not isinstance(self.multiplexing, Multiplexing | None):
            raise InvalidSetting(
                "Frame.multiplexing",
                got=self.multiplexing,
                need="a member of the family, or none",
                fix="Give Tdm(order=(0, 1)) where two transmitters take turns.",
            )
        self._check_modulation()
        if self.period_s is None:
            return
        positive(self, "period_s", at_least=1e-12, at_most=1e6)
        longest_s = max(self.at(index).duration_s for index in range(self.n_intervals))
        if self.period_s < longest_s * (1 - 1e-9):
            raise InvalidSetting(
                "Frame.period_s",
                got=f"{self.period_s:.10g} s",
                need=f"at least {longest_s:.10g} s, the time the chirps take",
                fix="Lengthen the period, or send fewer chirps at a shorter interval.",
            )

    def _check_intervals(self) -> None:
        intervals_s = listed(self.interval_s)
        if intervals_s is None:
            positive(self, "interval_s", at_least=1e-12, at_most=1e6)  # the bounds of a ramp
            named = [("Frame.interval_s", number("Frame.interval_s", self.interval_s))]
        else:
            kept = series("Frame.interval_s", intervals_s, at_least=1e-12, at_most=1e6)
            object.__setattr__(self, "interval_s", kept)
            named = [(f"Frame.interval_s.{place}", one_s) for place, one_s in enumerate(kept)]
            if len(kept) < 2:
                raise InvalidSetting(
                    "Frame.interval_s",
                    got=f"a list of {len(kept)}",
                    need="two or more, one for each frame in turn",
                    fix="Write one interval without brackets.",
                )
        for where, interval_s in named:
            if interval_s < self.chirp.ramp_duration_s * (1 - 1e-9):
                raise InvalidSetting(
                    where,
                    got=f"{interval_s:.10g} s",
                    need=f"at least {self.chirp.ramp_duration_s:.10g} s, the duration of the ramp",
                    fix="Lengthen the interval or shorten the ramp.",
                )

    def _check_modulation(self) -> None:
        if not isinstance(self.modulation, Modulation | None):
            raise InvalidSetting(
                "Frame.modulation",
                got=self.modulation,
                need="a member of the family, or none",
                fix="Give Triangular() for ramps that rise and fall in turns.",
            )
        if self.modulation is not None and self.multiplexing is not None:
            raise InvalidSetting(
                "Frame.modulation",
                got=f"{self.modulation.kind()}, with multiplexing of kind"
                f" {self.multiplexing.kind()}",
                need="one or the other: ramps that differ are all sent by one transmitter",
                fix="Leave one of the two out.",
            )
        lowest_hz = self.chirp.start_frequency_hz + min(ramp.shift_hz for ramp in self.ramps)
        if lowest_hz <= 0:
            raise InvalidSetting(
                "Frame.modulation",
                got=f"a ramp that starts at {lowest_hz:.6g} Hz",
                need="frequencies above 0",
                fix="Lower the step.",
            )

    @property
    def n_intervals(self) -> int:
        """Frames after which the intervals begin again: 1 where all frames have the same."""
        return len(self.interval_s) if isinstance(self.interval_s, tuple) else 1

    def at(self, index: int) -> "Frame":
        """A frame, counted from 0, with the one interval that it has.

        What depends on the interval is asked of this where it is a list.
        """
        if not isinstance(self.interval_s, tuple):
            return self
        return replace(self, interval_s=self.interval_s[index % len(self.interval_s)])

    @property
    def only_interval_s(self) -> float:
        """The interval, where all frames have the same; `InvalidSetting` where they have not."""
        if not isinstance(self.interval_s, tuple):
            return self.interval_s
        raise InvalidSetting(
            "Frame.interval_s",
            got=f"a list: {', '.join(f'{one_s:.6g} s' for one_s in self.interval_s)}",
            need="one interval: this is about one frame",
            fix="Take the radar as it is in one of the frames: radar.at(0).",
        )

    @cached_property
    def ramps(self) -> tuple[Ramp, ...]:
        """What sets the ramp of each slot of a round apart from `chirp`."""
        if self.modulation is not None:
            return self.modulation.ramps(self.chirp)
        return (Ramp(),) * (1 if self.multiplexing is None else len(self.multiplexing.weights))

    @property
    def ramps_are_alike(self) -> bool:
        """Whether all ramps are as `chirp` says, whenever they are sent."""
        return all(ramp.sign == 1 and ramp.shift_hz == 0 for ramp in self.ramps)

    @property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """Factor of each transmitter's echo in each slot of a round, (n_slots, n_tx).

        See `Multiplexing.weights`; without multiplexing one transmitter sends in every chirp.
        """
        if self.multiplexing is None:
            return ((1 + 0j,),) * len(self.ramps)
        return self.multiplexing.weights

    def sent_weights(self) -> np.ndarray:
        """Factor of each transmitter's echo in each chirp of the frame, (n_sent, n_tx) complex."""
        return np.tile(np.array(self.weights, np.complex128), (self.n_chirps, 1))

    @property
    def slots(self) -> tuple[tuple[int, ...], ...]:
        """Transmitters that send in each slot of a round; the first alone without multiplexing."""
        return ((0,),) * len(self.ramps) if self.multiplexing is None else self.multiplexing.slots

    @property
    def turns(self) -> tuple[int, ...] | None:
        """Transmitter of each slot where they take turns, each once; none under other codes."""
        alone = tuple(slot[0] for slot in self.slots if len(slot) == 1)
        return alone if len(set(alone)) == self.n_slots else None

    @property
    def n_slots(self) -> int:
        """Chirps in a round of the transmitters or of the ramps; 1 without either."""
        return len(self.ramps)

    @property
    def n_sent(self) -> int:
        """All chirps of the frame, n_chirps x n_slots."""
        return self.n_chirps * self.n_slots

    @property
    def slots_s(self) -> np.ndarray:
        """Start of each slot, since that of its round, (n_slots,)."""
        after_s = [self.only_interval_s + ramp.pause_s for ramp in self.ramps]
        return np.concatenate([[0.0], np.cumsum(after_s)[:-1]])

    @property
    def turning_s(self) -> np.ndarray:
        """By what a Doppler frequency turns each slot against the first, (n_slots,).

        Its start, less the time that ramps of another frequency take to get there: for one
        beat frequency, a higher Doppler frequency is a shorter delay.
        """
        shift_hz = np.array([ramp.shift_hz for ramp in self.ramps])
        return self.slots_s - (shift_hz - shift_hz[0]) / self.chirp.slope_hz_per_s

    @cached_property
    def n_folds(self) -> int:
        """Folds of velocity that turn slots differently: n_slots where they come evenly.

        The least number after which all slots turn alike again, within 0.02 of a cycle; at
        most 64, or n_slots.
        """
        most = max(_MOST_FOLDS, self.n_slots)
        cycles = np.outer(np.arange(1, most + 1), self.turning_s / self.repetition_s)
        again = np.flatnonzero(np.all(abs(cycles - np.rint(cycles)) <= _ALIKE, axis=1))
        return 1 + int(again[0]) if again.size else most

    def n_folds_in_turn(self, index: int) -> int:
        """Folds of the velocity in one frame that frames of all intervals tell together.

        As many as the greatest common divisor of the repetitions goes into its own, 64 at most;
        1 where all frames have the same interval.
        """
        frames = [self.at(place) for place in range(self.n_intervals)]
        together_s = math.gcd(*(round(one.repetition_s * 1e12) for one in frames)) * 1e-12
        return min(round(self.at(index).repetition_s / together_s), _MOST_FOLDS)

    @property
    def falls(self) -> bool:
        """Whether some of its ramps do."""
        return any(ramp.sign < 0 for ramp in self.ramps)

    @property
    def tells_velocity(self) -> bool:
        """Whether several chirps do, or a ramp that rises and one that falls."""
        return self.n_chirps > 1 or self.falls

    @property
    def chirps_s(self) -> np.ndarray:
        """Start of each chirp, since that of the frame, (n_sent,)."""
        if not any(ramp.pause_s for ramp in self.ramps):
            return self.only_interval_s * np.arange(self.n_sent)
        rounds_s = self.repetition_s * np.arange(self.n_chirps)
        return np.ravel(rounds_s[:, None] + self.slots_s)

    @property
    def repetition_s(self) -> float:
        """From a chirp of a transmitter to its next; under a code from round to round."""
        return self.n_slots * self.only_interval_s + sum(ramp.pause_s for ramp in self.ramps)

    @property
    def duration_s(self) -> float:
        """From the start of the first chirp to the end of the last interval."""
        return self.n_chirps * self.repetition_s

    @property
    def mid_frame_s(self) -> float:
        """Mean of all sampling instants, from the start of the frame.

        Estimates and truth refer to this instant.
        """
        slots_s = float(self.slots_s.mean())
        return (self.n_chirps - 1) / 2 * self.repetition_s + slots_s + self.chirp.mid_window_s

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
        if self.period_s is not None:
            return index * self.period_s
        turns, left = divmod(index, self.n_intervals)
        lasts_s = [self.at(place).duration_s for place in range(self.n_intervals)]
        return turns * sum(lasts_s) + sum(lasts_s[:left])

    def _line(self) -> str:
        sent = several(self.n_sent, "chirp")
        if self.n_slots > 1:
            sent += f" in {several(self.n_chirps, 'round')}"
        return f"{sent} of {several(self.chirp.n_samples, 'sample')}{self._seen()}"

    def _seen(self) -> str:
        """Velocities, of the first frame where intervals differ; empty where there are none."""
        if self.n_chirps == 1:
            return ""
        first = self.at(0)
        width = in_unit(first.velocity_resolution_m_per_s, "m_per_s", 3)
        return f", {width} to ±{in_unit(first.max_velocity_m_per_s, 'm_per_s', 3)}"

    def _tables(self) -> Iterable[Table]:
        return (settings(self), Table("What follows", self._follows()))

    def _follows(self) -> list[tuple[str, str, str]]:
        """What follows, in the first frame where intervals differ."""
        names = ["n_sent", "duration_s"]
        if self.n_chirps > 1:
            names += ["repetition_s", "velocity_resolution_m_per_s", "max_velocity_m_per_s"]
        return follows(self.at(0), *names)
