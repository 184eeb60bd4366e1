"""Lesson 1: the chirp, its echo and the beat signal."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from bokeh.layouts import column
from bokeh.models import UIElement

from dechirp.certificate.reference_trials import reference_radar
from dechirp.certificate.waveform import (
    dechirp_delayed_ramp,
    synthesise_ramp,
    times_and_instantaneous_frequency_hz,
)
from dechirp.core.text import EN_DASH
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.chirp import Chirp
from dechirp.report.labels import TIME_SINCE_RAMP_START_LABEL
from dechirp.studio.teach.lesson import Dial, Experiment, Lesson
from dechirp.studio.theme import Theme
from dechirp.studio.views.line_figure import LineFigure

_MAX_POINTS = 1500
"""Points of a line: more than the pixels of a wide screen."""


@dataclass(frozen=True)
class ChirpSettings:
    """Ramp, range of a static target, and elapsed part of the ramp."""

    bandwidth_mhz: float
    duration_us: float
    range_m: float
    elapsed: float
    """Percentage of the ramp."""

    @property
    def chirp(self) -> Chirp:
        """Reference chirp with that ramp and all samples that fit into it."""
        duration_s, reference = self.duration_us * 1e-6, reference_radar().frame.chirp
        return replace(
            reference,
            slope_hz_per_s=self.bandwidth_mhz * 1e6 / duration_s,
            ramp_duration_s=duration_s,
            n_samples=int(duration_s * reference.sample_rate_hz * (1 + 1e-9)),
        )


@dataclass(frozen=True, eq=False)
class ChirpFrame:
    """Transmitted and received frequencies and the beat signal, up to an instant."""

    chirp: Chirp
    now_s: float
    delay_s: float
    sent_s: np.ndarray
    sent_hz: np.ndarray
    """Frequency above the start of the ramp, as for the echo."""
    echo_s: np.ndarray
    echo_hz: np.ndarray
    beat_s: np.ndarray
    beat: np.ndarray
    """Real part (n,) from the arrival of the echo."""
    beat_hz: float
    """Measured from those samples; NaN for fewer than two."""


def compute_ramps_and_beat(settings: ChirpSettings) -> ChirpFrame:
    """Compute the transmitted and received signals up to an instant."""
    chirp = settings.chirp
    delay_s = 2 * settings.range_m / SPEED_OF_LIGHT
    now_s = settings.elapsed / 100 * chirp.ramp_duration_s
    # Four times the bandwidth keeps phase steps below half a turn.
    rate_hz = 4 * chirp.ramp_bandwidth_hz
    instants_s = np.arange(max(int(now_s * rate_hz), 2)) / rate_hz
    sent_s, sent_hz = times_and_instantaneous_frequency_hz(
        synthesise_ramp(chirp, instants_s), rate_hz
    )
    is_received = sent_s + delay_s <= now_s
    samples_s = np.arange(chirp.n_samples) / chirp.sample_rate_hz
    arrived = (samples_s >= delay_s) & (samples_s <= now_s)
    beat = dechirp_delayed_ramp(chirp, delay_s=delay_s)[arrived]
    _, beat_hz = times_and_instantaneous_frequency_hz(beat, chirp.sample_rate_hz)
    return ChirpFrame(
        chirp=chirp,
        now_s=now_s,
        delay_s=delay_s,
        sent_s=sent_s,
        sent_hz=sent_hz,
        echo_s=sent_s[is_received] + delay_s,
        echo_hz=sent_hz[is_received],
        beat_s=samples_s[arrived],
        beat=beat.real,
        beat_hz=float(np.mean(beat_hz)) if beat_hz.size else np.nan,
    )


class ChirpLesson(Lesson[ChirpSettings, ChirpFrame]):
    """Ramps over time with the beat signal below."""

    title = "The chirp"
    introduction = (
        "The radar transmits a ramp: a tone whose frequency rises. The echo is a delayed copy."
        " The mixer multiplies both and leaves a low tone, the beat. Its frequency is proportional"
        " to the range."
    )
    formulas = (
        (r"f_\mathrm{b} = S\,\tau = \dfrac{2\,S\,R}{c}", "beat of a target at range R"),
        (r"S = \dfrac{B}{T}\,,\quad \Delta R = \dfrac{c}{2B}", "slope; width of a range cell"),
    )
    knobs: ClassVar = {
        "bandwidth_mhz": Dial("Bandwidth B (MHz)", 20, 600, 10, 150),
        "duration_us": Dial("Duration T of the ramp (µs)", 5, 20, 0.1, 7.3),
        "range_m": Dial("Range R of the target (m)", 1, 200, 1, 50),
        "elapsed": Dial("Elapsed part of the ramp (%)", 1, 100, 1, 100),
    }
    animated_dial = ("elapsed", 1)
    experiments = (
        Experiment(
            "Move the target twice as far away",
            {"range_m": 100},
            "The delay doubles, so the difference between the two lines doubles, and with it the"
            " beat frequency.",
        ),
        Experiment(
            "Double the bandwidth",
            {"bandwidth_mhz": 300},
            "The delay is the same, but the ramp is twice as steep, so the beat frequency doubles."
            " Count the cycles of the beat: one for each range cell. Cells are now half as wide.",
        ),
        Experiment(
            "Double the duration at the same bandwidth",
            {"duration_us": 14.6},
            "The slope and the beat frequency are half as large, but the beat lasts twice as long:"
            " again about 50 cycles. Range cells remain 1 m wide, because only the bandwidth"
            " determines their width.",
        ),
        Experiment(
            "Reduce the bandwidth to 20 MHz",
            {"bandwidth_mhz": 20},
            "Fewer than seven cycles are left. A target 3 m farther away would add less than half a"
            " cycle. A range cell is 7.5 m wide, and two targets in one cell look like one.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(ChirpSettings)
        self._ramps = LineFigure(
            x=TIME_SINCE_RAMP_START_LABEL,
            y="Frequency offset from 77 GHz (MHz)",
            x_range=(0, 8),
            y_range=(0, 150),
        )
        self._ramps.add_line("sent", "echo", label="transmitted", line_width=3)
        self._ramps.add_line("echo", "threshold", label="echo", line_width=3)
        self._ramps.add_vertical_lines("gap", "cursor", label="beat frequency now", line_width=2)
        self._ramps.add_marks("ends", "cursor", size=8)
        self._ramps.add_texts("words", "ink", x_offset=8, text_baseline="middle")
        self._ramps.add_legend("top_left")
        self._beat = LineFigure(
            x=TIME_SINCE_RAMP_START_LABEL,
            y="Beat signal, real part",
            x_range=(0, 8),
            y_range=(-1.2, 1.7),
        )
        self._beat.add_vertical_bands("delay", "muted", label="no echo yet", alpha=0.2)
        self._beat.add_line("beat", "track", line_width=1.5)
        self._beat.add_legend("top_left")
        self._root = column(self._ramps.figure, self._beat.figure, sizing_mode="stretch_both")

    @property
    def root_element(self) -> UIElement:
        return self._root

    def compute_frame(self, settings: ChirpSettings, frame_number: int) -> ChirpFrame:
        return compute_ramps_and_beat(settings)

    def draw_frame_and_format_numbers(self, frame: ChirpFrame) -> Mapping[str, str]:
        chirp, now_us = frame.chirp, frame.now_s * 1e6
        # Room for the text beside the end of the ramp, also at 500 pixels.
        ends_us = (0.0, chirp.ramp_duration_s * 1e6 * 1.22)
        top_mhz = chirp.ramp_bandwidth_hz / 1e6
        self._ramps.set_axis_limits(x=ends_us, y=(0.0, top_mhz * 1.05))
        self._beat.set_axis_limits(x=ends_us, y=(-1.2, 1.7))
        for name, time_s, hz in (
            ("sent", frame.sent_s, frame.sent_hz),
            ("echo", frame.echo_s, frame.echo_hz),
        ):
            ends = [0, -1] if time_s.size else []  # straight lines within 1 Hz
            self._ramps.set_data(name, x=time_s[ends] * 1e6, y=hz[ends] / 1e6)
        has_beat = frame.now_s > frame.delay_s and frame.echo_s.size > 0
        low, high = (
            (frame.echo_hz[-1] / 1e6, frame.sent_hz[-1] / 1e6) if has_beat else (np.nan, np.nan)
        )
        self._ramps.set_data("gap", x=[now_us], low=[low], high=[high])
        self._ramps.set_data("ends", x=[now_us, now_us], y=[low, high])
        beat_mhz = frame.beat_hz / 1e6
        beat_text = f"{beat_mhz:.2f} MHz" if np.isfinite(beat_mhz) else ""
        self._ramps.set_data("words", x=[now_us], y=[(low + high) / 2], text=[beat_text])
        step = max(1, frame.beat.size // _MAX_POINTS)
        self._beat.set_data("beat", x=frame.beat_s[::step] * 1e6, y=frame.beat[::step])
        self._beat.set_data("delay", left=[0], right=[frame.delay_s * 1e6])
        cycles = frame.beat.size / chirp.sample_rate_hz * beat_mhz * 1e6
        self._ramps.set_title(
            f"Delay of the echo: {frame.delay_s * 1e6:.2f} µs, in which the ramp rises by"
            f" {chirp.slope_hz_per_s * frame.delay_s / 1e6:.2f} MHz"
        )
        self._beat.set_title(
            f"Beat signal: a tone, {cycles:.1f} cycles so far"
            if np.isfinite(cycles)
            else "Beat signal: none until the echo arrives"
        )
        range_m = SPEED_OF_LIGHT * frame.delay_s / 2
        return {
            "slope S": f"{chirp.slope_hz_per_s / 1e12:.2f} MHz/µs",
            "beat, measured": beat_text or EN_DASH,
            "beat, 2 S R / c": f"{chirp.beat_frequency_hz(range_m) / 1e6:.2f} MHz",
            "range cell c / 2B": f"{chirp.range_resolution_m:.2f} m",
        }

    def apply_theme(self, theme: Theme) -> None:
        for drawing in (self._ramps, self._beat):
            drawing.apply_theme(theme)
