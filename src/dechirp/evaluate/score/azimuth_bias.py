"""Mean error of azimuths."""

from typing import ClassVar

from dechirp.core.values import value
from dechirp.evaluate.score.errors import Axis, Bias


@value
class AzimuthBias(Bias):
    """Mean error of the azimuth of a target, where it is found."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "azimuth"
