"""Into how many clusters a target falls."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.evaluate.clusters import n_of_targets
from dechirp.evaluate.independent import ratio
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.needed import must_cluster, must_have_targets
from dechirp.evaluate.score.base import Estimate, Need, Score


@value
class ClustersPerTarget(Score):
    """Clusters of a target over frames in which it has any: 1 unless it falls into parts."""

    needs: ClassVar[frozenset[Need]] = frozenset({"clusters"})
    n_sums: ClassVar[int] = 2

    def check(self, case: Case) -> None:
        """There must be targets, and clusters."""
        must_have_targets(case, self.label())
        must_cluster(case, self.label())

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Clusters, and frames with any."""
        counts = n_of_targets(look, case)
        return np.stack([counts.sum(axis=1), np.sum(counts > 0, axis=1)], axis=1).astype(float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """By how trials scatter, see `independent.ratio`."""
        return ratio(*sums.T, confidence=confidence)
