"""Range-Doppler map view with detections and targets."""

from dechirp.core.display import format_count_with_noun
from dechirp.core.text import TIMES_SIGN, format_number
from dechirp.report.figures.common import outer_cell_edges, uniform_cell_width
from dechirp.report.labels import RANGE_LABEL
from dechirp.studio.cursor import Cursor, map_velocities_and_ranges
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.views.figure_style import VELOCITY_TILE_LABEL
from dechirp.studio.views.map_markers import (
    detection_map_positions_and_azimuths,
    target_map_positions_and_azimuths,
)
from dechirp.studio.views.map_view import MapView


class RangeDopplerView(MapView):
    """Power over velocity and range, with the cursor as a cross."""

    name = "range_doppler"
    frames_per_update = 1

    def __init__(self, session: Session) -> None:
        super().__init__(session, x=RANGE_LABEL, y=VELOCITY_TILE_LABEL)
        self.add_switch_of_marks()

    def show_frame(self, frame_state: FrameState) -> None:
        velocity_m_per_s, range_m = map_velocities_and_ranges(frame_state.power)
        self.set_image_extent(outer_cell_edges(range_m), outer_cell_edges(velocity_m_per_s))
        self.draw_power(
            frame_state.power.values, units=str(frame_state.samples.attrs.get("units", ""))
        )
        detections, _ = detection_map_positions_and_azimuths(frame_state)
        truth, _ = target_map_positions_and_azimuths(frame_state)
        self.draw_marks(detections, truth)
        self.draw_cursor(*frame_state.cursor)

    def update_caption(self, frame_state: FrameState) -> None:
        velocity_m_per_s, range_m = map_velocities_and_ranges(frame_state.power)
        n_detections = frame_state.detections.sizes["detection"]
        width_m, width_m_per_s = uniform_cell_width(range_m), uniform_cell_width(velocity_m_per_s)
        cell = f"{format_number(width_m, 2)} m {TIMES_SIGN} {format_number(width_m_per_s, 2)} m/s"
        self.caption.update(
            title=f"Range-Doppler map: {format_count_with_noun(n_detections, 'detection')}",
            note=f"cell {cell}   {self.legend_html}",
        )

    def cursor_at_position(self, x: float, y: float) -> Cursor:
        return Cursor(x, y)
