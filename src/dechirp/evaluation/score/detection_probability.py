"""Detection probability of a target."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.detected_targets import is_detected
from dechirp.evaluation.preconditions import check_has_targets
from dechirp.evaluation.predicted_detection import detection_probabilities
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Score
from dechirp.evaluation.trial import TrialContext, TrialResult


@frozen_dataclass
class DetectionProbability(Score):
    """Fraction of frames in which a target has a detection."""

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def check_context(self, context: TrialContext) -> None:
        check_has_targets(context, self.label())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the frames in which each target is detected, and all frames."""
        detected = is_detected(result, context)
        return np.stack([detected.sum(axis=1), np.full(len(detected), detected.shape[1])], axis=1)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)

    def theory(self, context: TrialContext) -> np.ndarray:
        return detection_probabilities(context)
