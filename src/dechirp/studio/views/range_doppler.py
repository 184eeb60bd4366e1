"""The range-Doppler map: what was found and what is there, in cells of range and velocity."""

from dechirp.core.displayed import several
from dechirp.core.words import TIMES, number
from dechirp.report.figures.parts import cell_width, edges
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.views.map_view import MapView
from dechirp.studio.views.places import found_on_map, true_on_map


class RangeDoppler(MapView):
    """Power over velocity and range, with the cursor as a cross."""

    name = "range_doppler"

    def __init__(self, session: Session) -> None:
        super().__init__(
            session, title="Range-Doppler map", x="range, m", y="velocity, m/s (receding +)"
        )

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        range_m, velocity_m_per_s = moment.power.range.values, moment.power.velocity.values
        self.put(edges(range_m), edges(velocity_m_per_s))
        self.draw(moment.power.values, units=str(moment.samples.attrs.get("units", "")))
        found, _ = found_on_map(moment)
        truth, _ = true_on_map(moment)
        self.mark(self.found, *found)
        self.mark(self.truth, *truth)
        self.point(*moment.cursor)

    def tell(self, moment: Moment) -> None:
        """Put into words what is seen."""
        range_m, velocity_m_per_s = moment.power.range.values, moment.power.velocity.values
        n_found = moment.detections.sizes["detection"]
        self.figure.title.text = f"Range-Doppler map: {several(n_found, 'detection')}"
        width_m, width_m_per_s = cell_width(range_m), cell_width(velocity_m_per_s)
        cell = f"{number(width_m, 2)} m {TIMES} {number(width_m_per_s, 2)} m/s"
        self.note.text = f"a cell: {cell}   {self.legend}"

    def cursor_at(self, x: float, y: float) -> Cursor:
        """Where all views look when somebody points here."""
        return Cursor(x, y)
