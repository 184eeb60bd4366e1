"""Lesson 3: many chirps. Velocity from the phase, the map, and what is detected in it."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColorBar, ColumnDataSource, LinearColorMapper, UIElement

from dechirp.core.units import decibels
from dechirp.core.words import number
from dechirp.radar.radar import Radar
from dechirp.studio.teach.lesson import Choice, Dial, Lesson, Try
from dechirp.studio.teach.mixers import GUARDS, NO_RAMP, RAMP, Mixed, Seen, Settings, seen
from dechirp.studio.theme import Theme
from dechirp.studio.views.drawing import Drawing

_REACH_M_PER_S = 70.0
"""Of the axes of velocity."""
_ADDED, _WHOLE = "chirps are added", "whole frames follow"
_RANGE, _BEAT = "range, m", "beat frequency, MHz"
_LOW_DB, _HIGH_DB = -5.0, 45.0


class DopplerLesson(Lesson[Settings, Seen]):
    """The maps of two mixers and of one; below the phase over chirps, and the threshold."""

    title = "128 chirps: velocity and detection"
    says = (
        "From chirp to chirp the target moves by parts of a wavelength, and the phase of its beat"
        " turns. A second transform over the chirps makes of that turning a velocity. A cell"
        " that stands out from the cells around it is a detection."
    )
    formulas = (
        (r"f_\mathrm{D} = \dfrac{2v}{\lambda}\,,\quad \Delta v = \dfrac{\lambda}{2MT}", "Doppler"),
        (
            r"\alpha = K\left(P_\mathrm{fa}^{-1/K} - 1\right)",
            "threshold over the mean of K training cells",
        ),
    )
    knobs: ClassVar = {
        "velocity_m_per_s": Dial("Velocity, receding positive, m/s", -60, 60, 1, 20),
        "ramp": Choice("Ramp", (RAMP, NO_RAMP), RAMP),
        "guard": Choice("Guard cells on each side", tuple(GUARDS), "4 cells"),
        "false_alarms": Choice("False alarms in a cell", ("1e-6", "1e-4", "1e-3"), "1e-6"),
        "n_chirps": Dial("Chirps M summed of 128", 4, 128, 4, 128),
        "play": Choice("As it plays", (_ADDED, _WHOLE), _ADDED),
    }
    moves = ("n_chirps", 4)
    tries = (
        Try(
            "Let the target approach",
            {"velocity_m_per_s": -20},
            "The phase turns the other way, and the peak moves to minus 20 m/s. With a ramp one"
            " mixer sees it too: the half of its spectrum that is kept has one peak.",
        ),
        Try(
            "Stop the ramp: a carrier",
            {"ramp": NO_RAMP},
            "One mixer gives real samples: its phase only flips. So it shows plus and minus"
            " 20 m/s alike, and the sign is lost. Two mixers still know it. All ranges fall"
            " into one column.",
        ),
        Try(
            "The carrier, and a target that approaches",
            {"ramp": NO_RAMP, "velocity_m_per_s": -20},
            "Right, the same picture as before; left, another one. The report says that one mixer"
            " loses the sign: true without a ramp, and only then.",
        ),
        Try(
            "Take the guard cells away",
            {"guard": "none"},
            "The target's own skirts now count as noise: the threshold rises beside it, and would"
            " hide a weaker neighbour.",
        ),
        Try(
            "Allow more false alarms",
            {"false_alarms": "1e-3", "play": _WHOLE},
            "The threshold comes down, and about one cell in 1,000 exceeds it by noise alone."
            " Play: they come elsewhere in each frame, the target stays.",
        ),
    )

    def __init__(self) -> None:
        super().__init__(Settings)
        self._mapper = LinearColorMapper(low=_LOW_DB, high=_HIGH_DB, palette=["#000", "#fff"])
        self._two, self._one = _Map(self._mapper), _Map(self._mapper)
        bar = ColorBar(
            color_mapper=self._mapper,
            width=8,
            padding=2,
            margin=2,
            title="over the noise, dB",
            title_text_font_size="11px",
            title_text_font_style="normal",
        )
        self._one.figure.add_layout(bar, "right")
        self._phase = Drawing(
            x="chirp",
            y="phase of the target's beat, turns",
            x_range=(-1, 128),
            y_range=(-0.55, 0.75),
        )
        self._phase.marks("one", "threshold", label="one mixer", size=5, marker="triangle")
        self._phase.marks("two", "echo", label="two mixers", size=5)
        self._phase.explained(orientation="horizontal")
        self._cut = Drawing(
            x="velocity, m/s (receding positive)",
            y="power over the noise, dB",
            x_range=(-_REACH_M_PER_S, _REACH_M_PER_S),
            y_range=(_LOW_DB - 5, _HIGH_DB + 18),
        )
        self._cut.bands("training", "echo", label="training", alpha=0.15)
        self._cut.bands("guard", "muted", label="guard", alpha=0.25)
        self._cut.line("one", "threshold", label="one mixer", line_width=1.2, line_dash="dashed")
        self._cut.line("two", "echo", label="two mixers", line_width=2)
        self._cut.line("threshold", "track", label="threshold", line_width=2)
        self._cut.explained(orientation="horizontal")
        self._root = column(
            row(self._two.figure, self._one.figure, sizing_mode="stretch_both"),
            row(self._phase.figure, self._cut.figure, sizing_mode="stretch_both"),
            sizing_mode="stretch_both",
        )

    @property
    def root(self) -> UIElement:
        """Its figures."""
        return self._root

    def look(self, at: Settings, number: int) -> Seen:
        """What is seen with those settings."""
        return seen(at, number)

    def show(self, seen: Seen) -> Mapping[str, str]:
        """Draw it, and give the numbers beside it."""
        two, one, at = seen.two, seen.one, seen.at
        by = at.radar("complex")
        for map_, of, name in ((self._two, two, "Two mixers"), (self._one, one, "One mixer")):
            map_.show(of, by, over=_BEAT if at.ramp == NO_RAMP else _RANGE)
            strongest = of.velocity_m_per_s[np.argmax(of.power[:, of.column])]
            image = at.ramp == NO_RAMP and of is one and at.velocity_m_per_s
            said = "a peak and its image" if image else f"a peak at {strongest:+.1f} m/s"
            map_.called(f"{name}: {said}")
        for name, of in (("two", two), ("one", one)):
            self._phase.put(name, x=np.arange(of.turns.size), y=of.turns)
            self._cut.put(name, x=of.velocity_m_per_s, y=_db(of.power[:, of.column]))
        self._phase.called(f"The phase turns from chirp to chirp: {by.frame.n_chirps} of 128")
        self._cut.called("Through the target along velocity")
        self._show_threshold(seen)
        frame = by.frame
        waits = "at 128 chirps"
        return {
            "velocity bin λ / 2MT": f"{frame.velocity_resolution_m_per_s:.2f} m/s",
            "unambiguous up to": f"±{frame.max_velocity_m_per_s:.0f} m/s",
            "false alarms here": waits if two.threshold is None else f"{two.n_over:,}",
            "of all cells, expected": number(two.n_tested * float(at.false_alarms), 2),
        }

    def _show_threshold(self, seen: Seen) -> None:
        two, ring = seen.two, seen.ring
        if two.threshold is None:
            self._cut.put("threshold", x=[], y=[])
            self._cut.put("training", left=[], right=[])
            self._cut.put("guard", left=[], right=[])
            return
        self._cut.put("threshold", x=two.velocity_m_per_s, y=_db(two.threshold[:, two.column]))
        step = float(two.velocity_m_per_s[1] - two.velocity_m_per_s[0])
        peak = two.velocity_m_per_s[np.argmax(two.power[:, two.column])]
        inner, outer = ((n + 0.5) * step for n in (ring.n_guard.velocity, ring.half_velocity))
        self._cut.put(
            "training", left=[peak - outer, peak + inner], right=[peak - inner, peak + outer]
        )
        self._cut.put("guard", left=[peak - inner], right=[peak + inner])

    def onward(self, values: Mapping[str, Any]) -> Mapping[str, float]:
        """More chirps in the next frame, or as many."""
        return {} if values["play"] == _WHOLE else super().onward(values)

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for drawing in (self._two, self._one, self._phase, self._cut):
            drawing.wear(theme)
        self._mapper.palette = list(theme.map)


class _Map(Drawing):
    """A range-Doppler map, with a circle about each cell over threshold."""

    def __init__(self, mapper: LinearColorMapper) -> None:
        super().__init__(
            x=_RANGE,
            y="velocity, m/s (receding positive)",
            x_range=(35, 65),
            y_range=(-_REACH_M_PER_S, _REACH_M_PER_S),
        )
        self._image = ColumnDataSource({key: [] for key in ("image", "x", "y", "dw", "dh")})
        self.figure.image("image", "x", "y", "dw", "dh", source=self._image, color_mapper=mapper)
        self.figure.grid.visible = False
        self.marks("over", "threshold", size=5)

    def show(self, of: Mixed, by: Radar, *, over: str) -> None:
        """Draw the columns about the target."""
        chirp, frame = by.frame.chirp, by.frame
        first = max(of.column - 15, 0)
        last = first + (30 if first else 12)
        bins_hz = chirp.sample_rate_hz / chirp.n_samples
        step = chirp.range_m(bins_hz) if over == _RANGE else bins_hz / 1e6
        self.figure.xaxis[0].axis_label = over
        ends = ((first - 0.5) * step, (last - 0.5) * step)
        up = frame.velocity_resolution_m_per_s
        low = float(of.velocity_m_per_s[0]) - up / 2
        self.spans(x=ends, y=(self.figure.y_range.start, self.figure.y_range.end))
        self._image.data = {
            "image": [_db(of.power[:, first:last])],
            "x": [ends[0]],
            "y": [low],
            "dw": [ends[1] - ends[0]],
            "dh": [up * len(of.power)],
        }
        cells = np.empty((0, 2), int)
        if of.threshold is not None:
            cells = np.argwhere(of.power[:, first:last] > of.threshold[:, first:last])
        self.put("over", x=(cells[:, 1] + first) * step, y=of.velocity_m_per_s[cells[:, 0]])


def _db(power: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.maximum(decibels(power), _LOW_DB - 5).astype(np.float32)
