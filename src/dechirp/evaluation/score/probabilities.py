"""Probabilities of detection, of resolution and of false alarms."""

from typing import ClassVar

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation import false_alarms
from dechirp.evaluation.detected_targets import (
    detected_target_mask_per_frame,
    shadowed_target_mask_per_frame,
)
from dechirp.evaluation.preconditions import check_no_triangular_ramps, check_scene_has_targets
from dechirp.evaluation.predicted_detection import theoretical_detection_probabilities
from dechirp.evaluation.proportions import estimate_proportion
from dechirp.evaluation.score.base import Better, Estimate, Need, Score
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_rate


@frozen_dataclass
class DetectionProbability(Score):
    """Fraction of frames in which a target has a detection, of those in which it is not shadowed.

    Frames in which other bodies hide more than half of the field of its echo on each way (the
    column `shadow_loss` of the truth exceeds 16, 12 dB) do not count.
    """

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def check_score_defined(self, context: TrialContext) -> None:
        check_scene_has_targets(context, self.kind())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the frames in which each target is detected, and frames, without shadowed ones."""
        detected = detected_target_mask_per_frame(result, context)
        is_lit = ~shadowed_target_mask_per_frame(context)
        return np.stack([(detected & is_lit).sum(axis=1), is_lit.sum(axis=1)], axis=1)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        return theoretical_detection_probabilities(context)


@frozen_dataclass
class ResolutionProbability(Score):
    """Fraction of frames in which every target of the scene has its own detection.

    A detection belongs to the nearest target only, so two merged targets leave one without.
    """

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def check_score_defined(self, context: TrialContext) -> None:
        if len(context.target_names) < 2:
            raise InvalidSetting(
                "scores",
                value=f"{self.kind()}, in a scene of {len(context.target_names)} targets",
                expected="two or more targets to be resolved",
                fix=f"add a target to the scene, or leave out {self.kind()}",
            )

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return frames in which all targets are detected, and frames."""
        detected = detected_target_mask_per_frame(result, context)
        return np.array([[detected.all(axis=0).sum(), detected.shape[1]]], dtype=float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)


@frozen_dataclass
class FalseAlarmProbability(Score):
    """Fraction of tested cells over threshold in maps of the scenario without its targets.

    In theory the design value of the detector, or the value of its offset in white noise.
    """

    better: ClassVar[Better] = "less"
    needs: ClassVar[frozenset[Need]] = frozenset({"noise"})
    n_sums: ClassVar[int] = 2

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return cells over threshold, and tested cells."""
        assert result.noise is not None
        return np.array([[result.noise.n_over, result.noise.n_tested]], float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate from the scatter of maps, since alarms are clustered; see `trial_statistics`."""
        return estimate_rate(*sums.T, confidence=confidence)

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        """Return the law of the detector, NaN for an offset without one."""
        return np.array([false_alarms.cell_false_alarm_probability(context.radar, context.chain)])


@frozen_dataclass
class FrameFalseAlarmProbability(Score):
    """Fraction of frames of the scenario without its targets that have a detection.

    Theory is for white noise, see `evaluation.false_alarms`.
    """

    better: ClassVar[Better] = "less"
    needs: ClassVar[frozenset[Need]] = frozenset({"noise"})
    n_sums: ClassVar[int] = 2

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def check_score_defined(self, context: TrialContext) -> None:
        check_no_triangular_ramps(context, self.kind())

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return 1 for a frame with a detection, and the number of frames, 1."""
        assert result.noise is not None
        return np.array([[result.noise.n_peaks > 0, 1]], float)

    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        return estimate_proportion(*sums.T, confidence=confidence)

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        """Return the law, NaN if false alarms of a frame are clustered."""
        return np.array([false_alarms.frame_false_alarm_probability(context.radar, context.chain)])
