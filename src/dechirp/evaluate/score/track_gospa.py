"""One error of all tracks of a frame: where they are, which are missing, which are false."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.gospa import gospa
from dechirp.evaluate.independent import ratio
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import Better, Estimate
from dechirp.evaluate.score.of_tracks import OfTracks
from dechirp.evaluate.tracked import pairs_m


@value
class TrackGospa(OfTracks):
    """GOSPA of order 2 in the plane, the mean over frames.

    A missed target, as a false track, adds half the square of the cut-off.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "m"
    n_sums: ClassVar[int] = 2

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Errors of all frames, and frames."""
        pairs = pairs_m(look, case)
        errors = [gospa(*pair, cutoff_m=self.cutoff_m).error_m for pair in pairs]
        return np.array([[sum(errors), len(errors)]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """By how trials scatter, see `independent.ratio`."""
        return ratio(*sums.T, confidence=confidence)
