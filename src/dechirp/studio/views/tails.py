"""Recent positions of tracks."""

import numpy as np

from dechirp.studio.frame_state import FrameState

_MAX_FRAMES = 40  # frames


class TrackTails:
    """Positions of tracks by step; a rewind or a jump discards them."""

    def __init__(self) -> None:
        self._step = 0
        self._places: dict[int, dict[int, tuple[float, float]]] = {}

    def add_frame(self, moment: FrameState) -> None:
        """Add the tracks of a frame; a frame that is shown again replaces itself."""
        if moment.step not in (self._step, self._step + 1):
            self._places = {}
        self._step = moment.step
        oldest = moment.step - _MAX_FRAMES
        places = {}
        for track in moment.tracks:
            x, _, y, _ = track.state
            previous = self._places.get(track.number, {})
            recent = {step: position for step, position in previous.items() if step > oldest}
            places[track.number] = {**recent, moment.step: (y, x)}
        self._places = places

    @property
    def lines_m(self) -> list[np.ndarray]:
        """Line (n, 2) of each track: left and forward."""
        return [np.array(list(places.values())) for places in self._places.values()]
