"""Wall multipath: ghost targets behind a wall or guard rail."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from dechirp.core.checks import as_tuple_or_none, check_number, check_positive_fields
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.echo_groups import EchoGroup, SampleWindow
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.mirror_images import (
    MIN_MIRROR_DISTANCE_M,
    Mirror,
    group_and_reflected_copies,
    mid_run_time_s,
    up_vector_in_radar_axes,
)

Point = tuple[float, float]

# Largest angle between the wall and the motion of the radar: at 50 m/s the distance changes by 1 um
# in a frame of 20 ms, 0.1 degrees of phase at 77 GHz.
_MAX_LATERAL_RATIO = 1e-6


@frozen_dataclass
class WallMultipath(Propagation):
    """Reflections off a vertical, plane wall of unlimited height between two points.

    Each target has three ghosts: with the outbound path, the inbound path, or both via the wall.
    The
    third is at the image of the target. The first two are halfway to it in range and in velocity;
    the
    transmitters observe one at the angle of the target and the receivers at that of the image, and
    the
    other vice versa. A path exists if its point of reflection lies between the ends of the wall,
    decided for each scatterer at the middle of the frame, or of the runs of chirps into which a
    frame
    is split for turning targets. Each reflection reverses the phase, like a metal, or any material
    at
    grazing incidence.

    The radar must keep its distance from the wall: be at rest, or drive along it without turning.
    Only
    scatterers on the radar's side are mirrored; scatterers behind it
    are shadowed (`scene.shadowing`). Cross sections are those of
    the
    direct path, gains those of each path: a target may have a ghost without a direct echo. Each of
    several walls has its own ghosts, without paths via two walls; paths via the ground are
    included,
    whichever is listed first. Rain and other losses include the longer paths if listed after it.
    """

    start_m: Point
    """One end, (x, y) in coordinates of the scene."""
    end_m: Point
    """The other end, (x, y)."""
    reflectivity: float = 1.0
    """Fraction of the power that is reflected, at most 1 (0 dB)."""

    def __post_init__(self) -> None:
        for name in ("start_m", "end_m"):
            self._check_wall_end_coordinates(name)
        check_positive_fields(self, "reflectivity", at_most=1.0)
        if self._wall_length_m < 1e-3:
            raise InvalidSetting(
                "WallMultipath.end_m",
                value=f"{self.end_m}, {self._wall_length_m:g} m from start",
                expected="at least 1 mm away from start",
                fix="give both ends, each as [x, y]",
            )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a wall through the radar, or one that the radar does not drive along."""
        ego = scene.ego
        if ego.is_turning:
            raise InvalidSetting(
                "start",
                value=f"a wall, with scene.ego turning at {ego.turn_rate_rad_per_s:.4g} rad/s",
                expected="a radar that does not turn",
                fix="remove turn_rate from scene.ego, or remove the wall",
            )
        velocity = np.array(ego.velocity_m_per_s)
        direction = np.array([*self._unit_direction_along_wall, 0.0])
        lateral_m_per_s = abs(np.cross(direction, velocity)[2])
        if lateral_m_per_s > _MAX_LATERAL_RATIO * np.linalg.norm(velocity):
            corrected_end = velocity[:2] / np.linalg.norm(velocity[:2])
            corrected_end *= self._wall_length_m * (1 if direction @ velocity >= 0 else -1)
            x, y = np.array(self.start_m) + corrected_end
            raise InvalidSetting(
                "end",
                value=f"{list(self.end_m)} m, with scene.ego moving at {lateral_m_per_s:.4g} m/s"
                " towards or away from the wall",
                expected="a radar that drives along the wall",
                fix=f"give [{x:.9g} m, {y:.9g} m], or turn scene.ego.velocity",
            )
        mirror = self._wall_mirror(scene, 0.0)
        for kind, antennas_m in (("transmitter", radar.array.tx_m), ("receiver", radar.array.rx_m)):
            distances_m = mirror.signed_distances_m(np.array(antennas_m))
            if distances_m.min() < MIN_MIRROR_DISTANCE_M:
                raise InvalidSetting(
                    "start",
                    value=f"a wall whose line passes {kind} {distances_m.argmin()} at"
                    f" {abs(distances_m.min()):.4g} m",
                    expected=f"all antennas on one side, at least {MIN_MIRROR_DISTANCE_M:g} m away",
                    fix="move the wall, or scene.ego.position",
                )

    def ends_from_radar_m(self, scene: Scene, time_s: float) -> np.ndarray:
        """Return both ends from above, x + i y, relative to the radar, along axes of the scene.

        The wall shadows what is behind it.
        """
        radar_m = np.array(scene.ego.position_m) + scene.ego.displacements_m(np.array([time_s]))[0]
        return np.array([complex(*self.start_m), complex(*self.end_m)]) - complex(*radar_m[:2])

    def transform_echoes(
        self,
        groups: Sequence[EchoGroup],
        window: SampleWindow,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[EchoGroup]:
        """Yield each group, and its copies with reflected outbound, inbound, or both paths."""
        upwards = up_vector_in_radar_axes(scene)
        reflected: list[EchoGroup] = []
        for group in groups:
            time_s = mid_run_time_s(group, window)
            mirror = self._wall_mirror(scene, time_s)
            coefficients = partial(self._reflection_coefficients, mirror, scene, time_s)
            reflected += group_and_reflected_copies(group, mirror, coefficients, radar, upwards)
        return reflected

    def _reflection_coefficients(
        self,
        mirror: Mirror,
        scene: Scene,
        time_s: float,
        image_m: np.ndarray,
        positions_m: np.ndarray,
    ) -> np.ndarray:
        """Return the coefficients of paths from an image, (3,), to points, (n, 3)."""
        behind_m = -mirror.signed_distances_m(image_m[None])
        ahead_m = np.maximum(mirror.signed_distances_m(positions_m), 0.0)
        points_m = image_m + (behind_m / (behind_m + ahead_m))[:, None] * (positions_m - image_m)
        direction = self._rotate_to_radar_axes(
            np.array([*self._unit_direction_along_wall, 0.0]), scene
        )
        along_m = (points_m - self._to_radar_coordinates_m(self.start_m, scene, time_s)) @ direction
        is_between = (along_m >= 0) & (along_m <= self._wall_length_m)
        return np.where(is_between, -np.sqrt(self.reflectivity), 0.0)

    def _wall_mirror(self, scene: Scene, time_s: float) -> Mirror:
        x, y = self._unit_direction_along_wall
        normal = self._rotate_to_radar_axes(np.array([-y, x, 0.0]), scene)
        offset_m = float(normal @ self._to_radar_coordinates_m(self.start_m, scene, time_s))
        return Mirror(normal, offset_m) if offset_m < 0 else Mirror(-normal, -offset_m)

    def _to_radar_coordinates_m(self, point_m: Point, scene: Scene, time_s: float) -> np.ndarray:
        """Return a point in the coordinates of the radar, (3,)."""
        offset_from_ego_m = np.array([*point_m, 0.0]) - np.array(scene.ego.position_m)
        return self._rotate_to_radar_axes(
            offset_from_ego_m - scene.ego.displacements_m(np.array([time_s]))[0], scene
        )

    def _rotate_to_radar_axes(self, vector: np.ndarray, scene: Scene) -> np.ndarray:
        return np.asarray(scene.ego.axes(np.zeros(1))[0].T @ vector)

    @property
    def _unit_direction_along_wall(self) -> np.ndarray:
        return (np.array(self.end_m) - np.array(self.start_m)) / self._wall_length_m

    @property
    def _wall_length_m(self) -> float:
        return float(np.linalg.norm(np.array(self.end_m) - np.array(self.start_m)))

    def _check_wall_end_coordinates(self, field: str) -> None:
        setting, coordinates = f"WallMultipath.{field}", getattr(self, field)
        members = as_tuple_or_none(coordinates) or ()
        if len(members) != 2:
            raise InvalidSetting(
                setting,
                value=coordinates,
                expected="two finite numbers (x, y)",
                fix="leave out its height",
            )
        x, y = (
            check_number(setting, coordinate, at_least=-1e9, at_most=1e9) for coordinate in members
        )
        object.__setattr__(self, field, (x, y))
