"""The range-azimuth map: power over direction, what is on the left to the left, and over range."""

import numpy as np

from dechirp.core.words import number
from dechirp.report.figures.parts import edges
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.views.map_view import MapView
from dechirp.studio.views.places import found_on_map, true_on_map

_TITLE = "Range-azimuth map"
_STEPS = 120  # as many as a small tile has pixels: 1.3 degrees, where a beam has some 10


class RangeAzimuth(MapView):
    """Power over azimuth and range, with a line at the range of the cursor."""

    name = "range_azimuth"

    def __init__(self, session: Session) -> None:
        super().__init__(session, title=_TITLE, x="azimuth, ° (left +)", y="range, m")

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        power = moment.azimuth_power
        if power is None:
            self._show_none(moment)
            return
        self._bar.visible = True
        azimuth_deg = np.degrees(power.azimuth.values)
        at_deg = np.linspace(azimuth_deg[0], azimuth_deg[-1], _STEPS)
        right, left = edges(at_deg)
        self.put((left, right), edges(power.range.values))
        nearest = abs(azimuth_deg - at_deg[:, None]).argmin(axis=1)
        self.draw(
            power.transpose("range", "azimuth").values[:, nearest],
            units=str(moment.samples.attrs.get("units", "")),
        )
        found, found_rad = found_on_map(moment)
        truth, truth_rad = true_on_map(moment)
        self.mark(self.found, np.degrees(found_rad), found.range_m)
        self.mark(self.truth, np.degrees(truth_rad), truth.range_m)
        self.point(None, moment.cursor.range_m)

    def tell(self, moment: Moment) -> None:
        """Put into words what is seen."""
        if moment.azimuth_power is None:
            self.figure.title.text = f"{_TITLE}: this array tells no azimuth"
            self.note.text = "Give it elements at several places along y."
            return
        found, found_rad = found_on_map(moment)
        self.figure.title.text = f"{_TITLE}: {_strongest(np.degrees(found_rad), found.range_m)}"
        self.note.text = f"{self.legend}   ┄ range of the cursor"

    def cursor_at(self, x: float, y: float) -> Cursor:
        """Where all views look when somebody points here: at the same velocity as before."""
        moment = self.session.moment
        return Cursor(y, 0.0 if moment is None else moment.cursor.velocity_m_per_s)

    def _show_none(self, moment: Moment) -> None:
        self.put((90.0, -90.0), edges(moment.power.range.values))
        self._bar.visible = False
        self.image.data = {"image": [np.zeros((1, 1), np.uint8)]}
        for marks in (self.found, self.truth):
            self.mark(marks, np.empty(0), np.empty(0))
        self.point(None, None)


def side(azimuth_deg: float) -> str:
    """Write 3.1° left, 3.1° right or 0.0°."""
    words = "" if abs(azimuth_deg) < 0.05 else " left" if azimuth_deg > 0 else " right"
    return f"{abs(azimuth_deg):.1f}°{words}"


def _strongest(azimuth_deg: np.ndarray, range_m: np.ndarray) -> str:
    told = np.flatnonzero(np.isfinite(azimuth_deg))
    if not told.size:
        return "no directions"
    first = told[0]
    return f"peak {side(azimuth_deg[first])}, {number(range_m[first], 3)} m"
