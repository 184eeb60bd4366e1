"""How many tracks are of nothing."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.independent import rate
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import Better, Estimate
from dechirp.evaluate.score.of_tracks import OfTracks
from dechirp.evaluate.tracked import held


@value
class FalseTracks(OfTracks):
    """Confirmed tracks that hold no target, in a frame, on average over all frames."""

    better: ClassVar[Better] = "less"
    n_sums: ClassVar[int] = 2

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def check(self, case: Case) -> None:
        """Without targets all tracks are false."""

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """False tracks of all frames, and frames."""
        n_false = held(look, case, self.cutoff_m)["n_false"].values
        return np.array([[n_false.sum(), n_false.size]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """A false track lasts for frames: by how trials scatter, see `independent.rate`."""
        return rate(*sums.T, confidence=confidence)
