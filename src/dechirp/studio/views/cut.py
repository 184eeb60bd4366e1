"""Power and threshold along both axes of the map, through the cursor."""

import numpy as np
from bokeh.events import DoubleTap, Tap
from bokeh.models import UIElement

from dechirp.core.units import decibels
from dechirp.core.words import fixed, number, power_db, power_unit
from dechirp.report.figures.cfar import cells_about, searched_db, stretches
from dechirp.report.figures.parts import Axis, edges
from dechirp.report.figures.style import thinned
from dechirp.studio.browser import on_place
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cut as Line
from dechirp.studio.pointing import cell_of
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.drawing import Drawing
from dechirp.studio.views.steady import floor_db, steady_db
from dechirp.studio.views.switched import Switched, coloured

_MOST_BLOCKS = 300
_AXES: dict[str, Axis] = {"Range": "range", "Velocity": "velocity"}
_LABELS = {"range": "range, m", "velocity": "velocity, m/s (receding +)"}


class Cut(View):
    """The cell at the cursor, those that tell its noise, and what it has to exceed."""

    name = "cut"
    least_s = 0.19

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self._said = "", ""
        """Title and note of what was shown last."""
        self.drawings = {along: _drawing(_LABELS[along]) for along in _AXES.values()}
        for drawing in self.drawings.values():
            on_place(drawing.figure, Tap, self._point)
            drawing.figure.on_event(DoubleTap, lambda _: session.point(None))
        figures = {words: self.drawings[along].figure for words, along in _AXES.items()}
        self.tile = Switched(self.name, figures, on_switch=self._again)

    @property
    def root(self) -> UIElement:
        """What the page embeds."""
        return self.tile.root

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        along = self._along
        drawing, line, at = self.drawings[along], *_through(moment, along)
        units = str(moment.samples.attrs.get("units", ""))
        level_db, threshold_db = power_db(line.power, units), searched_db(line.threshold, units)
        drawing.put("power", **_xy(line.at, level_db))
        drawing.put("threshold", **_xy(line.at, threshold_db))
        drawing.put("cell", x=line.at[[at]], y=level_db[[at]])
        training, guard = cells_about(at, line.at.size, moment.chain.cfar, along=along)
        for name, cells in (("training", training), ("guard", guard)):
            ends = np.reshape(stretches(line.at, cells), (-1, 2))
            drawing.put(name, left=ends[:, 0], right=ends[:, 1])
        highest_db = max(float(level_db.max()), float(np.nanmax(threshold_db, initial=-np.inf)))
        drawing.spans(x=edges(line.at), y=steady_db(floor_db(level_db), highest_db))
        drawing.figure.yaxis.axis_label = f"power, {power_unit(units)}"
        range_m, velocity_m_per_s = moment.cursor
        self._said = (
            _over(line, at),
            f"at {number(range_m, 3)} m, {number(velocity_m_per_s, 3)} m/s:"
            f" {coloured('power', 'echo')}, {coloured('threshold', 'threshold')};"
            " shaded: training",
        )

    def tell(self, moment: Moment) -> None:
        """Put into words what is seen."""
        self.tile.say(*self._said)

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        for drawing in self.drawings.values():
            drawing.wear(theme)

    @property
    def _along(self) -> Axis:
        return _AXES[self.tile.chosen]

    def _again(self) -> None:
        if self.session.moment is not None:
            self.show(self.session.moment)
            self.tell(self.session.moment)

    def _point(self, x: float, _: float) -> None:
        moment = self.session.moment
        if moment is not None:
            at = moment.cursor
            self.session.point(
                at._replace(range_m=x)
                if self._along == "range"
                else at._replace(velocity_m_per_s=x)
            )


def _drawing(label: str) -> Drawing:
    made = Drawing(x=label, y="power", x_range=(0, 1), y_range=(0, 1))
    made.bands("training", "echo", alpha=0.16)
    made.bands("guard", "muted", alpha=0.12)
    made.line("power", "echo", line_width=1.6)
    made.line("threshold", "threshold", line_width=1.6)
    made.marks("cell", "cursor", size=7)
    return made


def _through(moment: Moment, along: Axis) -> tuple[Line, int]:
    """Cells along an axis, and which of them the cursor is in."""
    row, column = cell_of(moment.power, moment.cursor)
    over_range, over_velocity = moment.cuts
    return (over_range, column) if along == "range" else (over_velocity, row)


def _xy(at: np.ndarray, level_db: np.ndarray) -> dict[str, np.ndarray]:
    x, y = thinned(at, level_db, _MOST_BLOCKS)
    return {"x": x, "y": y}


def _over(line: Line, at: int) -> str:
    power, threshold = float(line.power[at]), float(line.threshold[at])
    if not (power > 0 and 0 < threshold < np.inf):
        return "Nothing is searched for here"
    over_db = float(decibels(power / threshold))
    side = "over" if over_db > 0 else "under"
    return f"{fixed(abs(over_db), 1)} dB {side} the threshold"
