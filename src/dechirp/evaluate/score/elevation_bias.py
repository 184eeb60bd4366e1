"""Mean error of elevations."""

from typing import ClassVar

from dechirp.core.values import value
from dechirp.evaluate.score.errors import Axis, Bias


@value
class ElevationBias(Bias):
    """Mean error of the elevation of a target, where it is found."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "elevation"
