"""Where tracks have been in the last frames."""

import numpy as np

from dechirp.studio.moment import Moment

_LONGEST = 40  # frames


class Tails:
    """Places of tracks, from step to step; a rewind or a jump starts them anew."""

    def __init__(self) -> None:
        self._step = 0
        self._places: dict[int, dict[int, tuple[float, float]]] = {}

    def grow(self, moment: Moment) -> None:
        """Add a moment; one that is shown again, changed, takes the place of itself."""
        if moment.step not in (self._step, self._step + 1):
            self._places = {}
        self._step = moment.step
        oldest = moment.step - _LONGEST
        places = {}
        for track in moment.tracks:
            x, _, y, _ = track.state
            before = self._places.get(track.number, {})
            kept = {step: at for step, at in before.items() if step > oldest}
            places[track.number] = {**kept, moment.step: (y, x)}
        self._places = places

    @property
    def lines_m(self) -> list[np.ndarray]:
        """Of each track, (n, 2): to the left and forward."""
        return [np.array(list(places.values())) for places in self._places.values()]
