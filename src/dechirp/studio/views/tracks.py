"""The tracks of a moment as a table, and where they go."""

from collections.abc import Sequence

import numpy as np
from bokeh.models import UIElement

from dechirp.core.displayed import several
from dechirp.scene.folding import Place, folded, on_map
from dechirp.studio.moment import Moment
from dechirp.studio.pointing import Cursor
from dechirp.studio.session import Session
from dechirp.studio.theme import Theme
from dechirp.studio.views.base import View
from dechirp.studio.views.listed import MOST_ROWS, Head, Listed, at_cursor
from dechirp.tracking.live import Track

_HEADS = {
    "number": Head("track", "0", 40),
    "status": Head("status", width=70),
    "age": Head("frames", "0", 45),
    "range": Head("range, m", "0.00"),
    "velocity": Head("velocity, m/s", "0.00", 75),
    "x": Head("ahead, m", "0.00"),
    "x_std": Head("± m", "0.00", 50),
    "y": Head("left, m", "0.00"),
    "y_std": Head("± m", "0.00", 50),
    "vx": Head("ahead, m/s", "0.00"),
    "vx_std": Head("± m/s", "0.00", 50),
    "vy": Head("left, m/s", "0.00"),
    "vy_std": Head("± m/s", "0.00", 50),
}


class Tracks(View):
    """States with standard errors, confirmed ones first; a row that is picked moves the cursor."""

    name = "tracks"
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
        tracks = sorted(moment.tracks, key=lambda one: (one.status != "confirmed", one.number))
        columns = columns_of(tracks)
        seen = folded(Place(columns["range"], columns["velocity"]), moment.radar)
        places = on_map(seen, moment.radar)
        self.listed.show(
            self._said(tracks),
            columns,
            cursors=[Cursor(*map(float, place)) for place in zip(*places, strict=True)],
            marked=at_cursor(places, moment),
        )

    def wear(self, theme: Theme) -> None:
        """Take the colours of a theme: its variables reach into the table by themselves."""

    def _said(self, tracks: Sequence[Track]) -> str:
        if self.session.scenario.tracker is None:
            return "No tracks: the settings have no tracker (Processing)"
        n_confirmed = sum(one.status == "confirmed" for one in tracks)
        n_tentative = len(tracks) - n_confirmed
        said = f"{several(n_confirmed, 'track')} confirmed, {n_tentative} tentative"
        return said if len(tracks) <= MOST_ROWS else f"{said}: the first {MOST_ROWS}"


def columns_of(tracks: Sequence[Track]) -> dict[str, np.ndarray]:
    """Columns of tracks: states as they are, and what a radar sees of them."""
    x, vx, y, vy = np.reshape([one.state for one in tracks], (-1, 4)).T
    variance = np.reshape([np.diag(one.covariance) for one in tracks], (-1, 4))
    x_std, vx_std, y_std, vy_std = np.sqrt(variance).T
    range_m = np.hypot(x, y)
    return {
        "number": np.array([one.number for one in tracks], dtype=int),
        "status": np.array([one.status for one in tracks], dtype=object),
        "age": np.array([one.age for one in tracks], dtype=int),
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
