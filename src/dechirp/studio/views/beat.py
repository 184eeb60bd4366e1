"""View of the beat signal of one chirp and its range spectrum."""

import numpy as np
from bokeh.events import Tap
from bokeh.models import LinearAxis, PrintfTickFormatter, Range1d, UIElement

from dechirp.core.text import (
    format_number,
    format_power_of_ten,
    power_level_unit,
    power_to_dbm_or_dbfs,
    sample_unit_symbol,
)
from dechirp.report.figures.beat import engineering_exponent
from dechirp.report.figures.style import reduce_line_to_extremes
from dechirp.report.labels import BEAT_FREQUENCY_LABEL, TIME_SINCE_RAMP_START_LABEL, power_label
from dechirp.studio.browser_events import register_position_callback
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.figure_style import (
    STATIC_LEVEL,
    TEXT_SIZE,
    level_12_db_below_median,
    limits_rounded_to_10_db,
    round_up_to_1_2_5,
)
from dechirp.studio.views.line_figure import LineFigure
from dechirp.studio.views.map_markers import target_map_positions_and_azimuths
from dechirp.studio.views.toggle_tile import ToggleTile, coloured_html

_MAX_BLOCKS = 300  # two points each: as many as a tile has pixels
_SIGNAL, _SPECTRUM = "Signal", "Spectrum"


class BeatView(View):
    """Samples over time, or their spectrum over frequency and range; a tap moves the cursor."""

    name = "beat"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._caption = "", ""
        """Title and note of the last shown frame."""
        self.signal = LineFigure(
            x=TIME_SINCE_RAMP_START_LABEL,
            y="Amplitude",
            x_range=(0, 1),
            y_range=(-1, 1),
            title="",
        )
        self.signal.add_line(
            "imaginary", "muted", label="in quadrature", line_width=1, line_alpha=0.8
        )
        self.signal.add_line("real", "echo", label="in phase", line_width=1.5)
        self.spectrum = LineFigure(
            x=BEAT_FREQUENCY_LABEL, y="Power", x_range=(0, 1), y_range=(-1, 1), title=""
        )
        self.spectrum.add_vertical_lines("truth", "truth", line_width=1.5, line_dash="2 3")
        self.spectrum.add_vertical_lines("cursor", "cursor", line_width=1, line_dash="3 3")
        self.spectrum.add_line("first", "muted", label="first chirp", line_width=1, line_alpha=0.8)
        self.spectrum.add_line("mean", "echo", label="mean over chirps", line_width=1.8)
        self._range_axis = Range1d(0, 1)
        self.spectrum.figure.extra_x_ranges = {"metres": self._range_axis}
        self.spectrum.figure.add_layout(
            LinearAxis(
                x_range_name="metres",
                level=STATIC_LEVEL,
                formatter=PrintfTickFormatter(format="%g m"),
                major_label_text_font_size=TEXT_SIZE,
            ),
            "above",
        )
        register_position_callback(self.spectrum.figure, Tap, self._move_cursor)
        self.tile = ToggleTile(
            self.name,
            {_SIGNAL: self.signal.figure, _SPECTRUM: self.spectrum.figure},
            on_switch=self._redraw_last_frame,
        )
        self.controls = self.tile.switch

    @property
    def root_element(self) -> UIElement:
        return self.tile.root_element

    def show_frame(self, frame_state: FrameState) -> None:
        if self.tile.active_label == _SIGNAL:
            self._draw_signal(frame_state)
        else:
            self._draw_spectrum(frame_state)

    def update_caption(self, frame_state: FrameState) -> None:
        title, note = self._caption
        self.caption.update(title=title, note=note)

    def apply_theme(self, theme: Theme) -> None:
        for drawing in (self.signal, self.spectrum):
            drawing.apply_theme(theme)

    def _draw_signal(self, frame_state: FrameState) -> None:
        samples, time_us = (
            frame_state.beat_and_spectrum.samples,
            frame_state.beat_and_spectrum.time_s * 1e6,
        )
        units = str(frame_state.samples.attrs.get("units", ""))
        parts = {"real": samples.real}
        if np.iscomplexobj(samples):
            parts["imaginary"] = samples.imag
        else:
            self.signal.set_data("imaginary", x=[], y=[])
        top = round_up_to_1_2_5(max(float(abs(part).max()) for part in parts.values()))
        exponent = engineering_exponent(top)
        for name, part in parts.items():
            x, y = reduce_line_to_extremes(time_us, part / 10.0**exponent, _MAX_BLOCKS)
            self.signal.set_data(name, x=x, y=y)
        limit = top / 10.0**exponent
        self.signal.set_axis_limits(x=(float(time_us[0]), float(time_us[-1])), y=(-limit, limit))
        unit = sample_unit_symbol(units)
        unit = unit if exponent == 0 else f"{format_power_of_ten(exponent)} {unit}"
        self.signal.figure.yaxis.axis_label = f"Amplitude ({unit})"
        level_db = float(power_to_dbm_or_dbfs(np.mean(abs(samples) ** 2), units))
        legend = [coloured_html("in phase", "echo")]
        legend += [coloured_html("in quadrature", "muted")] if len(parts) > 1 else []
        self._caption = (
            f"Beat signal: {format_number(level_db, 3)} {power_level_unit(units)}",
            f"chirp 1, receiver 1: {', '.join(legend)}",
        )

    def _draw_spectrum(self, frame_state: FrameState) -> None:
        beat, chirp = frame_state.beat_and_spectrum, frame_state.radar.frame.chirp
        units = str(frame_state.samples.attrs.get("units", ""))
        to_mhz = chirp.beat_frequency_hz(1.0) / 1e6
        frequency_mhz = beat.range_m * to_mhz
        lines = {
            "first": power_to_dbm_or_dbfs(beat.power, units),
            "mean": power_to_dbm_or_dbfs(beat.profile, units),
        }
        for name, level_db in lines.items():
            x, y = reduce_line_to_extremes(frequency_mhz, level_db, _MAX_BLOCKS)
            self.spectrum.set_data(name, x=x, y=y)
        strongest = int(np.argmax(beat.profile))
        highest_db = max(float(level_db.max()) for level_db in lines.values())
        low_db, top_db = limits_rounded_to_10_db(
            level_12_db_below_median(lines["first"]), highest_db
        )
        max_range_m = float(beat.range_m[-1])
        self.spectrum.set_axis_limits(x=(0.0, max_range_m * to_mhz), y=(low_db, top_db))
        if self._range_axis.end != max_range_m:
            self._range_axis.end = max_range_m
        self.spectrum.figure.yaxis.axis_label = power_label(power_level_unit(units))
        true_positions, _ = target_map_positions_and_azimuths(frame_state)
        for name, range_m in (
            ("truth", true_positions.range_m),
            ("cursor", [frame_state.cursor.range_m]),
        ):
            x = np.asarray(range_m) * to_mhz
            self.spectrum.set_data(
                name, x=x, low=np.full(len(x), low_db), high=np.full(len(x), top_db)
            )
        legend = [coloured_html("first chirp", "muted")]
        legend += [coloured_html("mean over chirps", "echo")]
        legend += [coloured_html("truth", "truth")] if len(true_positions.range_m) else []
        self._caption = (
            f"Strongest: {format_number(frequency_mhz[strongest], 3)} MHz,"
            f" {format_number(beat.range_m[strongest], 3)} m",
            f"{format_number(lines['mean'][strongest], 3)} {power_level_unit(units)};"
            f" {', '.join(legend)}",
        )

    def _redraw_last_frame(self) -> None:
        if self.session.frame_state is not None:
            self.show_frame(self.session.frame_state)
            self.update_caption(self.session.frame_state)

    def _move_cursor(self, frequency_mhz: float, _: float) -> None:
        frame_state = self.session.frame_state
        if frame_state is not None:
            range_m = frame_state.radar.frame.chirp.range_m(frequency_mhz * 1e6)
            self.session.move_cursor(frame_state.cursor._replace(range_m=range_m))
