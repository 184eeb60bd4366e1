"""What scores of tracks share."""

from typing import ClassVar

from dechirp.core.checks import positive
from dechirp.core.values import value
from dechirp.evaluate.look import Case
from dechirp.evaluate.needed import must_have_targets
from dechirp.evaluate.score.base import Need, Score


@value
class OfTracks(Score):
    """Tracks that are confirmed, beside targets; bodies by their origins."""

    needs: ClassVar[frozenset[Need]] = frozenset({"tracks"})
    cutoff_m: float = 3.0
    """Distance up to which a track may be of a target. Of bodies half their length or more."""

    def __post_init__(self) -> None:
        positive(self, "cutoff_m")

    def check(self, case: Case) -> None:
        """There must be targets."""
        must_have_targets(case, self.label())
