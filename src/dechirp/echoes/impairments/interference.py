"""Other FMCW radars: their chirps, straight into the receivers."""

import math
import reprlib
import warnings
from collections import Counter
from typing import NamedTuple

import numpy as np

from dechirp.core.checks import Vector, count, instances, number, positive, vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Window, gains
from dechirp.radar.chirp import Chirp
from dechirp.radar.patterns.base import LEAST_GAIN, MOST_GAIN, Pattern
from dechirp.radar.radar import Radar
from dechirp.scene.ego import Ego
from dechirp.scene.rotations import about_z, into
from dechirp.scene.scene import Scene
from dechirp.scene.slow import slow_vector

# What the filter weakens by more than 80 dB is left out.
_FAINTEST = 1e-4
_APART_M = 1e-6
# Times at which beats are summed at once: each takes about 200 bytes.
_AT_ONCE = 2**18
# Bytes for each ramp that arrives during a frame, and where it is looked at.
_RAMP_BYTES = 150


@value
class Interferer:
    """Another radar: its chirps, when it sends them, where it is and where it looks."""

    name: str | None = None
    """How messages call it; none: `interferer-N`, N its place in the list."""
    start_frequency_hz: float
    """At the start of each ramp."""
    slope_hz_per_s: float
    """Of its ramps: negative for down-ramps, 0 for a tone."""
    ramp_duration_s: float
    """For which it sends; silent from then to the next."""
    interval_s: float
    """From the start of a ramp to the start of the next, on the victim's clock: a part in 1e6 is
    the usual difference of two clocks."""
    n_chirps: int | None = None
    """In each of its frames; none: without end."""
    period_s: float | None = None
    """From the start of its frame to that of the next; none: one frame alone."""
    offset_s: float = 0.0
    """Start of its first ramp, since time zero; negative: it sends before."""
    coherent: bool = False
    """Whether each ramp begins with the same phase; else phases are drawn, one for each."""
    transmit_power_w: float
    """Power into its antenna, at the polarisation of the victim."""
    antenna_gain: float | None = None
    """In all directions, as a ratio (dBi in files); needed without a pattern."""
    pattern: Pattern | None = None
    """How its antenna sees directions."""
    position_m: Vector
    """At time zero, in the coordinates of the scene."""
    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)
    heading_rad: float | None = None
    """Where its antenna looks, to the left of the scene's x axis; none: where it goes, 0 at
    rest."""

    def __post_init__(self) -> None:
        if not (self.name is None or (isinstance(self.name, str) and self.name)):
            raise InvalidSetting(
                "Interferer.name",
                got=repr(self.name),
                need="a text of at least one letter",
                fix="Leave it out for a name by its place in the list.",
            )
        # Wider than any FMCW radar: outside, a unit is wrong.
        positive(self, "start_frequency_hz", at_least=1e6, at_most=1e13)
        number("Interferer.slope_hz_per_s", self.slope_hz_per_s, at_least=-1e18, at_most=1e18)
        positive(self, "ramp_duration_s", "interval_s", at_least=1e-7, at_most=1e6)
        number("Interferer.offset_s", self.offset_s, at_least=-1e9, at_most=1e9)
        if not isinstance(self.coherent, bool | np.bool_):
            raise InvalidSetting(
                "Interferer.coherent",
                got=reprlib.repr(self.coherent),
                need="True or False",
                fix="Leave it out for phases that are drawn.",
            )
        positive(self, "transmit_power_w", at_least=1e-15, at_most=1e12)
        vector(self, "position_m", at_most=1e9)
        slow_vector(self, "velocity_m_per_s")
        if self.heading_rad is not None:
            turn = 2 * math.pi
            number("Interferer.heading_rad", self.heading_rad, at_least=-turn, at_most=turn)
        self._check_times()
        self._check_antenna()

    def _check_times(self) -> None:
        if self.interval_s < self.ramp_duration_s * (1 - 1e-9):
            raise InvalidSetting(
                "Interferer.interval_s",
                got=f"{self.interval_s:.6g} s",
                need=f"at least {self.ramp_duration_s:.6g} s, the duration of the ramp",
                fix="Lengthen the interval or shorten the ramp.",
            )
        if self.band_hz[0] <= 0:
            raise InvalidSetting(
                "Interferer.slope_hz_per_s",
                got=f"{self.slope_hz_per_s:.6g} Hz/s: the ramp ends at {self.band_hz[0]:.4g} Hz",
                need="a ramp that stays above 0 Hz",
                fix="Check the units of slope and duration.",
            )
        if self.n_chirps is not None:
            count(self, "n_chirps", at_most=1_000_000)
        if self.period_s is None:
            return
        if self.n_chirps is None:
            raise InvalidSetting(
                "Interferer.n_chirps",
                got="none, with a period",
                need="given: how many chirps come in each period",
                fix="Give it, or leave the period out.",
            )
        positive(self, "period_s", at_most=1e6)
        frame_s = self.n_chirps * self.interval_s
        if self.period_s < frame_s * (1 - 1e-9):
            raise InvalidSetting(
                "Interferer.period_s",
                got=f"{self.period_s:.6g} s",
                need=f"at least {frame_s:.6g} s, the time its chirps take",
                fix="Lengthen the period, or send fewer chirps at a shorter interval.",
            )

    def _check_antenna(self) -> None:
        if not isinstance(self.pattern, Pattern | None):
            raise InvalidSetting(
                "Interferer.pattern",
                got=self.pattern,
                need=f"a pattern, one of {', '.join(Pattern.members())}",
                fix="Give one gain in all directions as antenna_gain.",
            )
        if self.antenna_gain is not None:
            positive(self, "antenna_gain", at_least=LEAST_GAIN, at_most=MOST_GAIN)
        elif self.pattern is None:
            raise InvalidSetting(
                "Interferer.antenna_gain",
                got="none, and no pattern",
                need="given for an antenna without a pattern",
                fix="Give antenna_gain, or pattern.",
            )

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency that it sends."""
        end_hz = self.start_frequency_hz + self.slope_hz_per_s * self.ramp_duration_s
        return min(self.start_frequency_hz, end_hz), max(self.start_frequency_hz, end_hz)

    def starts_s(self, first_s: float, last_s: float) -> np.ndarray:
        """Starts of the ramps that are on at some time from the first to the last, ascending."""
        since_s, until_s = first_s - self.offset_s - self.ramp_duration_s, last_s - self.offset_s
        if self.period_s is None:
            least, most = math.floor(since_s / self.interval_s), until_s // self.interval_s
            most = most if self.n_chirps is None else min(most, self.n_chirps - 1)
            starts_s = self.interval_s * np.arange(max(0, least), most + 1)
        else:
            assert self.n_chirps is not None
            least = math.floor((since_s - self.n_chirps * self.interval_s) / self.period_s)
            frames = np.arange(max(0, least), until_s // self.period_s + 1)
            chirps_s = self.interval_s * np.arange(self.n_chirps)
            starts_s = (self.period_s * frames[:, None] + chirps_s).ravel()
        return starts_s[(starts_s > since_s) & (starts_s <= until_s)] + self.offset_s

    def most_ramps(self, duration_s: float) -> float:
        """Bound on how many ramps are looked at for so long a time."""
        if self.n_chirps is None:
            return duration_s / self.interval_s
        return self.n_chirps * (1 if self.period_s is None else duration_s / self.period_s + 2)

    def seen_m(self, times_s: np.ndarray, ego: Ego) -> np.ndarray:
        """Where it is, in the coordinates of the radar at each time, (n_times, 3)."""
        start_m = np.array(self.position_m) - np.array(ego.position_m)
        way_m = times_s[:, None] * np.array(self.velocity_m_per_s) - ego.ways_m(times_s)
        if ego.is_turning:
            return into(ego.axes(times_s), (start_m + way_m)[:, None])[:, 0]
        return (start_m + way_m) @ ego.axes(np.zeros(1))[0]

    def gain_towards(self, time_s: float, ego: Ego) -> float:
        """Its gain towards the radar, a ratio."""
        if self.pattern is None:
            return float(self.antenna_gain or 0.0)
        times_s = np.array([time_s])
        at_m = np.array(self.position_m) + time_s * np.array(self.velocity_m_per_s)
        to_radar_m = np.array(ego.position_m) + ego.ways_m(times_s)[0] - at_m
        heading_rad = self.heading_rad
        if heading_rad is None:
            heading_rad = math.atan2(self.velocity_m_per_s[1], self.velocity_m_per_s[0])
        x, y, z = into(about_z(np.array([heading_rad])), to_radar_m[None, None])[0, 0]
        return float(self.pattern.gain_towards(math.atan2(y, x), math.atan2(z, math.hypot(x, y))))


@value
class Interference(Propagation):
    r"""Chirps of other radars, mixed with the one being sent, where the filter lets them through.

    .. math::
        \frac{\lambda}{4 \pi R} \sqrt{P_t G_t G_r} \, |H(f_b)|
        \exp 2 \pi i \left( f_0 t + \frac{S t^2}{2} - f_1 u - \frac{S_1 u^2}{2} - \phi \right),
        \quad u = t - \frac{R(t)}{c} - t_1

    on the victim's ramp since t = 0, and on the interferer's since t_1: one way, with the length
    R to each receiver at each sample, so that parallel slopes make a ghost with the range and
    velocity of half of the delay and its drift. Slopes that differ cross: a burst as long as the
    passband over their difference. Gains are those of mid-frame, the wavelength that of the
    victim's middle; no loss of `Hardware.loss`, which is of both ways together, nor of weather.

    The filter is an ideal one, without delay, taken at the instantaneous beat frequency:
    `|H|^2 = 1 / (1 + x^(2 n))`, x the distance from the middle of the band that samples can tell (0
    to the sample rate, or plus and minus half of it for real samples), over its corner. What is
    beyond the band aliases, as after any converter. A real filter rings at the edges of a burst:
    its root mean square differs by 2 % from this one for a burst of 100 samples, by 10 % for 20.

    Brooker 2007; Uysal 2019.
    """

    ramps = "alike"
    interferers: tuple[Interferer, ...]
    """Each another radar."""
    filter_order: int = 8
    """Of the Butterworth filter before the converter, n."""
    filter_corner: float = 1.0
    """Where it has half of the power, over half of the band: 1 at the band's edges."""

    def __post_init__(self) -> None:
        fix = "Give at least one Interferer, with its chirps, power, gain and position."
        found = instances("Interference.interferers", self.interferers, Interferer, fix=fix)
        object.__setattr__(self, "interferers", found)
        if not found:
            need = "a list of at least one interferer"
            raise InvalidSetting("Interference.interferers", got="empty", need=need, fix=fix)
        for name, times in Counter(self.names).items():
            if times > 1:
                raise InvalidSetting(
                    "Interference.interferers",
                    got=f"{times} interferers named {name}",
                    need="a name for each alone",
                    fix="Rename one of them.",
                )
        count(self, "filter_order", at_most=100)
        positive(self, "filter_corner", at_least=0.01, at_most=100.0)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each interferer, given or from its place: interferer-1, interferer-2 ..."""
        return tuple(one.name or f"interferer-{n}" for n, one in enumerate(self.interferers, 1))

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for an interferer at the radar's place, warn of one that is never in the band."""
        radar.known_hardware()
        passband = self._passband(radar.frame.chirp)
        antennas_m = np.array([(0.0, 0.0, 0.0), *radar.array.rx_m])
        for name, interferer in zip(self.names, self.interferers, strict=True):
            at_m = interferer.seen_m(np.array([0.0, radar.frame.mid_frame_s]), scene.ego)
            if np.linalg.norm(at_m[:, None] - antennas_m, axis=-1).min() < _APART_M:
                raise InvalidSetting(
                    f"interferers.{name}.position",
                    got="on the radar",
                    need="away from it: what it receives would be infinite",
                    fix="Move the interferer.",
                )
            low_hz, high_hz = passband.heard_hz(radar.frame.chirp)
            if interferer.band_hz[0] > high_hz or interferer.band_hz[1] < low_hz:
                sent = " to ".join(f"{hz / 1e9:.6g}" for hz in interferer.band_hz)
                finding = Finding(
                    level="warning",
                    setting=f"impairments.interference.interferers.{name}",
                    got=f"sends from {sent} GHz, and is never heard",
                    need=f"frequencies from {low_hz / 1e9:.6g} to {high_hz / 1e9:.6g} GHz",
                    fix="Check its start frequency, slope and duration.",
                )
                warnings.warn(PhysicsWarning(finding), stacklevel=3)

    def add(
        self,
        samples: np.ndarray,
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> None:
        """Add what each interferer sends to the samples of the window."""
        passband = self._passband(radar.frame.chirp)
        at_once = max(1, _AT_ONCE // window.n_times)
        for interferer in self.interferers:
            ramps = _ramps(window, scene.ego, radar, interferer, rng)
            for row in range(0, len(samples), at_once):
                some = slice(row, row + at_once)
                _add(samples[some], window.of(some), scene.ego, radar, interferer, passband, ramps)

    def _passband(self, chirp: Chirp) -> "_Passband":
        half_hz = chirp.sample_rate_hz / 2
        middle_hz = half_hz if chirp.sampling == "complex" else 0.0
        return _Passband(middle_hz, half_hz * self.filter_corner, self.filter_order)


class _Passband(NamedTuple):
    """The filter before the converter."""

    middle_hz: float
    corner_hz: float
    """From the middle to half of the power."""
    order: int

    @property
    def reach_hz(self) -> float:
        """From the middle to the faintest that counts."""
        return self.corner_hz * _FAINTEST ** (-1 / self.order)

    def factors(self, beat_hz: np.ndarray) -> np.ndarray:
        """Amplitude that passes, a ratio."""
        x = (beat_hz - self.middle_hz) / self.corner_hz
        return 1 / np.sqrt(1 + x ** (2 * self.order))

    def heard_hz(self, chirp: Chirp) -> tuple[float, float]:
        """Lowest and highest frequency that passes at some sample."""
        first_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * chirp.adc_start_s
        last_hz = first_hz + chirp.sampled_bandwidth_hz
        return (
            first_hz - self.middle_hz - self.reach_hz,
            last_hz - self.middle_hz + self.reach_hz,
        )


class _Crossings(NamedTuple):
    """Samples of a window at which an interferer is heard."""

    rows: np.ndarray
    """(n,): chirp of the window."""
    columns: np.ndarray
    """(n,): sample of the chirp."""
    ahead_s: np.ndarray
    """(n,): start of the victim's ramp less that of the interferer's."""
    chirps: np.ndarray
    """(n,): place of the interferer's ramp among those that were looked at."""


class _Ramps(NamedTuple):
    """Ramps of an interferer that arrive during a frame."""

    starts_s: np.ndarray
    """(n,), ascending, since time zero."""
    phases: np.ndarray
    """(n,): what each begins with, in turns."""


def _ramps(
    window: Window, ego: Ego, radar: Radar, interferer: Interferer, rng: np.random.Generator
) -> _Ramps:
    """Find those of all chirps of the frame, so that each has one phase in all of them."""
    ramps_s = window.start_s + radar.frame.chirps_s
    delays_s = _delays_s(ramps_s, ego, interferer)
    first_s = ramps_s[0] + window.times_s[0] - delays_s.max()
    last_s = ramps_s[-1] + window.times_s[-1] - delays_s.min()
    must_fit(
        "interference",
        needed_bytes=_RAMP_BYTES * interferer.most_ramps(last_s - first_s),
        fix="Give the interferer a longer interval, or simulate shorter frames.",
    )
    starts_s = interferer.starts_s(first_s, last_s)
    n = len(starts_s)
    return _Ramps(starts_s, np.zeros(n) if interferer.coherent else rng.random(n))


def _delays_s(ramps_s: np.ndarray, ego: Ego, interferer: Interferer) -> np.ndarray:
    """Delay on the way to the radar at the start of each of its ramps."""
    return np.asarray(np.linalg.norm(interferer.seen_m(ramps_s, ego), axis=-1) / SPEED_OF_LIGHT)


def _add(
    samples: np.ndarray,
    window: Window,
    ego: Ego,
    radar: Radar,
    interferer: Interferer,
    passband: _Passband,
    ramps: _Ramps,
) -> None:
    chirp = radar.frame.chirp
    ramps_s = window.start_s + window.starts_s
    delays_s = _delays_s(ramps_s, ego, interferer)
    found = _crossings(window, chirp, interferer, passband, delays_s, ramps.starts_s)
    if not found.rows.size:
        return
    t = window.times_s[found.columns]
    at_m = interferer.seen_m(ramps_s[found.rows] + t, ego)
    start_hz, slope = interferer.start_frequency_hz, interferer.slope_hz_per_s
    # Receivers 10 cm apart see beats 7 kHz apart at 20 MHz/us: one for all in the filter.
    theirs_s = t + found.ahead_s - np.linalg.norm(at_m, axis=-1) / SPEED_OF_LIGHT
    beat_hz = chirp.start_frequency_hz + chirp.slope_hz_per_s * t - start_hz - slope * theirs_s
    passing = passband.factors(beat_hz)
    cycles = chirp.start_frequency_hz * t + chirp.slope_hz_per_s * t**2 / 2
    cycles -= ramps.phases[found.chirps]
    amplitudes = _amplitudes(window, ego, radar, interferer)
    for receiver, (rx_m, amplitude) in enumerate(zip(radar.array.rx_m, amplitudes, strict=True)):
        length_m = np.linalg.norm(at_m - rx_m, axis=-1)
        u = t + found.ahead_s - length_m / SPEED_OF_LIGHT
        turns = cycles - (start_hz + slope * u / 2) * u
        wave = amplitude / length_m * passing * np.exp(2j * np.pi * turns)
        samples[found.rows, receiver, found.columns] += wave


def _amplitudes(window: Window, ego: Ego, radar: Radar, interferer: Interferer) -> np.ndarray:
    """Amplitude in each receiver times the length of the way, (n_rx,), sqrt(W) m (Friis 1946)."""
    mid_s = window.start_s + radar.frame.mid_frame_s
    _, rx_gains = gains(interferer.seen_m(np.array([mid_s]), ego), radar)
    power_w = interferer.transmit_power_w * interferer.gain_towards(mid_s, ego)
    return rx_gains[:, 0] * np.sqrt(power_w) * radar.frame.chirp.wavelength_m / (4 * np.pi)


def _crossings(
    window: Window,
    chirp: Chirp,
    interferer: Interferer,
    passband: _Passband,
    delays_s: np.ndarray,
    starts_s: np.ndarray,
) -> _Crossings:
    """Find them from straight lines of frequency over time, for each pair of ramps that meet."""
    times_s = window.times_s
    ramps_s = window.start_s + window.starts_s
    # Which ramps of the interferer arrive during the samples of each chirp.
    stops = np.searchsorted(starts_s, ramps_s + times_s[-1] - delays_s, side="right")
    ends_s = starts_s + interferer.ramp_duration_s
    firsts = np.searchsorted(ends_s, ramps_s + times_s[0] - delays_s, side="right")
    rows, chirps = _expanded(firsts, np.maximum(stops - firsts, 0))
    ahead_s = ramps_s[rows] - starts_s[chirps]
    on_s = delays_s[rows] - ahead_s  # on the victim's ramp, when that of the interferer arrives
    # The beat frequency is offset + rate t.
    rate = chirp.slope_hz_per_s - interferer.slope_hz_per_s
    offset_hz = chirp.start_frequency_hz - interferer.start_frequency_hz
    offset_hz = offset_hz + interferer.slope_hz_per_s * on_s - passband.middle_hz
    if rate == 0:
        in_s = np.where(abs(offset_hz) <= passband.reach_hz, -np.inf, np.inf)
        out_s = -in_s
    else:
        edges_s = (np.array([[-1.0], [1.0]]) * passband.reach_hz - offset_hz) / rate
        in_s, out_s = edges_s.min(axis=0), edges_s.max(axis=0)
    in_s = np.maximum(in_s, on_s)
    out_s = np.minimum(out_s, on_s + interferer.ramp_duration_s)
    lows, highs = (
        np.ceil(np.clip((edge_s - window.first_s) * window.rate_hz, 0, window.n_times)).astype(int)
        for edge_s in (in_s, out_s)
    )
    pairs, columns = _expanded(lows, np.maximum(highs - lows, 0))
    return _Crossings(rows[pairs], columns, ahead_s[pairs], chirps[pairs])


def _expanded(firsts: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Runs of numbers from each first on, put end to end: whose each is, and the numbers."""
    whose = np.repeat(np.arange(len(firsts)), counts)
    before = np.cumsum(counts) - counts
    return whose, np.arange(len(whose)) + (firsts - before)[whose]
