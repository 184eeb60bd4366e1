"""Tracks of a frame: table, and tails of past positions."""

from collections.abc import Sequence

import numpy as np
from bokeh.models import UIElement

from dechirp.core.display import format_count_with_noun
from dechirp.core.text import decimals_for_column, format_std
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity, range_doppler_map_position
from dechirp.studio.cursor import Cursor
from dechirp.studio.frame_state import FrameState
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.table_tile import MAX_ROWS, Heading, TableTile, row_at_cursor
from dechirp.tracking.online import Track

_MAX_FRAMES = 40  # frames


class TrackTails:
    """Positions of tracks by step; a rewind, a jump or other settings discard them."""

    def __init__(self) -> None:
        self._places: dict[int, dict[int, tuple[float, float]]] = {}

    def add_tracks_of_frame(self, frame_state: FrameState) -> None:
        """Add the tracks of a frame; a frame that is shown again replaces itself."""
        if len(frame_state.history) == 1:  # the tracker started here, with new numbers
            self._places = {}
        oldest = frame_state.step - _MAX_FRAMES
        places = {}
        for track in frame_state.tracks:
            x, _, y, _ = track.state
            previous = self._places.get(track.number, {})
            recent = {step: position for step, position in previous.items() if step > oldest}
            places[track.number] = {**recent, frame_state.step: (y, x)}
        self._places = places

    @property
    def track_lines_m(self) -> list[np.ndarray]:
        """Line (n, 2) of each track: left and forward."""
        return [np.array(list(places.values())) for places in self._places.values()]


_HEADINGS = {
    "number": Heading("track", 0, 40),
    "status": Heading("status", width=84),
    "age": Heading("frames", 0, 45),
    "range": Heading("Range (m)", 2),
    "velocity": Heading("Velocity (m/s)", 2, 88),
    "x": Heading("Ahead (m)", 2),
    "x_std": Heading("± m", width=50),
    "y": Heading("Left (m)", 2),
    "y_std": Heading("± m", width=50),
    "vx": Heading("Ahead (m/s)", 2),
    "vx_std": Heading("± m/s", width=50),
    "vy": Heading("Left (m/s)", 2),
    "vy_std": Heading("± m/s", width=50),
}

_STATES = ("x", "y", "vx", "vy")


class TracksView(View):
    """States with standard errors, confirmed tracks first; selecting a row moves the cursor."""

    name = "tracks"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.table = TableTile(self.name, _HEADINGS, on_pick=session.move_cursor)

    @property
    def root_element(self) -> UIElement:
        return self.table.root_element

    def show_frame(self, frame_state: FrameState) -> None:
        tracks = sorted(
            frame_state.tracks, key=lambda track: (track.status != "confirmed", track.number)
        )
        columns = track_columns(tracks)
        apparent = alias_range_velocity(
            RangeVelocity(columns["range"], columns["velocity"]), frame_state.radar
        )
        map_positions = range_doppler_map_position(apparent, frame_state.radar)
        decimals = {
            name: decimals_for_column(columns[f"{name}_std"], digits=2, at_most=4)
            for name in _STATES
        }
        for name, n_decimals in decimals.items():
            texts = [format_std(std, n_decimals) for std in columns[f"{name}_std"].tolist()]
            columns[f"{name}_std"] = np.array(texts, dtype=object)
        self.table.show_rows(
            self._track_counts_title(tracks),
            columns,
            cursors=[Cursor(*map(float, place)) for place in zip(*map_positions, strict=True)],
            selected=row_at_cursor(map_positions, frame_state),
            decimals=decimals,
        )

    def apply_theme(self, theme: Theme) -> None:
        """Do nothing: the widgets inherit the colours of the page."""

    def _track_counts_title(self, tracks: Sequence[Track]) -> str:
        if not self.session.scenario.has_tracker:
            return "No tracks: the settings have no tracker (Processing)"
        n_confirmed = sum(track.status == "confirmed" for track in tracks)
        n_tentative = len(tracks) - n_confirmed
        text = f"{format_count_with_noun(n_confirmed, 'track')} confirmed, {n_tentative} tentative"
        return text if len(tracks) <= MAX_ROWS else f"{text}: the first {MAX_ROWS}"


def track_columns(tracks: Sequence[Track]) -> dict[str, np.ndarray]:
    """Return the columns of tracks: states, and their range and velocity."""
    x, vx, y, vy = np.reshape([track.state for track in tracks], (-1, 4)).T
    variance = np.reshape([np.diag(track.covariance) for track in tracks], (-1, 4))
    x_std, vx_std, y_std, vy_std = np.sqrt(variance).T
    range_m = np.hypot(x, y)
    return {
        "number": np.array([track.number for track in tracks], dtype=int),
        "status": np.array([track.status for track in tracks], dtype=object),
        "age": np.array([track.age for track in tracks], dtype=int),
        "range": range_m,
        "velocity": (x * vx + y * vy) / np.maximum(range_m, 1e-9),
        "x": x,
        "x_std": x_std,
        "y": y,
        "y_std": y_std,
        "vx": vx,
        "vx_std": vx_std,
        "vy": vy,
        "vy_std": vy_std,
    }
