"""Target: motion, heading and radar cross section."""

import math
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from dechirp.core.checks import (
    Vector,
    check_and_convert_vector_field,
    check_instances,
    check_number,
    check_positive_fields,
)
from dechirp.core.display import Displayable, format_setting_value
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body
from dechirp.scene.rcs_table import RcsTable
from dechirp.scene.speed_limit import check_and_convert_velocity_field, check_speed_limit
from dechirp.scene.waypoints import SplineTrajectory, Waypoint, check_waypoint_times_ascend

Fluctuation = Literal["steady", "swerling-1", "swerling-2", "swerling-3", "swerling-4"]

_AT_REST: Vector = (0.0, 0.0, 0.0)
_DEFAULT_RCS_M2 = 1.0


@frozen_dataclass
class Target(Displayable):
    """One scatterer, or a body of many, on a straight line, a parabola or through waypoints.

    Its cross section is one of `rcs_m2`, `rcs_table` over aspect, or that of the scatterers of
    `body`.
    """

    name: str | None = None
    """Name in findings, truth and impairments; none: `target-N`, N its position in the scene."""
    position_m: Vector
    """Position at time zero, the start of the first frame; x forward, y left, z up. Of a body:
    the origin of its axes."""
    velocity_m_per_s: Vector = _AT_REST
    """Velocity at time zero."""
    acceleration_m_per_s2: Vector = _AT_REST
    """Acceleration, constant over time."""
    waypoints: tuple[Waypoint, ...] = ()
    """Waypoints after time zero, in place of velocity and acceleration: a natural cubic spline,
    straight on after the last."""
    heading_rad: float | None = None
    """Heading of the x axis of its body, to the left of the scene's. None: the direction of its
    motion at each instant, seen from above, 0 at rest. A target that reverses on a straight line
    keeps its heading."""
    turn_rate_rad_per_s: float = 0.0
    """Turn rate of a heading that is given, about the z axis of the scene, to the left positive."""
    rcs_m2: float = _DEFAULT_RCS_M2
    """Radar cross section (dBsm in files); the mean if it fluctuates."""
    rcs_table: RcsTable | None = None
    """Radar cross section over aspect, in place of `rcs_m2`."""
    body: Body | None = None
    """Body of many scatterers with their own cross sections, in place of `rcs_m2`."""
    fluctuation: Fluctuation = "steady"
    """Fluctuation of the cross section about its mean, independent for each scatterer. Swerling
    1 and 3: from frame to frame; 2 and 4: from chirp to chirp."""

    def __post_init__(self) -> None:
        if not (self.name is None or (isinstance(self.name, str) and self.name)):
            raise InvalidSetting(
                "Target.name",
                value=repr(self.name),
                expected="a non-empty string",
                fix="omit it for a name by position in the scene",
            )
        # Limits beyond the Moon, and from a grain of dust to a planet: other values indicate a
        # wrong unit.
        check_and_convert_vector_field(self, "position_m", max_magnitude=1e9)
        check_positive_fields(self, "rcs_m2", at_least=1e-12, at_most=1e12)
        check_and_convert_velocity_field(self, "velocity_m_per_s")
        if self.acceleration_m_per_s2 is not _AT_REST:
            # A bullet's is 1e6 m/s^2.
            check_and_convert_vector_field(self, "acceleration_m_per_s2", max_magnitude=1e9)
        self._check_waypoints()
        if self.heading_rad is not None:
            full_circle = 2 * math.pi
            heading = check_number(
                "Target.heading_rad", self.heading_rad, at_least=-full_circle, at_most=full_circle
            )
            object.__setattr__(self, "heading_rad", heading)
        self._check_turn_rate()
        self._check_cross_section_settings()

    def _check_waypoints(self) -> None:
        fix = "give each Waypoint its time and position"
        waypoints = check_instances("Target.waypoints", self.waypoints, Waypoint, fix=fix)
        object.__setattr__(self, "waypoints", waypoints)
        if not waypoints:
            return
        check_waypoint_times_ascend(self.waypoints, self.name or "the target")
        for name in ("velocity_m_per_s", "acceleration_m_per_s2"):
            if any(getattr(self, name)):
                raise InvalidSetting(
                    f"Target.{name}",
                    value=f"{getattr(self, name)} in addition to waypoints",
                    expected="no value: it follows from the waypoints",
                    fix="remove it or the waypoints",
                )
        check_speed_limit(
            "Target.waypoints", self._waypoint_trajectory.top_speed_m_per_s, context=" between them"
        )

    def _check_turn_rate(self) -> None:
        # As of the radar: faster than any spindle indicates a wrong unit.
        turn_rate = check_number(
            "Target.turn_rate_rad_per_s", self.turn_rate_rad_per_s, at_least=-1e5, at_most=1e5
        )
        object.__setattr__(self, "turn_rate_rad_per_s", turn_rate)
        if turn_rate and self.heading_rad is None:
            raise InvalidSetting(
                "Target.turn_rate_rad_per_s",
                value=f"{turn_rate:.4g} rad/s without a heading",
                expected="the heading at time zero that turns",
                fix="give heading_rad, or leave the turn rate out: the heading follows the motion",
            )

    def _check_cross_section_settings(self) -> None:
        for name, kind in (("body", Body), ("rcs_table", RcsTable)):
            if not isinstance(getattr(self, name), kind | None):
                raise InvalidSetting(
                    f"Target.{name}",
                    value=getattr(self, name),
                    expected=f"a {kind.__name__}, or none",
                    fix="create one, or omit it",
                )
        settings = [name for name in ("rcs_table", "body") if getattr(self, name) is not None]
        settings += ["rcs_m2"] if self.rcs_m2 != _DEFAULT_RCS_M2 else []
        if len(settings) > 1:
            raise InvalidSetting(
                f"Target.{settings[0]}",
                value=f"cannot be combined with {settings[1]}",
                expected="only one of rcs_m2, rcs_table and body: each defines the cross section",
                fix="remove one of them",
            )
        if not (isinstance(self.fluctuation, str) and self.fluctuation in get_args(Fluctuation)):
            raise InvalidSetting(
                "Target.fluctuation",
                value=repr(self.fluctuation),
                expected=f"one of {', '.join(get_args(Fluctuation))}",
                fix="choose one",
            )

    @property
    def has_parabolic_path(self) -> bool:
        """Return whether each of its scatterers follows a parabola or a straight line."""
        rigid = self.body is None or (self.body.is_rigid and self._constant_heading_rad is not None)
        return rigid and not self.waypoints

    def position_at_m(self, time_s: float) -> np.ndarray:
        """Return the position at a time, (3,)."""
        return np.asarray(self.position_m) + self.displacements_m(np.array([time_s]))[0]

    def displacements_m(self, times_s: np.ndarray) -> np.ndarray:
        """Return the displacements since time zero, (n_times, 3)."""
        if self.waypoints:
            return self._waypoint_trajectory.displacements_m(times_s)
        t = times_s[:, None]
        linear_m = t * np.array(self.velocity_m_per_s)
        return linear_m + t**2 / 2 * np.array(self.acceleration_m_per_s2)

    def velocities_at_m_per_s(self, times_s: np.ndarray) -> np.ndarray:
        """Return the velocity at each time, (n_times, 3)."""
        if self.waypoints:
            return self._waypoint_trajectory.velocities_m_per_s(times_s)
        velocity_changes = times_s[:, None] * np.array(self.acceleration_m_per_s2)
        return np.array(self.velocity_m_per_s) + velocity_changes

    def headings_at_rad(self, times_s: np.ndarray) -> np.ndarray:
        """Return the heading at each time, (n_times,)."""
        if self._constant_heading_rad is not None:
            return np.full(len(times_s), self._constant_heading_rad)
        if self.heading_rad is not None:
            return self.heading_rad + self.turn_rate_rad_per_s * times_s
        x, y, _ = self.velocities_at_m_per_s(times_s).T
        return np.arctan2(y, x)

    def _display_line(self) -> str:
        position, velocity, reflects = self._display_position_velocity_reflection()
        return f"{self.name or 'no name'} at {position}, {velocity}, {reflects}"

    def _display_position_velocity_reflection(self) -> tuple[str, str, str]:
        """Return position, velocity and reflection as text."""
        velocity = "at rest"
        if self.waypoints:
            velocity = f"through {len(self.waypoints)} waypoints"
        elif any(self.velocity_m_per_s) or any(self.acceleration_m_per_s2):
            velocity = format_setting_value(self.velocity_m_per_s, "m_per_s")
        reflection = (
            "a table over aspect" if self.rcs_table else format_setting_value(self.rcs_m2, "m2")
        )
        if self.body is not None:
            reflection = self.body.kind()
        reflection += f", {self.fluctuation}" if self.fluctuation != "steady" else ""
        return format_setting_value(self.position_m, "m"), velocity, reflection

    @cached_property
    def _waypoint_trajectory(self) -> SplineTrajectory:
        return SplineTrajectory(self.position_m, self.waypoints)

    @cached_property
    def _constant_heading_rad(self) -> float | None:
        """Return the heading if it is constant, else None."""
        if self.turn_rate_rad_per_s:
            return None
        if self.heading_rad is not None:
            return self.heading_rad
        displacements = [self.velocity_m_per_s, self.acceleration_m_per_s2]
        if self.waypoints:
            start = np.array(self.position_m)
            displacements = [tuple(point.position_m - start) for point in self.waypoints]
        horizontal = np.array(displacements)[:, :2]
        lengths = np.hypot(*horizontal.T)
        if not lengths.any():
            return 0.0
        x, y = horizontal[np.argmax(lengths > 0)]  # direction of the first motion
        if np.any(
            abs(x * horizontal[:, 1] - y * horizontal[:, 0]) > 1e-12 * np.hypot(x, y) * lengths
        ):
            return None
        return math.atan2(y, x)
