"""How much of the time a target has a track."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.identity import NOBODY
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import Better, Estimate
from dechirp.evaluate.score.of_tracks import OfTracks
from dechirp.evaluate.shares import share
from dechirp.evaluate.tracked import held


@value
class TrackHeld(OfTracks):
    """Share of frames in which a confirmed track holds the target, those before its first too."""

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Frames in which it is held, and frames."""
        holder = held(look, case, self.cutoff_m)["holder"].transpose("target", "frame").values
        n_frames = np.full(len(holder), holder.shape[1])
        return np.stack([np.sum(holder != NOBODY, axis=1), n_frames], axis=1).astype(float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Frames of a trial are not independent, see `independent.share`."""
        return share(*sums.T, confidence=confidence)
