"""Root mean square error of velocities."""

from typing import ClassVar

from dechirp.core.values import value
from dechirp.evaluate.score.errors import Axis, Rmse


@value
class VelocityRmse(Rmse):
    """Root mean square error of the velocity of a target, where it is found."""

    unit: ClassVar[str | None] = "m_per_s"
    axis: ClassVar[Axis] = "velocity"
