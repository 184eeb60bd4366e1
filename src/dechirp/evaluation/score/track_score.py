"""Base class of track scores."""

from typing import ClassVar

from dechirp.core.checks import check_positive
from dechirp.core.values import frozen_dataclass
from dechirp.evaluation.preconditions import check_has_targets
from dechirp.evaluation.score.base import Need, Score
from dechirp.evaluation.trial import TrialContext


@frozen_dataclass
class TrackScore(Score):
    """Score of confirmed tracks with respect to targets; bodies by their origins."""

    needs: ClassVar[frozenset[Need]] = frozenset({"tracks"})
    cutoff_m: float = 3.0
    """Largest distance of a track from its target; for bodies at least half their length."""

    def __post_init__(self) -> None:
        check_positive(self, "cutoff_m")

    def check_context(self, context: TrialContext) -> None:
        check_has_targets(context, self.label())
