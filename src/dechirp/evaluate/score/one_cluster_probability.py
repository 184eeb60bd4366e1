"""How often a target is one cluster, neither lost nor in parts."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.clusters import n_of_targets
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.needed import must_cluster, must_have_targets
from dechirp.evaluate.score.base import Better, Estimate, Need, Score
from dechirp.evaluate.shares import share


@value
class OneClusterProbability(Score):
    """Share of frames in which a target has exactly one cluster.

    A cluster is of the target that most of its power is of. So two targets that merge count as
    one right and one lost, and a target in two parts as wrong.
    """

    better: ClassVar[Better] = "more"
    needs: ClassVar[frozenset[Need]] = frozenset({"clusters"})
    n_sums: ClassVar[int] = 2

    def check(self, case: Case) -> None:
        """There must be targets, and clusters."""
        must_have_targets(case, self.label())
        must_cluster(case, self.label())

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Frames with one cluster, and frames."""
        counts = n_of_targets(look, case)
        return np.stack([np.sum(counts == 1, axis=1), np.full(len(counts), counts.shape[1])], 1)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Frames of a trial are not independent, see `independent.share`."""
        return share(*sums.T, confidence=confidence)
