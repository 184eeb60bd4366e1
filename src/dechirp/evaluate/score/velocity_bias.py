"""Mean error of velocities."""

from typing import ClassVar

from dechirp.core.values import value
from dechirp.evaluate.score.errors import Axis, Bias


@value
class VelocityBias(Bias):
    """Mean error of the velocity of a target, where it is found."""

    unit: ClassVar[str | None] = "m_per_s"
    axis: ClassVar[Axis] = "velocity"
