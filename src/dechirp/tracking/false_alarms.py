"""False alarms of a frame: how many there are, and where."""

from collections.abc import Iterator

import numpy as np

from dechirp.core.checks import positive, series
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value


@value
class FalseAlarms:
    """Detections without a target: a Poisson number, evenly in range, azimuth and velocity."""

    per_frame: float = 1.0
    """Mean number in a frame."""
    range_m: tuple[float, float] = (0.0, 200.0)
    """From, to."""
    azimuth_rad: tuple[float, float] = (-np.pi / 3, np.pi / 3)
    """From, to; left positive."""
    velocity_m_per_s: tuple[float, float] = (-50.0, 50.0)
    """From, to: the span of unambiguous velocity, where they are noise."""

    def __post_init__(self) -> None:
        positive(self, "per_frame", at_most=1e6)
        for name, bounds in (
            ("range_m", {"at_least": 0.0, "at_most": 1e6}),
            ("azimuth_rad", {"at_least": -np.pi, "at_most": np.pi}),
            ("velocity_m_per_s", {"at_least": -1e5, "at_most": 1e5}),
        ):
            where = f"FalseAlarms.{name}"
            ends = series(where, getattr(self, name), **bounds)
            if len(ends) != 2 or not ends[0] < ends[1]:
                raise InvalidSetting(
                    where,
                    got=getattr(self, name),
                    need="two numbers, the smaller one first",
                    fix="Say from where to where false alarms are.",
                )
            object.__setattr__(self, name, ends)

    @property
    def density_per_m_rad_m_per_s(self) -> float:
        """Mean number in a frame, for each metre, radian and metre per second."""
        return self.per_frame / float(np.prod([high - low for low, high in self.bounds]))

    @property
    def velocity_extent_m_per_s(self) -> float:
        """From the lowest velocity to the highest."""
        low, high = self.velocity_m_per_s
        return high - low

    @property
    def bounds(self) -> Iterator[tuple[float, float]]:
        """Of range, azimuth and velocity."""
        return iter((self.range_m, self.azimuth_rad, self.velocity_m_per_s))
