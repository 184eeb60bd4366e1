"""Whether tracks are as exact as they say."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.identity import NOBODY
from dechirp.evaluate.independent import ratio
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.nees import nees
from dechirp.evaluate.score.base import Estimate
from dechirp.evaluate.score.of_tracks import OfTracks
from dechirp.evaluate.tracked import STATE, held, of_tracks, states


@value
class TrackNees(OfTracks):
    """Normalised estimation error squared of the tracks that hold a target, mean over frames.

    4, the number of states, where the filter is consistent, whose interval then holds it. More:
    it is too sure. A cut-off within a few standard errors leaves out the largest errors. A body
    is tracked where it reflects, not at its origin.
    """

    n_sums: ClassVar[int] = 2

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Sum over frames in which it is held, and those frames."""
        assert look.tracks is not None
        holder = held(look, case, self.cutoff_m)["holder"].transpose("target", "frame").values
        target, frame = np.nonzero(holder != NOBODY)
        track, known = holder[target, frame], states(case)
        true = np.stack([known[name].values[target, frame] for name in STATE], axis=-1)
        over = {"state": list(STATE), "other_state": list(STATE)}
        covariance = look.tracks["covariance"].sel(over).transpose("track", "frame", *over).values
        made = np.zeros((len(holder), self.n_sums))
        if target.size:
            error = of_tracks(look)[track, frame] - true
            np.add.at(made[:, 0], target, nees(error, covariance[track, frame]))
            np.add.at(made[:, 1], target, 1)
        return made

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Frames of a trial are not independent: by how trials scatter, see `independent.ratio`."""
        return ratio(*sums.T, confidence=confidence)

    def theory(self, case: Case) -> np.ndarray:
        """Of a consistent filter: the number of states."""
        return np.full(len(case.names), float(len(STATE)))
