"""Number of clusters into which a target is split."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.cluster_matching import count_clusters_per_target
from dechirp.evaluation.preconditions import check_clusters, check_has_targets
from dechirp.evaluation.score.base import Estimate, Need, Score
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean


@frozen_dataclass
class ClustersPerTarget(Score):
    """Mean clusters of a target over frames in which it has any: 1 unless it is split."""

    needs: ClassVar[frozenset[Need]] = frozenset({"clusters"})
    n_sums: ClassVar[int] = 2

    def check_context(self, context: TrialContext) -> None:
        check_has_targets(context, self.label())
        check_clusters(context, self.label())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the clusters of each target, and the frames with any."""
        counts = count_clusters_per_target(result, context)
        return np.stack([counts.sum(axis=1), np.sum(counts > 0, axis=1)], axis=1).astype(float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)
