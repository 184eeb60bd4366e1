"""False-alarm probability of a cell."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.evaluation import false_alarms
from dechirp.evaluation.score.base import Better, Estimate, Need, Score
from dechirp.evaluation.trial import TrialContext, TrialResult
from dechirp.evaluation.trial_statistics import estimate_rate


@frozen_dataclass
class FalseAlarmProbability(Score):
    """Fraction of tested cells over threshold in maps of the scenario without its targets.

    In theory the design value of the detector, or the value of its offset in white noise.
    """

    better: ClassVar[Better] = "less"
    needs: ClassVar[frozenset[Need]] = frozenset({"noise"})
    n_sums: ClassVar[int] = 2

    def subjects(self, context: TrialContext) -> tuple[str, ...]:
        return ()

    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return cells over threshold, and tested cells."""
        assert result.noise is not None
        return np.array([[result.noise.n_over, result.noise.n_tested]], float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate from the scatter of maps, since alarms are clustered; see `trial_statistics`."""
        return estimate_rate(*sums.T, confidence=confidence)

    def theory(self, context: TrialContext) -> np.ndarray:
        """Return the law of the detector, NaN for an offset without one."""
        return np.array([false_alarms.cell_false_alarm_probability(context.radar, context.chain)])
