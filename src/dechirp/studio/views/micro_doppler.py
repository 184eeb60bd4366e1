"""Micro-Doppler view: power over velocity and time at the range of the cursor."""

import numpy as np
from bokeh.models import BasicTickFormatter

from dechirp.core.display import format_count_with_noun
from dechirp.core.text import format_number
from dechirp.report.figures.common import outer_cell_edges
from dechirp.report.labels import TIME_LABEL
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.views.figure_style import VELOCITY_TILE_LABEL
from dechirp.studio.views.map_view import MapView


class MicroDopplerView(MapView):
    """Column of velocities for each frame since the last rewind; a tap moves the cursor."""

    name = "micro_doppler"

    def __init__(self, session: Session) -> None:
        super().__init__(session, x=TIME_LABEL, y=VELOCITY_TILE_LABEL)
        self._caption = "", ""
        """Title and note of the last shown frame."""
        times = self.figure.xaxis[0]
        times.ticker.desired_num_ticks = 4  # their labels have many decimals
        times.formatter = BasicTickFormatter(use_scientific=False)  # 5.000e-4 would be longer

    def show_frame(self, frame_state: FrameState) -> None:
        micro_doppler = frame_state.micro_doppler
        variables = micro_doppler.coords.variables  # labelled access takes 35 µs
        time_s, velocity_m_per_s = variables["time"].values, variables["velocity"].values
        power = micro_doppler.variable.transpose("velocity", "time").values
        self.set_image_extent(
            _time_axis_limits_s(time_s, frame_state), outer_cell_edges(velocity_m_per_s)
        )
        self.draw_power(power, units=str(frame_state.samples.attrs.get("units", "")))
        self.draw_cursor(None, frame_state.cursor.velocity_m_per_s)
        now_m_per_s = velocity_m_per_s[int(np.argmax(power[:, -1]))]
        where = (
            "each about its strongest"
            if self.session.cursor is None
            else f"about {format_number(frame_state.cursor.range_m, 3)} m"
        )
        self._caption = (
            f"Micro-Doppler: strongest at {format_number(now_m_per_s, 2)} m/s now",
            f"{format_count_with_noun(time_s.size, 'frame')}, {where}",
        )

    def update_caption(self, frame_state: FrameState) -> None:
        title, note = self._caption
        self.caption.update(title=title, note=note)

    def cursor_at_position(self, x: float, y: float) -> Cursor:
        frame_state = self.session.frame_state
        assert frame_state is not None
        return frame_state.cursor._replace(velocity_m_per_s=y)


def _time_axis_limits_s(time_s: np.ndarray, frame_state: FrameState) -> tuple[float, float]:
    """Return the time limits of the columns; a single column has the width of its frame."""
    if time_s.size > 1:
        return outer_cell_edges(time_s)
    half_s = frame_state.radar.frame.duration_s / 2
    return float(time_s[0] - half_s), float(time_s[0] + half_s)
