"""A point target and how it moves."""

import math
from typing import Literal

import numpy as np

from dechirp.core.checks import Vector, positive, vector
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.core.values import value


def slow_vector(owner: object, name: str) -> None:
    """Keep the named field as a vector far below the speed of light, or raise `InvalidSetting`."""
    vector(owner, name, at_most=math.inf)
    speed = math.hypot(*getattr(owner, name))
    # The time light takes back is neglected, an error of the relative size v / c.
    if speed > SPEED_OF_LIGHT / 1000:
        raise InvalidSetting(
            f"{type(owner).__name__}.{name}",
            got=f"{speed:.4g} m/s",
            need=f"at most {SPEED_OF_LIGHT / 1000:.6g} m/s, a thousandth of that of light",
            fix="Check the unit of the velocity.",
        )


@value
class Target:
    """A steady point scatterer on a straight line at constant speed."""

    name: str | None = None
    """How findings, truth and impairments call it; none: `target-N`, N its place in the scene."""
    position_m: Vector
    """At time zero, the start of the first frame; x forward, y left, z up."""
    velocity_m_per_s: Vector = (0.0, 0.0, 0.0)
    rcs_m2: float = 1.0
    """Radar cross section (dBsm in files)."""
    fluctuation: Literal["steady"] = "steady"
    """How the cross section varies: the only kind there is yet."""

    def __post_init__(self) -> None:
        if not (self.name is None or (isinstance(self.name, str) and self.name)):
            raise InvalidSetting(
                "Target.name",
                got=repr(self.name),
                need="a text of at least one letter",
                fix="Leave it out for a name by its place in the scene.",
            )
        # Beyond the Moon, and from a grain of dust to a planet: outside, a unit is wrong.
        vector(self, "position_m", at_most=1e9)
        positive(self, "rcs_m2", at_least=1e-12, at_most=1e12)
        slow_vector(self, "velocity_m_per_s")

    def position_at_m(self, time_s: float) -> np.ndarray:
        """Position at a time, (3,)."""
        return np.asarray(self.position_m) + time_s * np.asarray(self.velocity_m_per_s)
