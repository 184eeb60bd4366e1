"""The scene from above: x forward up the page, y to the left."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.core.words import number
from dechirp.report.figures import ground
from dechirp.report.figures.parts import legend
from dechirp.report.figures.style import BLUE, INK, ORANGE, TALL_IN
from dechirp.report.places import in_bodies
from dechirp.scene.rotations import into
from dechirp.scene.scene import Scene

_MOST_ARCS, _FEW_ARCS = 20, 6
_FEW_NAMES, _MOST_NAMES = 8, 24
_HIGH_IN = 4.6
_MOST_ARROWS = 200
_MOST_POINTS = 600
# Where nothing is further aside than this part of the length, a road, it is drawn wider.
_NARROW = 0.3
_OUTSIDE = 0.45  # of the width, within which names stand outside


@value
class _Drawn:
    """What is drawn, in coordinates of the radar: x, y of each."""

    places_m: np.ndarray
    points_m: np.ndarray
    """Scatterers of bodies."""
    arrows_m: np.ndarray
    """From each target, its way over ground in a while."""
    headings: np.ndarray
    """Direction of the x axis of each target."""
    courses_m: list[np.ndarray]
    """Ways through waypoints."""
    stops_m: np.ndarray
    """The waypoints."""
    ego_m: np.ndarray
    """The radar's own way in that while."""


def from_above(
    axes: Axes,
    scene: Scene,
    *,
    time_s: float = 0.0,
    detected_m: Sequence[float] = (),
    seen: ground.Seen | None = None,
) -> Axes:
    """Draw targets with their velocities over ground, the radar, and detections.

    Parameters
    ----------
    axes : Axes
        To draw on.
    scene : Scene
        Drawn as it is at `time_s`, in coordinates of the radar then; of large bodies some of
        the scatterers.
    time_s : float
        Of the first estimates: the middle of the first frame.
    detected_m : sequence, m
        Ranges of the detections without directions, strongest first: arcs.
    seen : Seen, optional
        The detections with directions: places, with ellipses of their errors.

    Returns
    -------
    Axes
        Those given.
    """
    way_s = _while_s(scene, time_s)
    drawn = _drawn(scene, time_s, way_s)
    reach_m = _reach_m(drawn)
    ends_m = np.vstack(
        [drawn.places_m, drawn.points_m, drawn.places_m + drawn.arrows_m, drawn.ego_m, [[0, 0]]]
    )
    front = ends_m[:, 0].max() + 0.12 * reach_m
    back = min(ends_m[:, 0].min() - 0.08 * reach_m, -0.1 * reach_m)
    aside_m = 1.25 * abs(ends_m[:, 1]).max()
    is_narrow = aside_m < _NARROW * (front - back)
    # At least as wide as the figure: 1.4 times its height once the labels have their room.
    side = max(aside_m, (0.1 if is_narrow else 0.7) * (front - back))
    axes.set_aspect("auto" if is_narrow else "equal")
    axes.set(xlim=(side, -side), ylim=(back, front))
    ground.rings(axes, math.hypot(max(front, -back), side))
    _arcs(axes, detected_m)
    _ways(axes, drawn)
    _targets(axes, drawn, 0.05 * reach_m, way_s)
    if seen is not None:
        ground.detections(axes, seen)
    small = 1.0 if len(scene.names) <= _FEW_NAMES else 0.8
    for name, place in list(zip(scene.names, drawn.places_m, strict=True))[:_MOST_NAMES]:
        # Outside of its target, where the figure does not end soon.
        is_left = (place[1] > 0) == (abs(place[1]) < _OUTSIDE * side)
        axes.annotate(
            name,
            (place[1], place[0]),
            (-7 if is_left else 7, 4),
            textcoords="offset points",
            ha="right" if is_left else "left",
            fontsize=small * mpl.rcParams["font.size"],
            clip_on=True,
        )
    axes.set_xlabel(ground.SIDE + (", drawn wider" if is_narrow else ""))
    axes.set_ylabel(ground.FORWARD)
    legend(axes)
    axes.set_label("The scene from above")
    return axes


def height_in(scene: Scene) -> float:
    """Height of a figure in which the names have room."""
    return _HIGH_IN if len(scene.targets) > _FEW_NAMES else TALL_IN


def _drawn(scene: Scene, time_s: float, way_s: float) -> _Drawn:
    at_s = np.array([time_s])
    here_m = np.array(scene.ego.position_m) + scene.ego.ways_m(at_s)
    axes = scene.ego.axes(at_s)

    def seen(places_m: np.ndarray) -> np.ndarray:
        """From coordinates of the scene, (n, 3), to x and y of the radar's, (n, 2)."""
        return into(axes, (places_m - here_m)[None])[0, :, :2]

    on_ground = into(axes, scene.ego.velocities_m_per_s(at_s)[:, None])
    arrows_m = way_s * (scene.target_velocities_m_per_s(at_s) + on_ground)[0, :, :2]
    courses_m, stops_m = [], [np.empty((0, 2))]
    for place in np.flatnonzero([bool(target.waypoints) for target in scene.targets]):
        target = scene.targets[place]
        arrows_m[place] = 0  # its course is drawn
        times_s = np.linspace(0, target.waypoints[-1].time_s, 200)
        courses_m.append(seen(np.array(target.position_m) + target.ways_m(times_s)))
        stops_m.append(seen(np.array([point.position_m for point in target.waypoints])))
    facing = [target.headings_at_rad(at_s)[0] for target in scene.targets]
    facing_to = np.stack([np.cos(facing), np.sin(facing), np.zeros(len(facing))], axis=-1)
    times_s = time_s + np.linspace(0, way_s, 50)
    return _Drawn(
        places_m=scene.target_positions_m(at_s)[0, :, :2],
        points_m=scene.positions_m(at_s)[0, in_bodies(scene, _MOST_POINTS), :2],
        arrows_m=arrows_m,
        headings=into(axes, facing_to[None])[0, :, :2],
        courses_m=courses_m,
        stops_m=np.vstack(stops_m),
        ego_m=seen(np.array(scene.ego.position_m) + scene.ego.ways_m(times_s)),
    )


def _reach_m(drawn: _Drawn) -> float:
    points_m = np.vstack([drawn.places_m, drawn.points_m])
    return max(1.0, float(np.hypot(*points_m.T).max(initial=0.0)))


def _arcs(axes: Axes, detected_m: Sequence[float]) -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    for range_m in detected_m[:_MOST_ARCS]:
        axes.plot(
            range_m * np.sin(angle),
            range_m * np.cos(angle),
            color=ORANGE,
            linewidth=1.3 if len(detected_m) <= _FEW_ARCS else 0.6,
            linestyle=(0, (5, 3)),
            label="range of a detection",
        )


def _ways(axes: Axes, drawn: _Drawn) -> None:
    """Draw the courses through waypoints, and the radar's own way."""
    for course_m in drawn.courses_m:
        axes.plot(*course_m.T[::-1], color=BLUE, linewidth=0.8, label="way through waypoints")
    axes.plot(*drawn.stops_m.T[::-1], linestyle="", marker="|", markersize=5, color=BLUE)
    axes.plot(*drawn.ego_m.T[::-1], color=INK, linewidth=1.4)
    ground.arrow(axes, drawn.ego_m[-2], drawn.ego_m[-1], INK)


def _targets(axes: Axes, drawn: _Drawn, stroke_m: float, way_s: float) -> None:
    ends_m = drawn.places_m + stroke_m * drawn.headings
    for place, end in list(zip(drawn.places_m, ends_m, strict=True))[:_MOST_ARROWS]:
        axes.plot(*np.array([place, end]).T[::-1], color=BLUE, linewidth=2.2, alpha=0.5)
    tips_m = drawn.places_m + drawn.arrows_m
    for place, tip in list(zip(drawn.places_m, tips_m, strict=True))[:_MOST_ARROWS]:
        ground.arrow(axes, place, tip, BLUE)
    if len(drawn.points_m):
        axes.plot(
            *drawn.points_m.T[::-1],
            linestyle="",
            marker=".",
            markersize=2,
            color=INK,
            label="scatterers of bodies",
        )
    axes.plot(
        *drawn.places_m.T[::-1],
        linestyle="",
        marker="o",
        markersize=6 if len(drawn.places_m) <= 8 else 3.5,
        color=BLUE,
        label=f"target, its way in {number(way_s)} s" if way_s else "target",
    )


def _while_s(scene: Scene, time_s: float) -> float:
    """Choose a round time in which the fastest goes about a quarter of the way shown."""
    at_s = np.array([time_s])
    ego = scene.ego.velocities_m_per_s(at_s)
    on_ground = scene.target_velocities_m_per_s(at_s)[0] + into(scene.ego.axes(at_s), ego[None])[0]
    fastest = float(np.linalg.norm(np.vstack([on_ground, ego])[:, :2], axis=1).max())
    reach_m = np.linalg.norm(scene.positions_m(at_s)[0, :, :2], axis=1).max(initial=1.0)
    return ground.round_down(0.3 * reach_m / fastest) if fastest > 0 else 0.0
