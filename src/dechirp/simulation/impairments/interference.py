"""Interference from the chirps of other FMCW radars."""

import math
import reprlib
import warnings
from collections import Counter
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import (
    Vector,
    check_and_convert_vector_field,
    check_instances,
    check_integer_fields,
    check_number,
    check_positive_fields,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import check_free_memory
from dechirp.core.text import format_si
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import frozen_dataclass
from dechirp.radar.chirp import Chirp
from dechirp.radar.patterns.base import MAX_GAIN, MIN_GAIN, Pattern
from dechirp.radar.radar import Radar
from dechirp.scene.ego import Ego
from dechirp.scene.rotations import rotation_about_z, to_local_axes
from dechirp.scene.scene import Scene
from dechirp.scene.speed_limit import check_and_convert_velocity_field
from dechirp.simulation.echo_groups import SampleWindow, tx_and_rx_amplitude_gains
from dechirp.simulation.impairments.base import Propagation

__all__ = ["Interference", "Interferer"]

# Signals that the filter attenuates by more than 80 dB are omitted.
_MIN_AMPLITUDE_GAIN = 1e-4
_MIN_DISTANCE_M = 1e-6
# Samples whose beats are summed together: each takes about 200 bytes.
_BLOCK_SAMPLES = 2**18
# Bytes for each ramp that arrives during a frame.
_RAMP_BYTES = 150


@frozen_dataclass
class Interferer:
    """Another radar: its chirps, timing, position and antenna."""

    name: str | None = None
    """Name in messages; none: `interferer-N`, N its position in the list."""
    start_frequency_hz: float
    """Frequency at the start of each ramp."""
    slope_hz_per_s: float
    """Slope of its ramps: negative for down-ramps, 0 for a tone."""
    ramp_duration_s: float
    """Duration of each ramp; silent from its end to the next start."""
    interval_s: float
    """Time between the starts of successive ramps, on the victim's clock: two clocks usually
    differ by parts in 1e6."""
    n_chirps: int | None = None
    """Chirps in each of its frames; none: unlimited."""
    period_s: float | None = None
    """Time between the starts of successive frames; none: a single frame."""
    offset_s: float = 0.0
    """Start of its first ramp, since time zero; may be negative."""
    coherent: bool = False
    """Equal phase at the start of each ramp if true; else a random phase for each ramp."""
    transmit_power_w: float
    """Power into its antenna, at the polarisation of the victim."""
    antenna_gain: float | None = None
    """Gain in all directions, a ratio (dBi in files); required without a pattern."""
    pattern: Pattern | None = None
    """Pattern of its antenna."""
    position_m: Vector
    """Position at time zero, in the coordinates of the scene."""
    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)
    heading_rad: float | None = None
    """Direction of its antenna, to the left of the scene's x axis; none: that of its velocity, 0
    at rest."""
    moves_with_radar: bool = False
    """Position and heading in the coordinates of the radar at all times, as of another radar on its
    vehicle, without a velocity of its own."""

    def __post_init__(self) -> None:
        if not (self.name is None or (isinstance(self.name, str) and self.name)):
            raise InvalidSetting(
                "Interferer.name",
                value=repr(self.name),
                expected="a non-empty string",
                fix="omit it for a name by position in the list",
            )
        # The limits exceed any FMCW radar; other values indicate a wrong unit.
        check_positive_fields(self, "start_frequency_hz", at_least=1e6, at_most=1e13)
        check_number("Interferer.slope_hz_per_s", self.slope_hz_per_s, at_least=-1e18, at_most=1e18)
        check_positive_fields(self, "ramp_duration_s", "interval_s", at_least=1e-7, at_most=1e6)
        check_number("Interferer.offset_s", self.offset_s, at_least=-1e9, at_most=1e9)
        if not isinstance(self.coherent, bool | np.bool_):
            raise InvalidSetting(
                "Interferer.coherent",
                value=reprlib.repr(self.coherent),
                expected="True or False",
                fix="omit it for random phases",
            )
        check_positive_fields(self, "transmit_power_w", at_least=1e-15, at_most=1e12)
        check_and_convert_vector_field(self, "position_m", max_magnitude=1e9)
        check_and_convert_velocity_field(self, "velocity_m_per_s")
        if not isinstance(self.moves_with_radar, bool | np.bool_):
            raise InvalidSetting(
                "Interferer.moves_with_radar",
                value=reprlib.repr(self.moves_with_radar),
                expected="True or False",
                fix="omit it for a position and a velocity in the coordinates of the scene",
            )
        if self.moves_with_radar and any(self.velocity_m_per_s):
            raise InvalidSetting(
                "Interferer.velocity_m_per_s",
                value=f"{self.velocity_m_per_s}, of an interferer that moves with the radar",
                expected="zero: it keeps its place beside the radar",
                fix="leave out the velocity, or moves_with_radar",
            )
        if self.heading_rad is not None:
            full_circle = 2 * math.pi
            check_number(
                "Interferer.heading_rad",
                self.heading_rad,
                at_least=-full_circle,
                at_most=full_circle,
            )
        self._check_ramp_and_frame_timing()
        self._check_gain_or_pattern_given()

    def _check_ramp_and_frame_timing(self) -> None:
        if self.interval_s < self.ramp_duration_s * (1 - 1e-9):
            raise InvalidSetting(
                "Interferer.interval_s",
                value=format_si(self.interval_s, "s"),
                expected=f"at least {format_si(self.ramp_duration_s, 's')}, the duration of the"
                " ramp",
                fix="lengthen the interval or shorten the ramp",
            )
        if self.band_hz[0] <= 0:
            raise InvalidSetting(
                "Interferer.slope_hz_per_s",
                value=f"{format_si(self.slope_hz_per_s, 'hz_per_s')}: the ramp ends at"
                f" {format_si(self.band_hz[0], 'hz', 4)}",
                expected="a ramp that stays above 0 Hz",
                fix="check the units of slope and duration",
            )
        if self.n_chirps is not None:
            check_integer_fields(self, "n_chirps", at_most=1_000_000)
        if self.period_s is None:
            return
        if self.n_chirps is None:
            raise InvalidSetting(
                "Interferer.n_chirps",
                value="missing, with a period",
                expected="the number of chirps in each period",
                fix="give it, or omit the period",
            )
        check_positive_fields(self, "period_s", at_most=1e6)
        frame_s = self.n_chirps * self.interval_s
        if self.period_s < frame_s * (1 - 1e-9):
            raise InvalidSetting(
                "Interferer.period_s",
                value=format_si(self.period_s, "s"),
                expected=f"at least {format_si(frame_s, 's')}, the duration of its chirps",
                fix="lengthen the period, or send fewer chirps at a shorter interval",
            )

    def _check_gain_or_pattern_given(self) -> None:
        if not isinstance(self.pattern, Pattern | None):
            raise InvalidSetting(
                "Interferer.pattern",
                value=self.pattern,
                expected=f"a pattern, one of {', '.join(Pattern.members())}",
                fix="use antenna_gain for a constant gain in all directions",
            )
        if self.antenna_gain is not None:
            check_positive_fields(self, "antenna_gain", at_least=MIN_GAIN, at_most=MAX_GAIN)
        elif self.pattern is None:
            raise InvalidSetting(
                "Interferer.antenna_gain",
                value="missing, and pattern as well",
                expected="a gain for an antenna without a pattern",
                fix="give antenna_gain, or pattern",
            )

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the lowest and the highest transmitted frequency."""
        end_hz = self.start_frequency_hz + self.slope_hz_per_s * self.ramp_duration_s
        return min(self.start_frequency_hz, end_hz), max(self.start_frequency_hz, end_hz)

    def ramp_starts_s(self, first_s: float, last_s: float) -> np.ndarray:
        """Return the starts of the ramps that overlap the interval, ascending."""
        since_s, until_s = first_s - self.offset_s - self.ramp_duration_s, last_s - self.offset_s
        if self.period_s is None:
            first_index, last_index = (
                math.floor(since_s / self.interval_s),
                until_s // self.interval_s,
            )
            last_index = last_index if self.n_chirps is None else min(last_index, self.n_chirps - 1)
            starts_s = self.interval_s * np.arange(max(0, first_index), last_index + 1)
        else:
            assert self.n_chirps is not None
            first_index = math.floor((since_s - self.n_chirps * self.interval_s) / self.period_s)
            frames = np.arange(max(0, first_index), until_s // self.period_s + 1)
            chirps_s = self.interval_s * np.arange(self.n_chirps)
            starts_s = (self.period_s * frames[:, None] + chirps_s).ravel()
        return starts_s[(starts_s > since_s) & (starts_s <= until_s)] + self.offset_s

    def max_ramp_count(self, duration_s: float) -> float:
        """Return a bound on the number of candidate ramps within a duration."""
        if self.n_chirps is None:
            return duration_s / self.interval_s
        return self.n_chirps * (1 if self.period_s is None else duration_s / self.period_s + 2)

    def positions_from_radar_m(self, times_s: np.ndarray, ego: Ego) -> np.ndarray:
        """Return its positions in the coordinates of the radar at each time, (n_times, 3)."""
        if self.moves_with_radar:
            return np.tile(np.array(self.position_m), (len(times_s), 1))
        start_m = np.array(self.position_m) - np.array(ego.position_m)
        displacements_m = times_s[:, None] * np.array(self.velocity_m_per_s) - ego.displacements_m(
            times_s
        )
        if ego.is_turning:
            return to_local_axes(ego.axes(times_s), (start_m + displacements_m)[:, None])[:, 0]
        return (start_m + displacements_m) @ ego.axes(np.zeros(1))[0]

    def gain_towards_radar(self, time_s: float, ego: Ego) -> float:
        """Return its antenna gain towards the radar, a ratio."""
        if self.pattern is None:
            return float(self.antenna_gain or 0.0)
        to_radar_m = -np.array(self.position_m)
        if not self.moves_with_radar:
            to_radar_m += np.array(ego.position_m) + ego.displacements_m(np.array([time_s]))[0]
            to_radar_m -= time_s * np.array(self.velocity_m_per_s)
        heading_rad = self.heading_rad
        if heading_rad is None:
            heading_rad = math.atan2(self.velocity_m_per_s[1], self.velocity_m_per_s[0])
        x, y, z = to_local_axes(rotation_about_z(np.array([heading_rad])), to_radar_m[None, None])[
            0, 0
        ]
        return float(self.pattern.gain_towards(math.atan2(y, x), math.atan2(z, math.hypot(x, y))))


@frozen_dataclass
class Interference(Propagation):
    r"""Chirps of other radars, mixed with the transmitted ramp and filtered by the IF filter.

    .. math::
        \frac{\lambda}{4 \pi R} \sqrt{P_t G_t G_r} \, |H(f_b)|
        \exp 2 \pi i \left( f_0 t + \frac{S t^2}{2} - f_1 u - \frac{S_1 u^2}{2} - \phi \right),
        \quad u = t - \frac{R(t)}{c} - t_1

    on the victim's ramp since t = 0, and on the interferer's since t_1: a one-way path, of length R
    to
    each receiver at each sample, so parallel slopes cause a ghost at half of the delay and its
    drift.
    Different slopes cross: a burst as long as the passband over the difference of the slopes. Gains
    are those of mid-frame, the wavelength that of the victim's mid-band. `Hardware.loss`, which
    covers
    both paths together, does not apply, nor do weather losses.

    The filter is ideal, without delay, evaluated at the instantaneous beat frequency: `|H|^2 = 1 /
    (1 +
    x^(2 n))`, x the distance from the middle of the unambiguous band (0 to the sample rate, or plus
    and
    minus half of it for real samples) over its corner. Frequencies beyond the band alias, as in any
    ADC. A real filter rings at the edges of a burst: its root mean square differs from this one by
    2 %
    for a burst of 100 samples, by 10 % for 20.

    Brooker 2007; Uysal 2019.
    """

    supported_ramps = "alike"
    interferers: tuple[Interferer, ...]
    """The other radars."""
    filter_order: int = 8
    """Order of the Butterworth filter before the ADC, n."""
    filter_corner: float = 1.0
    """Half-power frequency over half of the band: 1 at the band's edges."""

    def __post_init__(self) -> None:
        fix = "give at least one Interferer, with its chirps, power, gain and position"
        interferers = check_instances(
            "Interference.interferers", self.interferers, Interferer, fix=fix
        )
        object.__setattr__(self, "interferers", interferers)
        if not interferers:
            expected = "a list of at least one interferer"
            raise InvalidSetting(
                "Interference.interferers", value="empty", expected=expected, fix=fix
            )
        for name, count in Counter(self.names).items():
            if count > 1:
                raise InvalidSetting(
                    "Interference.interferers",
                    value=f"{count} interferers named {name}",
                    expected="a unique name for each interferer",
                    fix="rename one of them",
                )
        check_integer_fields(self, "filter_order", at_most=100)
        check_positive_fields(self, "filter_corner", at_least=0.01, at_most=100.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the name of each interferer, given or by position: interferer-1 ..."""
        return tuple(
            interferer.name or f"interferer-{number}"
            for number, interferer in enumerate(self.interferers, 1)
        )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for an interferer at the radar's position; warn about one outside the band."""
        radar.require_hardware()
        passband = self._receiver_passband(radar.frame.chirp)
        antennas_m = np.array([(0.0, 0.0, 0.0), *radar.array.rx_m])
        for name, interferer in zip(self.names, self.interferers, strict=True):
            positions_m = interferer.positions_from_radar_m(
                np.array([0.0, radar.frame.mid_frame_s]), scene.ego
            )
            if np.linalg.norm(positions_m[:, None] - antennas_m, axis=-1).min() < _MIN_DISTANCE_M:
                raise InvalidSetting(
                    f"interferers.{name}.position",
                    value="at the position of the radar",
                    expected="another position: the received power would be infinite",
                    fix="move the interferer",
                )
            if not self.can_receive(interferer, radar):
                low_hz, high_hz = passband.passed_rf_band_hz(radar.frame.chirp)
                band_text = " to ".join(f"{hz / 1e9:.6g}" for hz in interferer.band_hz)
                finding = Finding(
                    level="warning",
                    setting=f"impairments.interference.interferers.{name}",
                    value=f"sends from {band_text} GHz, outside the receiver's band",
                    expected=f"frequencies from {low_hz / 1e9:.6g} to {high_hz / 1e9:.6g} GHz",
                    fix="check its start frequency, slope and duration",
                )
                warnings.warn(PhysicsWarning(finding), stacklevel=3)

    def can_receive(self, interferer: Interferer, radar: Radar) -> bool:
        """Return whether the chirps of an interferer pass the filter of a radar at some time."""
        passband = self._receiver_passband(radar.frame.chirp)
        low_hz, high_hz = passband.passed_rf_band_hz(radar.frame.chirp)
        return interferer.band_hz[0] <= high_hz and interferer.band_hz[1] >= low_hz

    def delayed(self, delay_s: float) -> "Interference":
        """Return the interference with all first ramps later by a delay, which may be negative."""
        return replace(
            self,
            interferers=tuple(
                replace(interferer, offset_s=interferer.offset_s + delay_s)
                for interferer in self.interferers
            ),
        )

    def add_signals(
        self,
        samples: np.ndarray,
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        passband = self._receiver_passband(radar.frame.chirp)
        block_length = max(1, _BLOCK_SAMPLES // window.n_times)
        for interferer in self.interferers:
            ramps = _find_arriving_ramps_and_phases(window, scene.ego, radar, interferer, rng)
            for row in range(0, len(samples), block_length):
                block = slice(row, row + block_length)
                _add_interferer_signal(
                    samples[block],
                    window.select_chirps(block),
                    scene.ego,
                    radar,
                    interferer,
                    passband,
                    ramps,
                )

    def _receiver_passband(self, chirp: Chirp) -> "_Passband":
        half_hz = chirp.sample_rate_hz / 2
        middle_hz = half_hz if chirp.sampling == "complex" else 0.0
        return _Passband(middle_hz, half_hz * self.filter_corner, self.filter_order)


class _Passband(NamedTuple):
    """IF filter before the ADC."""

    middle_hz: float
    corner_hz: float
    """Distance from the middle to half of the power."""
    order: int

    @property
    def relevant_half_width_hz(self) -> float:
        """Return the distance from the middle to the least relevant gain."""
        return self.corner_hz * _MIN_AMPLITUDE_GAIN ** (-1 / self.order)

    def amplitude_gains(self, beat_hz: np.ndarray) -> np.ndarray:
        """Return the amplitude gain at beat frequencies, a ratio."""
        normalised = (beat_hz - self.middle_hz) / self.corner_hz
        return 1 / np.sqrt(1 + normalised ** (2 * self.order))

    def passed_rf_band_hz(self, chirp: Chirp) -> tuple[float, float]:
        """Return the lowest and highest frequency that passes at some sample."""
        first_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * chirp.adc_start_s
        last_hz = first_hz + chirp.sampled_bandwidth_hz
        return (
            first_hz - self.middle_hz - self.relevant_half_width_hz,
            last_hz - self.middle_hz + self.relevant_half_width_hz,
        )


class _BurstSamples(NamedTuple):
    """Samples of a window that contain an interferer."""

    chirp_indices: np.ndarray
    """(n,): chirp of the window."""
    sample_indices: np.ndarray
    """(n,): sample of the chirp."""
    start_differences_s: np.ndarray
    """(n,): start of the victim's ramp minus that of the interferer's."""
    ramp_indices: np.ndarray
    """(n,): index of the interferer's ramp among the candidates."""


class _ArrivingRamps(NamedTuple):
    """Ramps of an interferer that arrive during a frame."""

    starts_s: np.ndarray
    """(n,), ascending, since time zero."""
    start_phases_cycles: np.ndarray
    """(n,): phase at the start of each, in cycles."""


def _find_arriving_ramps_and_phases(
    window: SampleWindow, ego: Ego, radar: Radar, interferer: Interferer, rng: np.random.Generator
) -> _ArrivingRamps:
    """Find the ramps that arrive during a whole frame, so that each has a single phase."""
    ramps_s = window.frame_start_s + radar.frame.chirp_starts_s
    delays_s = _propagation_delays_s(ramps_s, ego, interferer)
    first_s = ramps_s[0] + window.times_s[0] - delays_s.max()
    last_s = ramps_s[-1] + window.times_s[-1] - delays_s.min()
    check_free_memory(
        "interference",
        needed_bytes=_RAMP_BYTES * interferer.max_ramp_count(last_s - first_s),
        fix="give the interferer a longer interval, or simulate shorter frames",
    )
    starts_s = interferer.ramp_starts_s(first_s, last_s)
    n = len(starts_s)
    return _ArrivingRamps(starts_s, np.zeros(n) if interferer.coherent else rng.random(n))


def _propagation_delays_s(
    ramp_starts_s: np.ndarray, ego: Ego, interferer: Interferer
) -> np.ndarray:
    """Return the delay on the path to the radar at the start of each of its ramps."""
    return np.asarray(
        np.linalg.norm(interferer.positions_from_radar_m(ramp_starts_s, ego), axis=-1)
        / SPEED_OF_LIGHT
    )


def _add_interferer_signal(
    samples: np.ndarray,
    window: SampleWindow,
    ego: Ego,
    radar: Radar,
    interferer: Interferer,
    passband: _Passband,
    ramps: _ArrivingRamps,
) -> None:
    chirp = radar.frame.chirp
    ramps_s = window.frame_start_s + window.chirp_starts_s
    delays_s = _propagation_delays_s(ramps_s, ego, interferer)
    burst = _find_burst_samples(window, chirp, interferer, passband, delays_s, ramps.starts_s)
    if not burst.chirp_indices.size:
        return
    t = window.times_s[burst.sample_indices]
    positions_m = interferer.positions_from_radar_m(ramps_s[burst.chirp_indices] + t, ego)
    start_hz, slope = interferer.start_frequency_hz, interferer.slope_hz_per_s
    # Receivers 10 cm apart have beats 7 kHz apart at 20 MHz/us, so the filter uses a common one.
    ramp_times_s = (
        t + burst.start_differences_s - np.linalg.norm(positions_m, axis=-1) / SPEED_OF_LIGHT
    )
    beat_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * t - start_hz - slope * ramp_times_s
    filter_gains = passband.amplitude_gains(beat_hz)
    cycles = chirp.start_frequency_hz * t + chirp.slope_hz_per_s * t**2 / 2
    cycles -= ramps.start_phases_cycles[burst.ramp_indices]
    amplitudes = _amplitudes_at_one_metre(window, ego, radar, interferer)
    for receiver, (rx_m, amplitude) in enumerate(zip(radar.array.rx_m, amplitudes, strict=True)):
        length_m = np.linalg.norm(positions_m - rx_m, axis=-1)
        u = t + burst.start_differences_s - length_m / SPEED_OF_LIGHT
        phase_cycles = cycles - (start_hz + slope * u / 2) * u
        wave = amplitude / length_m * filter_gains * np.exp(2j * np.pi * phase_cycles)
        samples[burst.chirp_indices, receiver, burst.sample_indices] += wave


def _amplitudes_at_one_metre(
    window: SampleWindow, ego: Ego, radar: Radar, interferer: Interferer
) -> np.ndarray:
    """Return the amplitude in each receiver times path length, (n_rx,), sqrt(W) m (Friis 1946)."""
    mid_s = window.frame_start_s + radar.frame.mid_frame_s
    _, rx_gains = tx_and_rx_amplitude_gains(
        interferer.positions_from_radar_m(np.array([mid_s]), ego), radar
    )
    power_w = interferer.transmit_power_w * interferer.gain_towards_radar(mid_s, ego)
    return rx_gains[:, 0] * np.sqrt(power_w) * radar.frame.chirp.wavelength_m / (4 * np.pi)


def _find_burst_samples(
    window: SampleWindow,
    chirp: Chirp,
    interferer: Interferer,
    passband: _Passband,
    delays_s: np.ndarray,
    starts_s: np.ndarray,
) -> _BurstSamples:
    """Find the samples of each pair of overlapping ramps, from their linear frequencies."""
    times_s = window.times_s
    ramps_s = window.frame_start_s + window.chirp_starts_s
    # Indices of the interferer's ramps that arrive during the samples of each chirp.
    stops = np.searchsorted(starts_s, ramps_s + times_s[-1] - delays_s, side="right")
    ends_s = starts_s + interferer.ramp_duration_s
    firsts = np.searchsorted(ends_s, ramps_s + times_s[0] - delays_s, side="right")
    rows, chirps = _concatenate_integer_runs(firsts, np.maximum(stops - firsts, 0))
    ahead_s = ramps_s[rows] - starts_s[chirps]
    arrivals_s = delays_s[rows] - ahead_s  # arrival of the interferer's ramp, on the victim's ramp
    # The beat frequency is offset + rate t.
    rate = chirp.slope_hz_per_s - interferer.slope_hz_per_s
    offset_hz = chirp.start_frequency_hz - interferer.start_frequency_hz
    offset_hz = offset_hz + interferer.slope_hz_per_s * arrivals_s - passband.middle_hz
    if rate == 0:
        entries_s = np.where(abs(offset_hz) <= passband.relevant_half_width_hz, -np.inf, np.inf)
        exits_s = -entries_s
    else:
        edges_s = (np.array([[-1.0], [1.0]]) * passband.relevant_half_width_hz - offset_hz) / rate
        entries_s, exits_s = edges_s.min(axis=0), edges_s.max(axis=0)
    entries_s = np.maximum(entries_s, arrivals_s)
    exits_s = np.minimum(exits_s, arrivals_s + interferer.ramp_duration_s)
    lows, highs = (
        np.ceil(
            np.clip((edge_s - window.first_sample_s) * window.rate_hz, 0, window.n_times)
        ).astype(int)
        for edge_s in (entries_s, exits_s)
    )
    pairs, columns = _concatenate_integer_runs(lows, np.maximum(highs - lows, 0))
    return _BurstSamples(rows[pairs], columns, ahead_s[pairs], chirps[pairs])


def _concatenate_integer_runs(
    firsts: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Concatenate runs of consecutive integers; return the run index and the integers."""
    run_indices = np.repeat(np.arange(len(firsts)), counts)
    offsets = np.cumsum(counts) - counts
    return run_indices, np.arange(len(run_indices)) + (firsts - offsets)[run_indices]
