"""Density of false alarms, assumed by a tracker."""

from collections.abc import Iterator

import numpy as np

from dechirp.core.checks import check_numbers, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class FalseAlarms:
    """Detections without a target: Poisson number, uniform in range, azimuth and velocity."""

    per_frame: float = 1.0
    """Mean number per frame."""
    range_m: tuple[float, float] = (0.0, 200.0)
    """Lower and upper limit."""
    azimuth_rad: tuple[float, float] = (-np.pi / 3, np.pi / 3)
    """Lower and upper limit; left positive."""
    velocity_m_per_s: tuple[float, float] = (-50.0, 50.0)
    """Lower and upper limit: the unambiguous velocity span, if they are noise."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "per_frame", at_most=1e6)
        for name, bounds in (
            ("range_m", {"at_least": 0.0, "at_most": 1e6}),
            ("azimuth_rad", {"at_least": -np.pi, "at_most": np.pi}),
            ("velocity_m_per_s", {"at_least": -1e5, "at_most": 1e5}),
        ):
            where = f"FalseAlarms.{name}"
            ends = check_numbers(where, getattr(self, name), **bounds)
            if len(ends) != 2 or not ends[0] < ends[1]:
                raise InvalidSetting(
                    where,
                    value=getattr(self, name),
                    expected="two numbers, the smaller one first",
                    fix="write the lower limit, then the upper one",
                )
            object.__setattr__(self, name, ends)

    @property
    def density_per_m_rad_m_per_s(self) -> float:
        """Mean number per frame, metre, radian and metre per second."""
        return self.per_frame / float(
            np.prod([high - low for low, high in self.range_azimuth_velocity_bounds])
        )

    @property
    def velocity_span_m_per_s(self) -> float:
        """Width of the velocity interval."""
        low, high = self.velocity_m_per_s
        return high - low

    @property
    def range_azimuth_velocity_bounds(self) -> Iterator[tuple[float, float]]:
        """Limits of range, azimuth and velocity."""
        return iter((self.range_m, self.azimuth_rad, self.velocity_m_per_s))
