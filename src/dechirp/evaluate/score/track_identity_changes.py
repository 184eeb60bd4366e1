"""How often a target goes from one track to another."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.independent import rate
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import Better, Estimate
from dechirp.evaluate.score.of_tracks import OfTracks
from dechirp.evaluate.tracked import held


@value
class TrackIdentityChanges(OfTracks):
    """Changes of the track that holds a target, in a trial, for each target."""

    better: ClassVar[Better] = "less"
    n_sums: ClassVar[int] = 2

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Changes, and that it is one trial."""
        n_swaps = held(look, case, self.cutoff_m)["n_swaps"].values
        return np.stack([n_swaps, np.ones(len(n_swaps))], axis=1)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Counts, which may come together, see `independent.rate`."""
        return rate(*sums.T, confidence=confidence)
