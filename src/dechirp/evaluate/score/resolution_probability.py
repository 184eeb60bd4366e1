"""How often all targets are told apart."""

from typing import ClassVar

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.evaluate.found import is_found
from dechirp.evaluate.look import Case, Look
from dechirp.evaluate.score.base import Better, Estimate, Score
from dechirp.evaluate.shares import share


@value
class ResolutionProbability(Score):
    """Share of frames in which every target of the scene has a detection of its own.

    A detection is of one target alone, the nearest: two that merge leave one without.
    """

    better: ClassVar[Better] = "more"
    n_sums: ClassVar[int] = 2

    def subjects(self, case: Case) -> tuple[str, ...]:
        """Only the whole."""
        return ()

    def check(self, case: Case) -> None:
        """There must be two targets."""
        if len(case.names) < 2:
            raise InvalidSetting(
                "scores",
                got=f"{self.label()}, in a scene of {len(case.names)} targets",
                need="two or more that are to be told apart",
                fix=f"Add a target to the scene, or leave out {self.label()}.",
            )

    def sums(self, look: Look, case: Case) -> np.ndarray:
        """Frames in which all are found, and frames."""
        found = is_found(look, case)
        return np.array([[found.all(axis=0).sum(), found.shape[1]]], dtype=float)

    def estimate(self, sums: np.ndarray, *, confidence: float) -> Estimate:
        """Clopper and Pearson's interval where trials have one look; see `shares.share`."""
        return share(*sums.T, confidence=confidence)
