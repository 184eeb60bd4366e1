"""A target: how it moves, where it faces, and how much it reflects."""

import math
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from dechirp.core.checks import Vector, instances, number, positive, vector
from dechirp.core.displayed import Displayed, told
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.scene.bodies.base import Body
from dechirp.scene.rcs_table import RcsTable
from dechirp.scene.slow import must_be_slow, slow_vector
from dechirp.scene.waypoints import Course, Waypoint, must_go_on

Fluctuation = Literal["steady", "swerling-1", "swerling-2", "swerling-3", "swerling-4"]

_AT_REST: Vector = (0.0, 0.0, 0.0)
_USUAL_RCS_M2 = 1.0


@value
class Target(Displayed):
    """One scatterer, or a body of many, on a straight line, a parabola or through waypoints.

    Its cross section is `rcs_m2`, or a table over aspect, or that of its body's scatterers:
    only one of the three is given.
    """

    name: str | None = None
    """How findings, truth and impairments call it; none: `target-N`, N its place in the scene."""
    position_m: Vector
    """At time zero, the start of the first frame; x forward, y left, z up. Of a body: where the
    origin of its axes is."""
    velocity_m_per_s: Vector = _AT_REST
    """At time zero."""
    acceleration_m_per_s2: Vector = _AT_REST
    """At all times."""
    waypoints: tuple[Waypoint, ...] = ()
    """Through which it goes after time zero, instead of velocity and acceleration: on a natural
    cubic spline, straight on after the last."""
    heading_rad: float | None = None
    """Of the x axis of its body, to the left of the scene's. None: where it goes at each
    instant, seen from above, 0 at rest. One that backs up on its own line faces as before."""
    rcs_m2: float = _USUAL_RCS_M2
    """Radar cross section (dBsm in files), its mean where it fluctuates."""
    rcs_table: RcsTable | None = None
    """Radar cross section over aspect, instead."""
    body: Body | None = None
    """Many scatterers with cross sections of their own, instead."""
    fluctuation: Fluctuation = "steady"
    """How the cross section varies about its mean, in each scatterer by itself. Swerling 1 and
    3: from frame to frame; 2 and 4: from chirp to chirp."""

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
        if self.acceleration_m_per_s2 is not _AT_REST:
            vector(self, "acceleration_m_per_s2", at_most=1e9)  # a bullet's is 1e6 m/s^2
        self._check_waypoints()
        if self.heading_rad is not None:
            turn = 2 * math.pi
            heading = number("Target.heading_rad", self.heading_rad, at_least=-turn, at_most=turn)
            object.__setattr__(self, "heading_rad", heading)
        self._check_kinds()

    def _check_waypoints(self) -> None:
        fix = "Give each Waypoint its time and its position."
        points = instances("Target.waypoints", self.waypoints, Waypoint, fix=fix)
        object.__setattr__(self, "waypoints", points)
        if not points:
            return
        must_go_on(self.waypoints, self.name or "the target")
        for name in ("velocity_m_per_s", "acceleration_m_per_s2"):
            if any(getattr(self, name)):
                raise InvalidSetting(
                    f"Target.{name}",
                    got=f"{getattr(self, name)} beside waypoints",
                    need="left out: it follows from the waypoints",
                    fix="Take it or the waypoints out.",
                )
        must_be_slow("Target.waypoints", self._course.top_speed_m_per_s, of=" between them")

    def _check_kinds(self) -> None:
        for name, kind in (("body", Body), ("rcs_table", RcsTable)):
            if not isinstance(getattr(self, name), kind | None):
                raise InvalidSetting(
                    f"Target.{name}",
                    got=getattr(self, name),
                    need=f"a {kind.__name__}, or none",
                    fix="Make one, or leave it out.",
                )
        given = [name for name in ("rcs_table", "body") if getattr(self, name) is not None]
        given += ["rcs_m2"] if self.rcs_m2 != _USUAL_RCS_M2 else []
        if len(given) > 1:
            raise InvalidSetting(
                f"Target.{given[0]}",
                got=f"given beside {given[1]}",
                need="the only one of rcs_m2, rcs_table and body: each tells the cross section",
                fix="Take one of them out.",
            )
        if not (isinstance(self.fluctuation, str) and self.fluctuation in get_args(Fluctuation)):
            raise InvalidSetting(
                "Target.fluctuation",
                got=repr(self.fluctuation),
                need=f"one of {', '.join(get_args(Fluctuation))}",
                fix="Choose one.",
            )

    @property
    def is_straight(self) -> bool:
        """Whether each of its scatterers goes along a parabola, a straight line among them."""
        rigid = self.body is None or (self.body.is_rigid and self._facing_rad is not None)
        return rigid and not self.waypoints

    def position_at_m(self, time_s: float) -> np.ndarray:
        """Position at a time, (3,)."""
        return np.asarray(self.position_m) + self.ways_m(np.array([time_s]))[0]

    def ways_m(self, times_s: np.ndarray) -> np.ndarray:
        """How far it has come since time zero, (n_times, 3)."""
        if self.waypoints:
            return self._course.ways_m(times_s)
        t = times_s[:, None]
        way_m = t * np.array(self.velocity_m_per_s)
        return way_m + t**2 / 2 * np.array(self.acceleration_m_per_s2)

    def velocities_at_m_per_s(self, times_s: np.ndarray) -> np.ndarray:
        """Velocity at each time, (n_times, 3)."""
        if self.waypoints:
            return self._course.velocities_m_per_s(times_s)
        gained = times_s[:, None] * np.array(self.acceleration_m_per_s2)
        return np.array(self.velocity_m_per_s) + gained

    def headings_at_rad(self, times_s: np.ndarray) -> np.ndarray:
        """Heading at each time, (n_times,)."""
        if self._facing_rad is not None:
            return np.full(len(times_s), self._facing_rad)
        x, y, _ = self.velocities_at_m_per_s(times_s).T
        return np.arctan2(y, x)

    def _line(self) -> str:
        position, velocity, reflects = self._cells()
        return f"{self.name or 'no name'} at {position}, {velocity}, {reflects}"

    def _cells(self) -> tuple[str, str, str]:
        """Position, velocity and what it reflects, in words."""
        velocity = "at rest"
        if self.waypoints:
            velocity = f"through {len(self.waypoints)} waypoints"
        elif any(self.velocity_m_per_s) or any(self.acceleration_m_per_s2):
            velocity = told(self.velocity_m_per_s, "m_per_s")
        reflects = "a table over aspect" if self.rcs_table else told(self.rcs_m2, "m2")
        if self.body is not None:
            reflects = self.body.kind()
        reflects += f", {self.fluctuation}" if self.fluctuation != "steady" else ""
        return told(self.position_m, "m"), velocity, reflects

    @cached_property
    def _course(self) -> Course:
        return Course(self.position_m, self.waypoints)

    @cached_property
    def _facing_rad(self) -> float | None:
        """The heading where it never changes, else None."""
        if self.heading_rad is not None:
            return self.heading_rad
        steps = [self.velocity_m_per_s, self.acceleration_m_per_s2]
        if self.waypoints:
            start = np.array(self.position_m)
            steps = [tuple(point.position_m - start) for point in self.waypoints]
        flat = np.array(steps)[:, :2]
        lengths = np.hypot(*flat.T)
        if not lengths.any():
            return 0.0
        x, y = flat[np.argmax(lengths > 0)]  # where it goes first
        if np.any(abs(x * flat[:, 1] - y * flat[:, 0]) > 1e-12 * np.hypot(x, y) * lengths):
            return None
        return math.atan2(y, x)
