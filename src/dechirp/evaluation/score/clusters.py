"""Scores of clusters: their number per target, and the probability of exactly one."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.detected_targets import count_clusters_per_target_and_frame
from dechirp.evaluation.preconditions import check_chain_computes_clusters, check_scene_has_targets
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Need, Score
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_mean


@frozen_dataclass
class ClustersPerTarget(Score):
    """Mean clusters of a target over frames in which it has any: 1 unless it is split."""

    needs: ClassVar[frozenset[Need]] = frozenset({"clusters"})
    n_sums: ClassVar[int] = 2

    def check_score_defined(self, context: TrialContext) -> None:
        check_scene_has_targets(context, self.kind())
        check_chain_computes_clusters(context, self.kind())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the clusters of each target, and the frames with any."""
        counts = count_clusters_per_target_and_frame(result, context)
        return np.stack([counts.sum(axis=1), np.sum(counts > 0, axis=1)], axis=1).astype(float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_mean(*sums.T, confidence=confidence)


@frozen_dataclass
class OneClusterProbability(Score):
    """Fraction of frames in which a target has exactly one cluster.

    A cluster belongs to the target with most of its power. So two merged targets count as one
    correct and one lost, and a split target as wrong.
    """

    better: ClassVar[Better] = "more"
    needs: ClassVar[frozenset[Need]] = frozenset({"clusters"})
    n_sums: ClassVar[int] = 2

    def check_score_defined(self, context: TrialContext) -> None:
        check_scene_has_targets(context, self.kind())
        check_chain_computes_clusters(context, self.kind())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return frames with one cluster, and frames."""
        counts = count_clusters_per_target_and_frame(result, context)
        return np.stack([np.sum(counts == 1, axis=1), np.full(len(counts), counts.shape[1])], 1)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)
