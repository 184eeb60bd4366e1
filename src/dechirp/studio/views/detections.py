"""The detections of a moment as a table, strongest first."""

import numpy as np
from bokeh.models import UIElement

from dechirp.core.displayed import several
from dechirp.core.units import decibels
from dechirp.core.words import NONE
from dechirp.evaluate.match import Matcher
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.listed import MOST_ROWS, Head, Listed, at_cursor
from dechirp.studio.views.places import found_on_map, strongest_first

_HEADS = {
    "range": Head("range, m", "0.000"),
    "range_std": Head("± m", "0.0000", 45),
    "velocity": Head("velocity, m/s", "0.000", 75),
    "velocity_std": Head("± m/s", "0.0000", 45),
    "azimuth": Head("azimuth, °", "0.00"),
    "azimuth_std": Head("± °", "0.00", 45),
    "elevation": Head("elevation, °", "0.00"),
    "elevation_std": Head("± °", "0.00", 45),
    "snr": Head("SNR, dB", "0.0"),
    "target": Head("target", width=90),
}
_ANGLES = ("azimuth", "azimuth_std", "elevation", "elevation_std")
_NO_TARGET = "none"


class Detections(View):
    """Estimates with standard errors, and whose they are; a row that is picked moves the cursor."""

    name = "detections"
    least_s = 0.19

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.listed = Listed(self.name, _HEADS, on_pick=session.point)

    @property
    def root(self) -> UIElement:
        """What the page embeds."""
        return self.listed.root

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        targets = self._targets(moment)
        columns = columns_of(moment) | {"target": targets}
        places, _ = found_on_map(moment)
        cursors = [Cursor(*map(float, place)) for place in zip(*places, strict=True)]
        shown = {key: bool(np.isfinite(of).any()) for key, of in columns.items() if key in _ANGLES}
        self.listed.show_columns(shown | {"target": moment.truth is not None})
        self.listed.show(
            _said(targets, moment),
            columns,
            cursors=cursors,
            marked=at_cursor(places, moment),
        )

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: its variables reach into the table by themselves."""

    def _targets(self, moment: Moment) -> np.ndarray:
        """Name of the target of each detection, strongest first."""
        scenario, truth = self.session.scenario, moment.truth
        order = strongest_first(moment)
        if truth is None or scenario.radar is None:
            return np.full(order.size, NONE, dtype=object)
        columns = {str(name): column.values for name, column in moment.detections.items()}
        target = Matcher(truth, scenario.radar, scenario.scene).targets(columns)[order]
        names = np.array([*truth.target.values.tolist(), _NO_TARGET], dtype=object)
        return np.asarray(names[target])


def columns_of(moment: Moment) -> dict[str, np.ndarray]:
    """Columns of the detections, strongest first: angles in degrees, the ratio in dB."""
    found, order = moment.detections, strongest_first(moment)
    columns = {key: found[key].values[order] for key in _HEADS if key in found}
    columns |= {key: np.degrees(columns[key]) for key in _ANGLES}
    return columns | {"snr": decibels(columns["snr"])}


def _said(targets: np.ndarray, moment: Moment) -> str:
    """How many there are, and how many of them are of targets."""
    n = targets.size
    said = "Nothing detected" if n == 0 else several(n, "detection")
    if n > MOST_ROWS:
        said = f"The strongest {MOST_ROWS} of {said}"
    if moment.truth is None:
        return said
    names = moment.truth.target.values.tolist()
    n_found = len(set(targets.tolist()) & set(names))
    said += f": {n_found} of {several(len(names), 'target')} found" if names else ""
    return f"{said}, {int(np.sum(targets == _NO_TARGET))} of no target" if n else said
