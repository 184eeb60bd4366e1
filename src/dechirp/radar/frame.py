"""A frame: the chirps of one coherent processing interval, in rounds at equal intervals."""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from dechirp.core.checks import (
    as_tuple_or_none,
    check_field_classes,
    check_integer_fields,
    check_number,
    check_numbers,
    check_positive_fields,
)
from dechirp.core.display import (
    Displayable,
    Table,
    format_count_with_noun,
    property_display_rows,
    settings_display_table,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_quantity, format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.modulations.base import Modulation, Ramp
from dechirp.radar.multiplexing.base import Multiplexing

_MAX_AMBIGUITIES = 64
_PHASE_TOLERANCE_CYCLES = 0.02  # 7 degrees, the phase error between two slots at 18 dB of SNR


@frozen_dataclass
class Frame(Displayable):
    """Chirps of one coherent processing interval, and the frame period.

    Velocities use the wavelength at the middle of the sampling window.
    """

    chirp: Chirp
    n_chirps: int
    """Chirps of each transmitter; a single one measures no velocity. Under a code in which
    transmitters send together: repetitions of the code, 1 where it is as long as the frame;
    under a modulation: rounds of its ramps."""
    interval_s: float | tuple[float, ...]
    """Time from the start of a chirp to the start of the next, of whichever transmitter; a list
    has one interval for each frame in turn, see `for_frame`."""
    period_s: float | None = None
    """Time from the start of a frame to the start of the next; none: frames without a gap."""
    multiplexing: Multiplexing | None = None
    """Sharing of the chirps among transmitters; none: one transmitter sends them all."""
    modulation: Modulation | None = None
    """Differences between the ramps of a round, all sent by one transmitter; none: equal ramps."""

    def __post_init__(self) -> None:
        check_field_classes(self, chirp=Chirp)
        check_integer_fields(self, "n_chirps")
        self._check_intervals()
        if not isinstance(self.multiplexing, Multiplexing | None):
            raise InvalidSetting(
                "Frame.multiplexing",
                value=self.multiplexing,
                expected="a member of the family, or none",
                fix="give Tdm(order=(0, 1)) where two transmitters take turns",
            )
        self._check_modulation()
        if self.period_s is None:
            return
        check_positive_fields(self, "period_s", at_least=1e-12, at_most=1e6)
        longest_s = max(self.for_frame(index).duration_s for index in range(self.n_intervals))
        if self.period_s < longest_s * (1 - 1e-9):
            raise InvalidSetting(
                "Frame.period_s",
                value=format_si(self.period_s, "s", 10),
                expected=f"at least {format_si(longest_s, 's', 10)}, the duration of the chirps",
                fix="lengthen the period, or send fewer chirps at a shorter interval",
            )

    def _check_intervals(self) -> None:
        intervals_s = as_tuple_or_none(self.interval_s)
        if intervals_s is None:
            # The bounds of a ramp.
            check_positive_fields(self, "interval_s", at_least=1e-12, at_most=1e6)
            named_intervals = [
                ("Frame.interval_s", check_number("Frame.interval_s", self.interval_s))
            ]
        else:
            checked = check_numbers("Frame.interval_s", intervals_s, at_least=1e-12, at_most=1e6)
            object.__setattr__(self, "interval_s", checked)
            named_intervals = [
                (f"Frame.interval_s.{place}", one_s) for place, one_s in enumerate(checked)
            ]
            if len(checked) < 2:
                raise InvalidSetting(
                    "Frame.interval_s",
                    value=f"a list of {len(checked)} interval{'s' * (len(checked) != 1)}",
                    expected="two or more, one for each frame in turn",
                    fix="write one interval without brackets",
                )
        for setting, interval_s in named_intervals:
            if interval_s < self.chirp.ramp_duration_s * (1 - 1e-9):
                raise InvalidSetting(
                    setting,
                    value=format_si(interval_s, "s", 10),
                    expected=f"at least {format_si(self.chirp.ramp_duration_s, 's', 10)}, the"
                    " duration of the"
                    " ramp",
                    fix="lengthen the interval or shorten the ramp",
                )

    def _check_modulation(self) -> None:
        if not isinstance(self.modulation, Modulation | None):
            raise InvalidSetting(
                "Frame.modulation",
                value=self.modulation,
                expected="a member of the family, or none",
                fix="give Triangular() for ramps that rise and fall in turns",
            )
        if self.modulation is not None and self.multiplexing is not None:
            raise InvalidSetting(
                "Frame.modulation",
                value=f"{self.modulation.kind()}, with multiplexing of kind"
                f" {self.multiplexing.kind()}",
                expected="only one of the two: a single transmitter sends ramps that differ",
                fix="remove one of the two",
            )
        lowest_hz = self.chirp.start_frequency_hz + min(ramp.shift_hz for ramp in self.ramps)
        if lowest_hz <= 0:
            raise InvalidSetting(
                "Frame.modulation",
                value=f"a ramp that starts at {format_si(lowest_hz, 'hz')}",
                expected="frequencies above 0",
                fix="lower the step",
            )

    @property
    def n_intervals(self) -> int:
        """Number of frames after which the list of intervals repeats; 1 for a single interval."""
        return len(self.interval_s) if isinstance(self.interval_s, tuple) else 1

    def for_frame(self, frame_index: int) -> "Frame":
        """Return the frame of this index (from 0) with its single chirp interval.

        Properties that depend on the interval are defined only for such a frame where the
        interval is a list.
        """
        if not isinstance(self.interval_s, tuple):
            return self
        return replace(self, interval_s=self.interval_s[frame_index % len(self.interval_s)])

    @property
    def single_interval_s(self) -> float:
        """Interval of all frames; raises `InvalidSetting` where it differs between frames."""
        if not isinstance(self.interval_s, tuple):
            return self.interval_s
        raise InvalidSetting(
            "Frame.interval_s",
            value="a list: " + ", ".join(format_si(one_s, "s") for one_s in self.interval_s),
            expected="a single interval, since this value belongs to one frame",
            fix="use the radar of a single frame: radar.for_frame(0)",
        )

    @cached_property
    def ramps(self) -> tuple[Ramp, ...]:
        """Deviations of the ramp of each slot of a round from `chirp`."""
        if self.modulation is not None:
            return self.modulation.ramps(self.chirp)
        if self.multiplexing is None:
            return (Ramp(),)
        last = Ramp(pause_s=self.multiplexing.round_pause_s)
        return (Ramp(),) * (len(self.multiplexing.weights) - 1) + (last,)

    @property
    def has_identical_ramps(self) -> bool:
        """True if all ramps equal `chirp`, at whatever time they are sent."""
        return all(ramp.sign == 1 and ramp.shift_hz == 0 for ramp in self.ramps)

    @property
    def weights(self) -> tuple[tuple[complex, ...], ...]:
        """Factor of each transmitter's echo in each slot of a round, (n_slots, n_tx).

        See `Multiplexing.weights`; without multiplexing one transmitter sends in every chirp.
        """
        if self.multiplexing is None:
            return ((1 + 0j,),) * len(self.ramps)
        return self.multiplexing.weights

    def chirp_weights(self) -> np.ndarray:
        """Return the factor of each transmitter's echo in each chirp, (n_chirps_total, n_tx)."""
        return np.tile(np.array(self.weights, np.complex128), (self.n_chirps, 1))

    @property
    def slot_transmitters(self) -> tuple[tuple[int, ...], ...]:
        """Transmitters that send in each slot of a round; the first alone without multiplexing."""
        return (
            ((0,),) * len(self.ramps)
            if self.multiplexing is None
            else self.multiplexing.slot_transmitters
        )

    @property
    def tdm_order(self) -> tuple[int, ...] | None:
        """Transmitter of each slot if transmitters take turns, each once; None for other codes."""
        lone_transmitters = tuple(slot[0] for slot in self.slot_transmitters if len(slot) == 1)
        return lone_transmitters if len(set(lone_transmitters)) == self.n_slots else None

    @property
    def n_slots(self) -> int:
        """Number of chirps in a round of the transmitters or of the ramps; 1 without either."""
        return len(self.ramps)

    @property
    def n_chirps_total(self) -> int:
        """Number of chirps of the frame of all transmitters, n_chirps x n_slots."""
        return self.n_chirps * self.n_slots

    @property
    def slot_starts_s(self) -> np.ndarray:
        """Start of each slot from the start of its round, (n_slots,)."""
        slot_durations_s = [self.single_interval_s + ramp.pause_s for ramp in self.ramps]
        return np.concatenate([[0.0], np.cumsum(slot_durations_s)[:-1]])

    @property
    def doppler_phase_times_s(self) -> np.ndarray:
        """Time t of each slot in the phase 2 pi f_D t that a Doppler frequency adds, (n_slots,).

        The start of the slot, less the time that a ramp of another frequency takes to reach the
        same frequency: for one beat frequency, a higher Doppler frequency is a shorter delay.
        """
        shift_hz = np.array([ramp.shift_hz for ramp in self.ramps])
        return self.slot_starts_s - (shift_hz - shift_hz[0]) / self.chirp.slope_hz_per_s

    @cached_property
    def n_resolvable_ambiguities(self) -> int:
        """Number of ambiguity numbers that the phases between slots distinguish.

        The least number after which the phases of all slots repeat, within 0.02 of a cycle; at
        most 64, or n_slots. It is n_slots where slots are evenly spaced.
        """
        limit = max(_MAX_AMBIGUITIES, self.n_slots)
        cycles = np.outer(np.arange(1, limit + 1), self.doppler_phase_times_s / self.repetition_s)
        realigned = np.flatnonzero(
            np.all(abs(cycles - np.rint(cycles)) <= _PHASE_TOLERANCE_CYCLES, axis=1)
        )
        return 1 + int(realigned[0]) if realigned.size else limit

    def n_resolvable_ambiguities_across_frames(self, index: int) -> int:
        """Return the number of ambiguity numbers that frames of all intervals distinguish.

        The repetition of the frame over the greatest common divisor of all repetitions, at most
        64; 1 where all frames have the same interval.
        """
        frames = [self.for_frame(place) for place in range(self.n_intervals)]
        common_s = math.gcd(*(round(item.repetition_s * 1e12) for item in frames)) * 1e-12
        return min(round(self.for_frame(index).repetition_s / common_s), _MAX_AMBIGUITIES)

    @property
    def has_falling_ramps(self) -> bool:
        """True if any ramp falls in frequency."""
        return any(ramp.sign < 0 for ramp in self.ramps)

    @property
    def can_measure_velocity(self) -> bool:
        """True for several chirps, or a rising and a falling ramp."""
        return self.n_chirps > 1 or self.has_falling_ramps

    @property
    def chirp_starts_s(self) -> np.ndarray:
        """Start of each chirp from the start of the frame, (n_chirps_total,)."""
        if not any(ramp.pause_s for ramp in self.ramps):
            return self.single_interval_s * np.arange(self.n_chirps_total)
        rounds_s = self.repetition_s * np.arange(self.n_chirps)
        return np.ravel(rounds_s[:, None] + self.slot_starts_s)

    @property
    def repetition_s(self) -> float:
        """Time from one chirp of a transmitter to its next; under a code, from round to round."""
        return self.n_slots * self.single_interval_s + sum(ramp.pause_s for ramp in self.ramps)

    @property
    def duration_s(self) -> float:
        """Time from the start of the first chirp to the end of the last interval."""
        return self.n_chirps * self.repetition_s

    @property
    def mid_frame_s(self) -> float:
        """Mean of all sampling instants from the start of the frame.

        Estimates and truth refer to this instant.
        """
        slots_s = float(self.slot_starts_s.mean())
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
        """Return the velocity of each bin of a Doppler spectrum of n_bins points (none: n_chirps).

        (n_bins,), ascending from minus the largest velocity in steps of lambda / 2 n_bins T, zero
        at n_bins // 2.
        """
        doppler_hz = np.fft.fftshift(np.fft.fftfreq(n_bins or self.n_chirps, self.repetition_s))
        return doppler_hz * self.chirp.wavelength_m / 2

    def frame_start_s(self, index: int) -> float:
        """Return the start of a frame, counted from 0."""
        if self.period_s is not None:
            return index * self.period_s
        n_cycles, n_remaining = divmod(index, self.n_intervals)
        durations_s = [self.for_frame(place).duration_s for place in range(self.n_intervals)]
        return n_cycles * sum(durations_s) + sum(durations_s[:n_remaining])

    def _display_line(self) -> str:
        text = format_count_with_noun(self.n_chirps_total, "chirp")
        if self.n_slots > 1:
            text += f" in {format_count_with_noun(self.n_chirps, 'round')}"
        velocities = self._format_velocity_resolution_and_limit()
        return f"{text} of {format_count_with_noun(self.chirp.n_samples, 'sample')}{velocities}"

    def _format_velocity_resolution_and_limit(self) -> str:
        """Format velocity resolution and limit, of the first of several intervals."""
        if self.n_chirps == 1:
            return ""
        first = self.for_frame(0)
        resolution = format_quantity(first.velocity_resolution_m_per_s, "m_per_s", 3)
        return f", {resolution} to ±{format_quantity(first.max_velocity_m_per_s, 'm_per_s', 3)}"

    def _display_tables(self) -> Iterable[Table]:
        return (settings_display_table(self), Table("What follows", self._derived_value_rows()))

    def _derived_value_rows(self) -> list[tuple[str, str, str]]:
        """Return table rows of derived values, of the first frame where intervals differ."""
        names = ["n_chirps_total", "duration_s"]
        if self.n_chirps > 1:
            names += ["repetition_s", "velocity_resolution_m_per_s", "max_velocity_m_per_s"]
        return property_display_rows(self.for_frame(0), *names)
