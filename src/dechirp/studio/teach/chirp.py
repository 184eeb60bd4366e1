"""Lesson 1: the chirp. What is sent, what comes back, and the beat between them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from bokeh.layouts import column
from bokeh.models import UIElement

from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.words import NONE
from dechirp.experiment.verify.looks import radar
from dechirp.experiment.verify.waveform import dechirped, instantaneous_frequency_hz, synthesised
from dechirp.radar.chirp import Chirp
from dechirp.studio.teach.lesson import Dial, Lesson, Try
from dechirp.studio.theme import Theme
from dechirp.studio.views.drawing import Drawing

_MOST_POINTS = 1500
"""Of a line: more than the pixels that a wide screen has for it."""


@dataclass(frozen=True)
class Settings:
    """A ramp, a target at rest, and how much of the ramp is over."""

    bandwidth_mhz: float
    duration_us: float
    range_m: float
    elapsed: float
    """In percent of the ramp."""

    @property
    def chirp(self) -> Chirp:
        """The reference chirp with that ramp; as many samples as it has time for."""
        duration_s, reference = self.duration_us * 1e-6, radar().frame.chirp
        return replace(
            reference,
            slope_hz_per_s=self.bandwidth_mhz * 1e6 / duration_s,
            ramp_duration_s=duration_s,
            n_samples=int(duration_s * reference.sample_rate_hz * (1 + 1e-9)),
        )


@dataclass(frozen=True, eq=False)
class Seen:
    """The frequencies that are sent and come back, and the beat, up to an instant."""

    chirp: Chirp
    now_s: float
    delay_s: float
    sent_s: np.ndarray
    sent_hz: np.ndarray
    """Over the start of the ramp; so is that of the echo."""
    echo_s: np.ndarray
    echo_hz: np.ndarray
    beat_s: np.ndarray
    beat: np.ndarray
    """Real part, (n,), from the arrival of the echo on."""
    beat_hz: float
    """Measured on those samples; not a number before there are two."""


def seen(at: Settings) -> Seen:
    """What has been sent and received at that instant."""
    chirp = at.chirp
    delay_s = 2 * at.range_m / SPEED_OF_LIGHT
    now_s = at.elapsed / 100 * chirp.ramp_duration_s
    # Four times the bandwidth: steps of the phase stay below half a turn.
    rate_hz = 4 * chirp.ramp_bandwidth_hz
    instants_s = np.arange(max(int(now_s * rate_hz), 2)) / rate_hz
    sent_s, sent_hz = instantaneous_frequency_hz(synthesised(chirp, instants_s), rate_hz)
    back = sent_s + delay_s <= now_s
    samples_s = np.arange(chirp.n_samples) / chirp.sample_rate_hz
    arrived = (samples_s >= delay_s) & (samples_s <= now_s)
    beat = dechirped(chirp, delay_s=delay_s)[arrived]
    _, beat_hz = instantaneous_frequency_hz(beat, chirp.sample_rate_hz)
    return Seen(
        chirp=chirp,
        now_s=now_s,
        delay_s=delay_s,
        sent_s=sent_s,
        sent_hz=sent_hz,
        echo_s=sent_s[back] + delay_s,
        echo_hz=sent_hz[back],
        beat_s=samples_s[arrived],
        beat=beat.real,
        beat_hz=float(np.mean(beat_hz)) if beat_hz.size else np.nan,
    )


class ChirpLesson(Lesson[Settings, Seen]):
    """The ramps over time, and the beat signal below them."""

    title = "The chirp"
    says = (
        "The radar sends a ramp: a tone whose frequency rises. The echo is the same ramp, later."
        " Mixed with what is being sent by then, it leaves one low tone, the beat. Its frequency"
        " is the distance."
    )
    formulas = (
        (r"f_\mathrm{b} = S\,\tau = \dfrac{2\,S\,R}{c}", "beat of a target at range R"),
        (r"S = \dfrac{B}{T}\,,\quad \Delta R = \dfrac{c}{2B}", "slope; width of a range cell"),
    )
    knobs: ClassVar = {
        "bandwidth_mhz": Dial("Bandwidth B, MHz", 20, 600, 10, 150),
        "duration_us": Dial("Duration T of the ramp, µs", 5, 20, 0.1, 7.3),
        "range_m": Dial("Range R of the target, m", 1, 200, 1, 50),
        "elapsed": Dial("Part of the ramp that is over, %", 1, 100, 1, 100),
    }
    moves = ("elapsed", 1)
    tries = (
        Try(
            "Move the target twice as far away",
            {"range_m": 100},
            "The echo comes twice as late, so the ramp has gone on twice as far: the gap between"
            " the two lines doubles, and with it the beat frequency.",
        ),
        Try(
            "Double the bandwidth",
            {"bandwidth_mhz": 300},
            "The delay is the same, the ramp is twice as steep: the beat doubles. Count its"
            " cycles: one for each range cell, and cells are half as wide now.",
        ),
        Try(
            "Take twice the time for the same bandwidth",
            {"duration_us": 14.6},
            "Half the slope, half the beat frequency, but twice the time to watch it: the same"
            " 50 cycles. So range cells stay 1 m wide: bandwidth alone decides.",
        ),
        Try(
            "Send hardly any bandwidth: 20 MHz",
            {"bandwidth_mhz": 20},
            "Not seven cycles are left. A target 3 m farther would add less than half a cycle: a"
            " range cell is 7.5 m wide, and targets in one cell look like one.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(Settings)
        self._ramps = Drawing(
            x="time since the start of the ramp, µs",
            y="frequency over 77 GHz, MHz",
            x_range=(0, 8),
            y_range=(0, 150),
        )
        self._ramps.line("sent", "echo", label="sent", line_width=3)
        self._ramps.line("echo", "threshold", label="echo", line_width=3)
        self._ramps.bars("gap", "cursor", label="beat: the gap now", line_width=2)
        self._ramps.marks("ends", "cursor", size=8)
        self._ramps.texts("words", "ink", x_offset=8, text_baseline="middle")
        self._ramps.explained("top_left")
        self._beat = Drawing(
            x="time since the start of the ramp, µs",
            y="beat signal, real part",
            x_range=(0, 8),
            y_range=(-1.2, 1.7),
        )
        self._beat.bands("delay", "muted", label="no echo yet", alpha=0.2)
        self._beat.line("beat", "track", line_width=1.5)
        self._beat.explained("top_left")
        self._root = column(self._ramps.figure, self._beat.figure, sizing_mode="stretch_both")

    @property
    def root(self) -> UIElement:
        """Its figures."""
        return self._root

    def look(self, at: Settings, number: int) -> Seen:
        """What is seen with those settings."""
        return seen(at)

    def show(self, seen: Seen) -> Mapping[str, str]:
        """Draw it, and give the numbers beside it."""
        chirp, now_us = seen.chirp, seen.now_s * 1e6
        ends_us = (0.0, chirp.ramp_duration_s * 1e6 * 1.14)
        top_mhz = chirp.ramp_bandwidth_hz / 1e6
        self._ramps.spans(x=ends_us, y=(0.0, top_mhz * 1.05))
        self._beat.spans(x=ends_us, y=(-1.2, 1.7))
        for name, time_s, hz in (
            ("sent", seen.sent_s, seen.sent_hz),
            ("echo", seen.echo_s, seen.echo_hz),
        ):
            ends = [0, -1] if time_s.size else []  # they are straight, to 1 Hz
            self._ramps.put(name, x=time_s[ends] * 1e6, y=hz[ends] / 1e6)
        here = seen.now_s > seen.delay_s and seen.echo_s.size > 0
        low, high = (seen.echo_hz[-1] / 1e6, seen.sent_hz[-1] / 1e6) if here else (np.nan, np.nan)
        self._ramps.put("gap", x=[now_us], low=[low], high=[high])
        self._ramps.put("ends", x=[now_us, now_us], y=[low, high])
        beat_mhz = seen.beat_hz / 1e6
        words = f"{beat_mhz:.2f} MHz" if np.isfinite(beat_mhz) else ""
        self._ramps.put("words", x=[now_us], y=[(low + high) / 2], text=[words])
        step = max(1, seen.beat.size // _MOST_POINTS)
        self._beat.put("beat", x=seen.beat_s[::step] * 1e6, y=seen.beat[::step])
        self._beat.put("delay", left=[0], right=[seen.delay_s * 1e6])
        cycles = seen.beat.size / chirp.sample_rate_hz * beat_mhz * 1e6
        self._ramps.called(
            f"The echo is {seen.delay_s * 1e6:.2f} µs late:"
            f" by then the ramp has risen {chirp.slope_hz_per_s * seen.delay_s / 1e6:.2f} MHz"
        )
        self._beat.called(
            f"The beat: one tone, {cycles:.1f} cycles so far"
            if np.isfinite(cycles)
            else "The beat: nothing, until the echo is there"
        )
        range_m = SPEED_OF_LIGHT * seen.delay_s / 2
        return {
            "slope S": f"{chirp.slope_hz_per_s / 1e12:.2f} MHz/µs",
            "beat, measured": words or NONE,
            "beat, 2 S R / c": f"{chirp.beat_frequency_hz(range_m) / 1e6:.2f} MHz",
            "range cell c / 2B": f"{chirp.range_resolution_m:.2f} m",
        }

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for drawing in (self._ramps, self._beat):
            drawing.wear(theme)
