"""Column layout of score sums: the columns of each score and target in a block."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np

from dechirp.evaluation.score.base import Score
from dechirp.evaluation.trial import TrialContext


@dataclass(frozen=True)
class ScoreColumnLayout:
    """Columns of all scores side by side: by score, then target, then sum."""

    scores: tuple[Score, ...]
    scored_target_names: tuple[tuple[str, ...], ...]
    """Names of the targets of each score; empty where it has a total only."""

    @classmethod
    def from_context(cls, scores: tuple[Score, ...], context: TrialContext) -> "ScoreColumnLayout":
        """Build the layout of scores in a trial context; all points of a study share it."""
        return cls(scores, tuple(score.scored_target_names(context) for score in scores))

    @cached_property
    def n_columns_per_score(self) -> tuple[int, ...]:
        """Number of columns of each score."""
        both = zip(self.scores, self.scored_target_names, strict=True)
        return tuple(score.n_sums * max(len(names), 1) for score, names in both)

    @property
    def n_columns(self) -> int:
        """Number of columns of a block."""
        return sum(self.n_columns_per_score)

    @property
    def n_theoretical_values(self) -> int:
        """Number of theoretical values of a point, see `theoretical_score_value`."""
        return sum(max(len(names), 1) for names in self.scored_target_names)

    def index_of_score(self, label: str) -> int:
        """Return the index of a score by its label; raise `ValueError` if it is missing."""
        return self._score_labels.index(label)

    def select_score_sums(
        self, sums: np.ndarray, label: str, target: str | None = None
    ) -> np.ndarray:
        """Return the columns of one score, (n_trials, n_sums): of a target, or summed over all."""
        index = self.index_of_score(label)
        first = self._first_column_per_score[index]
        score_columns = sums[:, first : first + self.n_columns_per_score[index]]
        by_subject = score_columns.reshape(
            len(sums), max(len(self.scored_target_names[index]), 1), -1
        )
        if target is None:
            return np.asarray(by_subject.sum(axis=1))
        return np.asarray(by_subject[:, self.scored_target_names[index].index(target)])

    def theoretical_score_value(
        self, theoretical_values: np.ndarray, label: str, target: str | None = None
    ) -> float:
        """Return the theoretical value of a score of a target, or of all.

        See `Score.combine_theoretical_values`.

        `theoretical_values` has a value for each target of each score, one where a score has a
        total only.
        """
        index = self.index_of_score(label)
        counts = [max(len(names), 1) for names in self.scored_target_names]
        first = sum(counts[:index])
        score_values = theoretical_values[first : first + counts[index]]
        if target is None:
            return self.scores[index].combine_theoretical_values(score_values)
        return float(score_values[self.scored_target_names[index].index(target)])

    @cached_property
    def _score_labels(self) -> tuple[str, ...]:
        return tuple(score.kind() for score in self.scores)

    @cached_property
    def _first_column_per_score(self) -> tuple[int, ...]:
        """First column of each score."""
        return tuple(accumulate(self.n_columns_per_score, initial=0))
