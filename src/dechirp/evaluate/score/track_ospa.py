"""Mean error of all tracks of a frame: where they are, and how many too many or few."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.independent import ratio
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.ospa import ospa_m
from dechirp.evaluate.score.base import Better, Estimate
from dechirp.evaluate.score.of_tracks import OfTracks
from dechirp.evaluate.tracked import pairs_m


@value
class TrackOspa(OfTracks):
    """OSPA of order 1 in the plane, the mean over frames: an error per target.

    One that has no track, as a track too many, counts as an error of the cut-off.
    """

    better: ClassVar[Better] = "less"
    unit: ClassVar[str | None] = "m"
    n_sums: ClassVar[int] = 2

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Errors of all frames, and frames."""
        errors = [ospa_m(*pair, cutoff_m=self.cutoff_m) for pair in pairs_m(look, case)]
        return np.array([[sum(errors), len(errors)]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """By how trials scatter, see `independent.ratio`."""
        return ratio(*sums.T, confidence=confidence)
