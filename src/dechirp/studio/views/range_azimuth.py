"""Range-azimuth map view; positive azimuth is to the left."""

import numpy as np

from dechirp.core.text import format_number
from dechirp.report.figures.common import outer_cell_edges
from dechirp.report.labels import AZIMUTH_LABEL, RANGE_LABEL
from dechirp.studio.cursor import Cursor, map_velocities_and_ranges
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.views.map_markers import (
    detection_map_positions_and_azimuths,
    target_map_positions_and_azimuths,
)
from dechirp.studio.views.map_view import MapView

_TITLE = "Range-azimuth map"
_STEPS = 120  # pixels of a small tile: 1.3 degrees each, for beams of about 10 degrees


class RangeAzimuthView(MapView):
    """Power over azimuth and range, with the cursor as a line."""

    name = "range_azimuth"
    frames_per_update = 2
    """10 per second at 20 frames: a map takes 3 ms. A slow machine draws fewer, in proportion."""

    def __init__(self, session: Session) -> None:
        super().__init__(session, x=AZIMUTH_LABEL, y=RANGE_LABEL)
        self.add_switch_of_marks()

    def show_frame(self, frame_state: FrameState) -> None:
        power = frame_state.azimuth_power
        if power is None:
            self._clear_map(frame_state)
            return
        self._colour_bar.visible = True
        variables = power.coords.variables  # labelled access takes 35 µs
        azimuth_deg = np.degrees(variables["azimuth"].values)
        shown_deg = np.linspace(azimuth_deg[0], azimuth_deg[-1], _STEPS)
        right, left = outer_cell_edges(shown_deg)
        self.set_image_extent((left, right), outer_cell_edges(variables["range"].values))
        nearest = abs(azimuth_deg - shown_deg[:, None]).argmin(axis=1)
        self.draw_power(
            power.variable.transpose("range", "azimuth").values[:, nearest],
            units=str(frame_state.samples.attrs.get("units", "")),
        )
        detections, detections_rad = detection_map_positions_and_azimuths(frame_state)
        truth, truth_rad = target_map_positions_and_azimuths(frame_state)
        self.draw_marks(
            (np.degrees(detections_rad), detections.range_m), (np.degrees(truth_rad), truth.range_m)
        )
        self.draw_cursor(None, frame_state.cursor.range_m)

    def update_caption(self, frame_state: FrameState) -> None:
        if frame_state.azimuth_power is None:
            self.caption.update(
                title=f"{_TITLE}: this array has no azimuth resolution",
                note="Add elements at several positions along y.",
            )
            return
        detections, detections_rad = detection_map_positions_and_azimuths(frame_state)
        peak = _strongest_detection_text(np.degrees(detections_rad), detections.range_m)
        self.caption.update(
            title=f"{_TITLE}: {peak}", note=f"{self.legend_html}   ┄ range of the cursor"
        )

    def cursor_at_position(self, x: float, y: float) -> Cursor:
        frame_state = self.session.frame_state
        return Cursor(y, 0.0 if frame_state is None else frame_state.cursor.velocity_m_per_s)

    def _clear_map(self, frame_state: FrameState) -> None:
        _, ranges_m = map_velocities_and_ranges(frame_state.power)
        self.set_image_extent((90.0, -90.0), outer_cell_edges(ranges_m))
        self._colour_bar.visible = False
        self.image.data = {"image": [np.zeros((1, 1), np.uint8)]}
        no_positions = np.empty(0), np.empty(0)
        self.draw_marks(no_positions, no_positions)
        self.draw_cursor(None, None)


def format_azimuth(azimuth_deg: float) -> str:
    """Format an azimuth as 3.1° left, 3.1° right or 0.0°."""
    suffix = "" if abs(azimuth_deg) < 0.05 else " left" if azimuth_deg > 0 else " right"
    return f"{abs(azimuth_deg):.1f}°{suffix}"


def _strongest_detection_text(azimuth_deg: np.ndarray, range_m: np.ndarray) -> str:
    finite = np.flatnonzero(np.isfinite(azimuth_deg))
    if not finite.size:
        return "no directions"
    first = finite[0]
    range_text = f"{format_number(range_m[first], 3)}\N{NO-BREAK SPACE}m"
    return f"peak {format_azimuth(azimuth_deg[first])}, {range_text}"
