"""Number of people in a room, from points and targets that TI's people counting recorded."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.streams.people_counting import parse_viewer_frames
from dechirp.tracking.groups import track_groups
from dechirp.witnesses.base import Comparison, Witness

_INTERVAL_S = 0.05  # of the frames: the recorded targets move by their velocity in this time
_WANTED_SHARE = 0.95


class PeopleCounting(Witness):
    """Frames with the count of TI's tracker, with the default settings."""

    folder: ClassVar[str] = "people_counting"
    source: ClassVar[str] = "gaoweifan/pyRadar @849ff65, TI people counting"
    licence: ClassVar[str] = "MIT"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the number of people in each frame, and of all of them."""
        path = folder / "fHistScene4_2d_0001.bin"
        theirs = parse_viewer_frames(path.read_bytes()).target_counts
        points = open_recording(path).points
        if points is None:
            raise ValueError(f"{path.name}: no points")
        tracks = track_groups(points, np.arange(len(theirs)) * _INTERVAL_S)
        ours = (tracks.status.values == "confirmed").sum(axis=0)
        yield Comparison(
            quantity=f"frames with the same number of people, of {len(theirs)}",
            theirs=len(theirs),
            ours=int(np.sum(ours == theirs)),
            unit="1",
            tolerance=(1 - _WANTED_SHARE) * len(theirs),
            basis="95 % of the frames: trackers confirm people some frames apart",
        )
        yield Comparison(
            quantity="people that entered",
            theirs=int(theirs.max()),
            ours=tracks.sizes["track"],
            unit="1",
            tolerance=0,
            basis="the same number of tracks: nobody leaves",
        )
