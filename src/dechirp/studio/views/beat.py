"""The beat signal of one chirp, and what is in it: each frequency is a range."""

import numpy as np
from bokeh.events import Tap
from bokeh.models import LinearAxis, PrintfTickFormatter, Range1d, UIElement

from dechirp.core.words import number, power_db, power_of_ten, power_unit
from dechirp.report.figures.beat import engineering_exponent
from dechirp.report.figures.style import thinned
from dechirp.studio.browser import on_place
from dechirp.studio.moment import Moment
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.drawing import Drawing
from dechirp.studio.views.drawn import SELDOM
from dechirp.studio.views.places import true_on_map
from dechirp.studio.views.steady import floor_db, steady_db, steady_top
from dechirp.studio.views.switched import Switched, coloured

_MOST_BLOCKS = 300  # of a line: two points each, as many as a tile has pixels
_SIGNAL, _SPECTRUM = "Signal", "Spectrum"


class Beat(View):
    """Samples over time, or their spectrum over frequency and range; a tap points at a range."""

    name = "beat"
    least_s = 0.19

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._said = "", ""
        """Title and note of what was shown last."""
        self.signal = Drawing(
            x="time since the start of the ramp, µs",
            y="amplitude",
            x_range=(0, 1),
            y_range=(-1, 1),
        )
        self.signal.line("imaginary", "muted", line_width=1, line_alpha=0.8)
        self.signal.line("real", "echo", line_width=1.5)
        self.spectrum = Drawing(x="beat frequency, MHz", y="power", x_range=(0, 1), y_range=(-1, 1))
        self.spectrum.bars("truth", "truth", line_width=1.5, line_dash="2 3")
        self.spectrum.bars("cursor", "cursor", line_width=1, line_dash="3 3")
        self.spectrum.line("first", "muted", line_width=1, line_alpha=0.8)
        self.spectrum.line("mean", "echo", line_width=1.8)
        self._metres = Range1d(0, 1)
        self.spectrum.figure.extra_x_ranges = {"metres": self._metres}
        self.spectrum.figure.add_layout(
            LinearAxis(
                x_range_name="metres",
                level=SELDOM,
                formatter=PrintfTickFormatter(format="%g m"),
                major_label_text_font_size="10px",
            ),
            "above",
        )
        on_place(self.spectrum.figure, Tap, self._point)
        self.tile = Switched(
            self.name,
            {_SIGNAL: self.signal.figure, _SPECTRUM: self.spectrum.figure},
            on_switch=self._again,
        )

    @property
    def root(self) -> UIElement:
        """What the page embeds."""
        return self.tile.root

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        if self.tile.chosen == _SIGNAL:
            self._show_signal(moment)
        else:
            self._show_spectrum(moment)

    def tell(self, moment: Moment) -> None:
        """Put into words what is seen."""
        self.tile.say(*self._said)

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for drawing in (self.signal, self.spectrum):
            drawing.wear(theme)

    def _show_signal(self, moment: Moment) -> None:
        samples, time_us = moment.beat.samples, moment.beat.time_s * 1e6
        units = str(moment.samples.attrs.get("units", ""))
        parts = {"real": samples.real}
        if np.iscomplexobj(samples):
            parts["imaginary"] = samples.imag
        else:
            self.signal.put("imaginary", x=[], y=[])
        top = steady_top(max(float(abs(part).max()) for part in parts.values()))
        exponent = engineering_exponent(top)
        for name, part in parts.items():
            x, y = thinned(time_us, part / 10.0**exponent, _MOST_BLOCKS)
            self.signal.put(name, x=x, y=y)
        reach = top / 10.0**exponent
        self.signal.spans(x=(float(time_us[0]), float(time_us[-1])), y=(-reach, reach))
        unit = units.replace("sqrt(W)", "√W")
        unit = unit if exponent == 0 else f"{power_of_ten(exponent)} {unit}"
        self.signal.figure.yaxis.axis_label = f"amplitude, {unit}"
        level_db = float(power_db(np.mean(abs(samples) ** 2), units))
        kinds = [coloured("in phase", "echo")]
        kinds += [coloured("in quadrature", "muted")] if len(parts) > 1 else []
        self._said = (
            f"Beat signal: {number(level_db, 3)} {power_unit(units)}",
            f"first chirp, first receiver: {', '.join(kinds)}",
        )

    def _show_spectrum(self, moment: Moment) -> None:
        beat, chirp = moment.beat, moment.radar.frame.chirp
        units = str(moment.samples.attrs.get("units", ""))
        to_mhz = chirp.beat_frequency_hz(1.0) / 1e6
        frequency_mhz = beat.range_m * to_mhz
        lines = {"first": power_db(beat.power, units), "mean": power_db(beat.profile, units)}
        for name, level_db in lines.items():
            x, y = thinned(frequency_mhz, level_db, _MOST_BLOCKS)
            self.spectrum.put(name, x=x, y=y)
        strongest = int(np.argmax(beat.profile))
        highest_db = max(float(level_db.max()) for level_db in lines.values())
        low_db, top_db = steady_db(floor_db(lines["first"]), highest_db)
        last_m = float(beat.range_m[-1])
        self.spectrum.spans(x=(0.0, last_m * to_mhz), y=(low_db, top_db))
        if self._metres.end != last_m:
            self._metres.end = last_m
        self.spectrum.figure.yaxis.axis_label = f"power, {power_unit(units)}"
        places, _ = true_on_map(moment)
        for name, range_m in (("truth", places.range_m), ("cursor", [moment.cursor.range_m])):
            x = np.asarray(range_m) * to_mhz
            self.spectrum.put(name, x=x, low=np.full(len(x), low_db), high=np.full(len(x), top_db))
        kinds = [coloured("first chirp", "muted")]
        kinds += [coloured("mean over chirps", "echo")]
        kinds += [coloured("truth", "truth")] if len(places.range_m) else []
        self._said = (
            f"Strongest: {number(frequency_mhz[strongest], 3)} MHz,"
            f" {number(beat.range_m[strongest], 3)} m",
            f"{number(lines['mean'][strongest], 3)} {power_unit(units)}; {', '.join(kinds)}",
        )

    def _again(self) -> None:
        if self.session.moment is not None:
            self.show(self.session.moment)
            self.tell(self.session.moment)

    def _point(self, x: float, _: float) -> None:
        moment = self.session.moment
        if moment is not None:
            range_m = moment.radar.frame.chirp.range_m(x * 1e6)
            self.session.point(moment.cursor._replace(range_m=range_m))
