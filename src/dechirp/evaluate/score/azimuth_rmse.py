"""Root mean square error of azimuths."""

from typing import ClassVar

from dechirp.core.values import value
from dechirp.evaluate.score.errors import Axis, Rmse


@value
class AzimuthRmse(Rmse):
    """Root mean square error of the azimuth of a target, where it is found."""

    unit: ClassVar[str | None] = "rad"
    axis: ClassVar[Axis] = "azimuth"
