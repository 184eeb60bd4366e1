"""Column layout of score sums: the columns of each score and subject in a block."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np

from dechirp.evaluation.score.base import Score
from dechirp.evaluation.trial import TrialContext


@dataclass(frozen=True)
class Layout:
    """Columns of all scores side by side: by score, then subject, then sum."""

    scores: tuple[Score, ...]
    subjects: tuple[tuple[str, ...], ...]
    """Subjects of each score; empty where it has a total only."""

    @classmethod
    def from_context(cls, scores: tuple[Score, ...], case: TrialContext) -> "Layout":
        """Build the layout of scores in a trial context; all points of a study share it."""
        return cls(scores, tuple(score.scored_target_names(case) for score in scores))

    @cached_property
    def score_widths(self) -> tuple[int, ...]:
        """Number of columns of each score."""
        both = zip(self.scores, self.subjects, strict=True)
        return tuple(score.n_sums * max(len(names), 1) for score, names in both)

    @property
    def n_columns(self) -> int:
        """Number of columns of a block."""
        return sum(self.score_widths)

    @property
    def n_theory_values(self) -> int:
        """Number of theoretical values of a point, see `score_theory`."""
        return sum(max(len(names), 1) for names in self.subjects)

    def score_index(self, label: str) -> int:
        """Return the index of a score by its label; raise `ValueError` if it is missing."""
        return self._labels.index(label)

    def score_sums(self, sums: np.ndarray, label: str, subject: str | None = None) -> np.ndarray:
        """Return the columns of one score, (n_trials, n_sums): of a subject, or summed over all."""
        index = self.score_index(label)
        first = self._first_columns[index]
        score_columns = sums[:, first : first + self.score_widths[index]]
        by_subject = score_columns.reshape(len(sums), max(len(self.subjects[index]), 1), -1)
        if subject is None:
            return np.asarray(by_subject.sum(axis=1))
        return np.asarray(by_subject[:, self.subjects[index].index(subject)])

    def score_theory(self, theory: np.ndarray, label: str, subject: str | None = None) -> float:
        """Return the theoretical value of a score of a subject, or of all.

        See `Score.combine_theoretical_values`.

        `theory` has a value for each subject of each score, one where a score has a total only.
        """
        index = self.score_index(label)
        counts = [max(len(names), 1) for names in self.subjects]
        first = sum(counts[:index])
        score_values = theory[first : first + counts[index]]
        if subject is None:
            return self.scores[index].combine_theoretical_values(score_values)
        return float(score_values[self.subjects[index].index(subject)])

    @cached_property
    def _labels(self) -> tuple[str, ...]:
        return tuple(score.label() for score in self.scores)

    @cached_property
    def _first_columns(self) -> tuple[int, ...]:
        """First column of each score."""
        return tuple(accumulate(self.score_widths, initial=0))
