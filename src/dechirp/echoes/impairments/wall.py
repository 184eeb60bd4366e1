"""A wall or guard rail: ghosts of what drives beside it."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from dechirp.core.checks import listed, number, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.echoes.images import NEAREST_M, Mirror, mid_run_s, reflected, up
from dechirp.echoes.impairments.base import Propagation
from dechirp.echoes.parts import Part, Window
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

Point = tuple[float, float]

# The largest angle between the wall and where the radar goes: at 50 m/s the distance changes
# by 1 um in a frame of 20 ms, 0.1 degrees of phase at 77 GHz.
_ASIDE = 1e-6


@value
class Wall(Propagation):
    """Reflections off an upright, plane wall, of any height, between two points.

    Each target gets three ghosts: with the way there, the way back, or both ways off the wall.
    The third is at the image of the target. The first two are halfway to it in range and in
    velocity; the transmitters see one at the angle of the target and the receivers at that of
    the image, and the other the other way round. A way is there where its point of reflection
    lies between the ends, decided for each scatterer at the middle of the frame, or of the runs
    of chirps into which a frame is split for targets that turn. Each reflection turns the phase
    by half a circle, as metal does, and anything at grazing incidence.

    The radar must keep its distance from the wall: be at rest, or drive along it without
    turning. Only what is on the radar's side is mirrored; nothing is hidden by the wall. Cross
    sections are those seen straight, gains those of each way: what only its image shows to the
    antennas has a ghost all the same. Of several walls each makes its ghosts, none ways off two;
    ways go off the ground as well, whichever is listed first. Rain and other losses take the
    longer ways into account where they are listed after it.
    """

    start_m: Point
    """One end, (x, y) in coordinates of the scene."""
    end_m: Point
    """The other end, (x, y)."""
    reflectivity: float = 1.0
    """Power that it reflects, a ratio of at most 1 (0 dB)."""

    def __post_init__(self) -> None:
        for name in ("start_m", "end_m"):
            self._keep_point(name)
        positive(self, "reflectivity", at_most=1.0)
        if self._length_m < 1e-3:
            raise InvalidSetting(
                "Wall.end_m",
                got=f"{self.end_m}, {self._length_m:g} m from start",
                need="at least 1 mm away from start",
                fix="Give both ends, as [x, y].",
            )

    def check(self, scene: Scene, radar: Radar) -> None:
        """Raise for a wall through the radar, or one that the radar does not drive along."""
        ego = scene.ego
        if ego.is_turning:
            raise InvalidSetting(
                "start",
                got=f"a wall, and scene.ego turns at {ego.turn_rate_rad_per_s:.4g} rad/s",
                need="seen by a radar that does not turn",
                fix="Take turn_rate out of scene.ego, or the wall out.",
            )
        velocity = np.array(ego.velocity_m_per_s)
        along = np.array([*self._along, 0.0])
        aside_m_per_s = abs(np.cross(along, velocity)[2])
        if aside_m_per_s > _ASIDE * np.linalg.norm(velocity):
            way = velocity[:2] / np.linalg.norm(velocity[:2])
            way *= self._length_m * (1 if along @ velocity >= 0 else -1)
            x, y = np.array(self.start_m) + way
            raise InvalidSetting(
                "end",
                got=f"{list(self.end_m)} m, and scene.ego comes {aside_m_per_s:.4g} m/s nearer"
                " to the wall, or farther from it",
                need="such that the radar drives along the wall",
                fix=f"Give [{x:.9g} m, {y:.9g} m], or turn scene.ego.velocity.",
            )
        mirror = self._mirror(scene, 0.0)
        for kind, antennas_m in (("transmitter", radar.array.tx_m), ("receiver", radar.array.rx_m)):
            distances_m = mirror.distances_m(np.array(antennas_m))
            if distances_m.min() < NEAREST_M:
                raise InvalidSetting(
                    "start",
                    got=f"a wall whose line passes {kind} {distances_m.argmin()} at"
                    f" {abs(distances_m.min()):.4g} m",
                    need=f"a line that has all antennas on one side, {NEAREST_M:g} m off at least",
                    fix="Move the wall, or scene.ego.position.",
                )

    def parts(
        self,
        parts: Sequence[Part],
        window: Window,
        scene: Scene,
        radar: Radar,
        rng: np.random.Generator,
    ) -> list[Part]:
        """Each part, and the same there, back, or both ways off the wall."""
        upwards = up(scene)
        found: list[Part] = []
        for part in parts:
            time_s = mid_run_s(part, window)
            mirror = self._mirror(scene, time_s)
            coefficients = partial(self._coefficients, mirror, scene, time_s)
            found += reflected(part, mirror, coefficients, radar, upwards)
        return found

    def _coefficients(
        self,
        mirror: Mirror,
        scene: Scene,
        time_s: float,
        image_m: np.ndarray,
        places_m: np.ndarray,
    ) -> np.ndarray:
        """Of ways from an image, (3,), to places, (n, 3): 0 for those past the ends, (n,)."""
        behind_m = -mirror.distances_m(image_m[None])
        ahead_m = np.maximum(mirror.distances_m(places_m), 0.0)
        points_m = image_m + (behind_m / (behind_m + ahead_m))[:, None] * (places_m - image_m)
        along = self._into(np.array([*self._along, 0.0]), scene)
        along_m = (points_m - self._seen_m(self.start_m, scene, time_s)) @ along
        is_between = (along_m >= 0) & (along_m <= self._length_m)
        return np.where(is_between, -np.sqrt(self.reflectivity), 0.0)

    def _mirror(self, scene: Scene, time_s: float) -> Mirror:
        x, y = self._along
        normal = self._into(np.array([-y, x, 0.0]), scene)
        offset_m = float(normal @ self._seen_m(self.start_m, scene, time_s))
        return Mirror(normal, offset_m) if offset_m < 0 else Mirror(-normal, -offset_m)

    def _seen_m(self, point_m: Point, scene: Scene, time_s: float) -> np.ndarray:
        """A point in the coordinates of the radar, (3,)."""
        at_m = np.array([*point_m, 0.0]) - np.array(scene.ego.position_m)
        return self._into(at_m - scene.ego.ways_m(np.array([time_s]))[0], scene)

    def _into(self, vector: np.ndarray, scene: Scene) -> np.ndarray:
        return np.asarray(scene.ego.axes(np.zeros(1))[0].T @ vector)

    @property
    def _along(self) -> np.ndarray:
        return (np.array(self.end_m) - np.array(self.start_m)) / self._length_m

    @property
    def _length_m(self) -> float:
        return float(np.linalg.norm(np.array(self.end_m) - np.array(self.start_m)))

    def _keep_point(self, name: str) -> None:
        where, given = f"Wall.{name}", getattr(self, name)
        members = listed(given) or ()
        if len(members) != 2:
            raise InvalidSetting(
                where, got=given, need="two finite numbers (x, y)", fix="Leave out its height."
            )
        x, y = (number(where, one, at_least=-1e9, at_most=1e9) for one in members)
        object.__setattr__(self, name, (x, y))
