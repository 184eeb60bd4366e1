"""How often a target is found."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.expected import detection_probabilities
from dechirp.evaluate.found import is_found
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.needed import must_have_targets
from dechirp.evaluate.score.base import Better, Estimate, Score
from dechirp.evaluate.shares import share


@value
class DetectionProbability(Score):
    """Share of frames in which a target has a detection."""

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def check(self, case: Case) -> None:
        """There must be targets."""
        must_have_targets(case, self.label())

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Frames in which each target is found, and frames."""
        found = is_found(look, case)
        return np.stack([found.sum(axis=1), np.full(len(found), found.shape[1])], axis=1)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Clopper and Pearson's interval where trials have one look; see `shares.share`."""
        return share(*sums.T, confidence=confidence)

    def theory(self, case: Case) -> np.ndarray:
        """Of the cells about each target, see `expected.detection_probabilities`."""
        return detection_probabilities(case)
