"""Probability that all targets are resolved."""

from typing import ClassVar

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.detected_targets import is_detected
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Score
from dechirp.evaluation.trial import TrialContext, TrialResult


@frozen_dataclass
class ResolutionProbability(Score):
    """Fraction of frames in which every target of the scene has its own detection.

    A detection belongs to the nearest target only, so two merged targets leave one without.
    """

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def subjects(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def check_context(self, context: TrialContext) -> None:
        if len(context.names) < 2:
            raise InvalidSetting(
                "scores",
                value=f"{self.label()}, in a scene of {len(context.names)} targets",
                expected="two or more targets to be resolved",
                fix=f"add a target to the scene, or leave out {self.label()}",
            )

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return frames in which all targets are detected, and frames."""
        detected = is_detected(result, context)
        return np.array([[detected.all(axis=0).sum(), detected.shape[1]]], dtype=float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)
