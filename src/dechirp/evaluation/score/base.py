"""Base class of scores: sums over trials, and their estimate with an interval."""

from abc import abstractmethod
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from dechirp.core.families import Family
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.trial import TrialContext, TrialResult

Need = Literal["maps", "noise", "clusters", "tracks"]
"""Result that a score needs in addition to detections and their association."""
Better = Literal["more", "less"] | None
"""Preferred direction of a score; None: neither, as for a bias, which should be near 0."""


class Estimate(NamedTuple):
    """Score of many trials, with its interval; NaN if undefined."""

    value: float
    low: float
    high: float


NO_ESTIMATE = Estimate(np.nan, np.nan, np.nan)


@frozen_dataclass
class Score(Family):
    """One number from many trials.

    A trial gives sums, such as hits and attempts, or squared errors and their number, so that
    frames and targets add up. The estimate is computed from the sums of all trials.
    """

    group: ClassVar[str] = "dechirp.score"
    needs: ClassVar[frozenset[Need]] = frozenset()
    unit: ClassVar[str | None] = None
    """Unit suffix of the value, as in field names (m, m_per_s, rad, s); None: a ratio."""
    better: ClassVar[Better] = None
    is_repeatable: ClassVar[bool] = True
    """True if the same trial always gives the same sums, unlike processing times."""
    n_sums: ClassVar[int]
    """Number of sums that a trial gives for each subject."""

    @classmethod
    def kind(cls) -> str:
        """Return the name in study files and results, where it names a variable: `range_rmse`."""
        return super().kind().replace("-", "_")

    def scored_target_names(self, context: TrialContext) -> tuple[str, ...]:
        """Names of the subjects with a value: the targets; empty for a score of the whole scene."""
        return context.target_names

    def check_score_defined(self, context: TrialContext) -> None:
        """Raise `InvalidSetting` if the score is undefined in this context."""

    @abstractmethod
    def trial_sums(self, result: TrialResult, context: TrialContext) -> np.ndarray:
        """Return the sums of one trial, (n_subjects, n_sums) or (1, n_sums) for the whole scene."""

    @abstractmethod
    def estimate_with_interval(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Estimate value and two-sided interval from independent trials, (n_trials, n_sums).

        For one subject, or for all with their sums added in each trial. Rows of NaN are failed
        trials and are omitted.
        """

    def theoretical_values(self, context: TrialContext) -> np.ndarray:
        """Return the theoretical value of each subject, (max(n_subjects, 1),); NaN if unknown."""
        return np.full(max(len(self.scored_target_names(context)), 1), np.nan)

    def combine_theoretical_values(self, values: np.ndarray) -> float:
        """Combine the theoretical values of the subjects into that of all."""
        return float(np.mean(values))
