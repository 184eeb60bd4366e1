"""Root mean square error of ranges."""

from typing import ClassVar

from dechirp.core.values import value
from dechirp.evaluate.score.errors import Axis, Rmse


@value
class RangeRmse(Rmse):
    """Root mean square error of the range of a target, where it is found."""

    unit: ClassVar[str | None] = "m"
    axis: ClassVar[Axis] = "range"
