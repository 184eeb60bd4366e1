"""What all scores share: sums over trials, and what is made of them."""

from abc import abstractmethod
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from dechirp.core.families import Family
from dechirp.core.values import value
from dechirp.evaluate.look import Case, Look

Need = Literal["maps", "noise", "clusters", "tracks"]
"""What a score wants to see beside detections and their match."""
Better = Literal["more", "less"] | None
"""What a user wants of a score; None: neither, as of a bias, which should be near 0."""


class Estimate(NamedTuple):
    """A score of many trials, with its interval; NaN where there is nothing to tell."""

    value: float
    low: float
    high: float


NOTHING = Estimate(np.nan, np.nan, np.nan)


@value
class Score(Family):
    """One number of many trials.

    A trial gives sums, such as hits and looks, or squared errors and their number, so that
    frames and targets add up. What they mean is told of all trials at once.
    """

    group: ClassVar[str] = "dechirp.score"
    needs: ClassVar[frozenset[Need]] = frozenset()
    unit: ClassVar[str | None] = None
    """Suffix of the unit of the value, as fields have it (m, m_per_s, rad, s); none: a ratio."""
    better: ClassVar[Better] = None
    repeatable: ClassVar[bool] = True
    """Whether the same trial gives the same sums: times do not."""
    n_sums: ClassVar[int]
    """How many a trial gives for each subject."""

    @classmethod
    def label(cls) -> str:
        """Its name in study files and results, as `detection_probability`."""
        return cls.kind().replace("-", "_")

    def subjects(self, case: Case) -> tuple[str, ...]:
        """What there is a value of: each target, by name; empty where only for the whole."""
        return case.names

    def check(self, case: Case) -> None:
        """Raise `InvalidSetting` where the case has nothing that could be scored so."""

    @abstractmethod
    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Of one trial, (n_subjects, n_sums) float64; (1, n_sums) where only for the whole."""

    @abstractmethod
    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Value and two-sided interval of independent trials, (n_trials, n_sums).

        Of one subject, or of all: their sums added in each trial. Rows of NaN are trials that
        failed, and are left out.
        """

    def theory(self, case: Case) -> np.ndarray:
        """What theory gives for each subject, (max(n_subjects, 1),); NaN where there is no law."""
        return np.full(max(len(self.subjects(case)), 1), np.nan)

    def together(self, theory: np.ndarray) -> float:
        """What theory gives for all subjects together, from what it gives for each."""
        return float(np.mean(theory))
