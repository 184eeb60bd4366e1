"""Which column of a block's sums belongs to which score and subject."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np

from dechirp.evaluate.look import Case
from dechirp.evaluate.score.base import Score


@dataclass(frozen=True)
class Layout:
    """Columns of all scores side by side: by score, then subject, then sum."""

    scores: tuple[Score, ...]
    subjects: tuple[tuple[str, ...], ...]
    """Of each score; empty where there is only the whole."""

    @classmethod
    def of_case(cls, scores: tuple[Score, ...], case: Case) -> "Layout":
        """Layout of the scores of a case; those of all points of a study are alike."""
        return cls(scores, tuple(score.subjects(case) for score in scores))

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Columns of each score."""
        both = zip(self.scores, self.subjects, strict=True)
        return tuple(score.n_sums * max(len(names), 1) for score, names in both)

    @property
    def n_columns(self) -> int:
        """Columns of a block."""
        return sum(self.widths)

    @property
    def n_laws(self) -> int:
        """Numbers that theory gives for a point, see `theory_of`."""
        return sum(max(len(names), 1) for names in self.subjects)

    def index(self, label: str) -> int:
        """Place of a score in the list, by its label; raises `ValueError` without it."""
        return self._labels.index(label)

    def sums_of(self, sums: np.ndarray, label: str, subject: str | None = None) -> np.ndarray:
        """Columns of one score, (n_trials, n_sums): of a subject, or of all, added."""
        index = self.index(label)
        first = self._firsts[index]
        of_score = sums[:, first : first + self.widths[index]]
        by_subject = of_score.reshape(len(sums), max(len(self.subjects[index]), 1), -1)
        if subject is None:
            return np.asarray(by_subject.sum(axis=1))
        return np.asarray(by_subject[:, self.subjects[index].index(subject)])

    def theory_of(self, theory: np.ndarray, label: str, subject: str | None = None) -> float:
        """What theory gives for one score of a subject, or of all, see `Score.together`.

        `theory` has a number for each subject of each score, one where there is only the whole.
        """
        index = self.index(label)
        counts = [max(len(names), 1) for names in self.subjects]
        first = sum(counts[:index])
        of_score = theory[first : first + counts[index]]
        if subject is None:
            return self.scores[index].together(of_score)
        return float(of_score[self.subjects[index].index(subject)])

    @cached_property
    def _labels(self) -> tuple[str, ...]:
        return tuple(score.label() for score in self.scores)

    @cached_property
    def _firsts(self) -> tuple[int, ...]:
        """First column of each score."""
        return tuple(accumulate(self.widths, initial=0))
