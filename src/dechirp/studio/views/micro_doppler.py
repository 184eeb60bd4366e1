"""Micro-Doppler: power over velocity and time of what is at the range of the cursor."""

import numpy as np
from bokeh.models import BasicTickFormatter

from dechirp.core.displayed import several
from dechirp.core.words import number
from dechirp.report.figures.parts import edges
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.views.map_view import MapView


class MicroDoppler(MapView):
    """A column of velocities for each moment since the last rewind; a tap points at a velocity."""

    name = "micro_doppler"
    least_s = 0.19

    def __init__(self, session: Session) -> None:
        super().__init__(
            session, title="Micro-Doppler", x="time, s", y="velocity, m/s (receding +)"
        )
        times = self.figure.xaxis[0]
        times.ticker.desired_num_ticks = 4  # they have many decimals
        times.formatter = BasicTickFormatter(use_scientific=False)  # 5.000e-4 is longer still

    def show(self, moment: Moment) -> None:
        """Show a moment."""
        power = moment.micro_doppler.transpose("velocity", "time")
        time_s, velocity_m_per_s = power.time.values, power.velocity.values
        self.put(_reach_s(time_s, moment), edges(velocity_m_per_s))
        self.draw(power.values, units=str(moment.samples.attrs.get("units", "")))
        self.point(None, moment.cursor.velocity_m_per_s)
        now_m_per_s = velocity_m_per_s[int(np.argmax(power.values[:, -1]))]
        self.figure.title.text = f"Micro-Doppler: strongest at {number(now_m_per_s, 2)} m/s now"
        where = (
            "each about its strongest"
            if self.session.cursor is None
            else f"about {number(moment.cursor.range_m, 3)} m"
        )
        self.note.text = f"{several(time_s.size, 'frame')}, {where}"

    def cursor_at(self, x: float, y: float) -> Cursor:
        """Where all views look when somebody points here."""
        moment = self.session.moment
        assert moment is not None
        return moment.cursor._replace(velocity_m_per_s=y)


def _reach_s(time_s: np.ndarray, moment: Moment) -> tuple[float, float]:
    """From the first column to the end of the last; one alone is as wide as its frame."""
    if time_s.size > 1:
        return edges(time_s)
    half_s = moment.radar.frame.duration_s / 2
    return float(time_s[0] - half_s), float(time_s[0] + half_s)
