"""Top view of the scene: x upwards, y to the left."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes

from dechirp.core.text import format_number
from dechirp.core.values import frozen_dataclass
from dechirp.report.figures import top_view
from dechirp.report.figures.common import add_legend, choose_body_scatterer_indices
from dechirp.report.figures.style import BLUE, INK, ORANGE, TALL_IN
from dechirp.report.labels import X_LABEL, Y_LABEL
from dechirp.scene.rotations import to_local_axes
from dechirp.scene.scene import Scene

_MAX_ARCS, _FEW_ARCS = 20, 6
_FEW_NAMES, _MAX_NAMES = 8, 24
_HIGH_IN = 4.6
_MAX_ARROWS = 200
_MAX_POINTS = 600
# Narrow scenes such as roads, with a width below this part of the length, are stretched.
_NARROW = 0.3
_OUTSIDE = 0.45  # part of the width within which names are placed outwards


@frozen_dataclass
class _SceneGeometry:
    """Positions to draw, x and y in coordinates of the radar."""

    target_positions_m: np.ndarray
    scatterers_m: np.ndarray
    """Positions of the scatterers of bodies."""
    arrows_m: np.ndarray
    """Motion of each target over ground during the arrow duration."""
    headings: np.ndarray
    """Unit vector of the x axis of each target."""
    waypoint_paths_m: list[np.ndarray]
    """Paths through waypoints."""
    waypoints_m: np.ndarray
    """Positions of the waypoints."""
    ego_m: np.ndarray
    """Path of the radar during the arrow duration."""


def draw_scene(
    axes: Axes,
    scene: Scene,
    *,
    time_s: float = 0.0,
    detected_m: Sequence[float] = (),
    detections: top_view.GroundDetections | None = None,
) -> Axes:
    """Draw targets with their velocities over ground, the radar, and detections from above.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    scene : Scene
        Scene at `time_s`, in radar coordinates; the scatterers of large bodies are thinned.
    time_s : float
        Time of the first estimates: the middle of the first frame.
    detected_m : sequence, m
        Ranges of the detections without directions, strongest first: arcs.
    detections : GroundDetections, optional
        Detections with directions, drawn with error ellipses.

    Returns
    -------
    Axes
        The given axes.
    """
    arrow_s = _arrow_duration_s(scene, time_s)
    geometry = _scene_geometry_from_above(scene, time_s, arrow_s)
    reach_m = _largest_target_distance_m(geometry)
    ends_m = np.vstack(
        [
            geometry.target_positions_m,
            geometry.scatterers_m,
            geometry.target_positions_m + geometry.arrows_m,
            geometry.ego_m,
            [[0, 0]],
        ]
    )
    front = ends_m[:, 0].max() + 0.12 * reach_m
    back = min(ends_m[:, 0].min() - 0.08 * reach_m, -0.1 * reach_m)
    aside_m = 1.25 * abs(ends_m[:, 1]).max()
    is_narrow = aside_m < _NARROW * (front - back)
    # At least as wide as the figure, 1.4 times its height without the labels.
    side = max(aside_m, (0.1 if is_narrow else 0.7) * (front - back))
    axes.set_aspect("auto" if is_narrow else "equal")
    axes.set(xlim=(side, -side), ylim=(back, front))
    top_view.draw_range_rings(axes, math.hypot(max(front, -back), side))
    _draw_range_arcs(axes, detected_m)
    _draw_waypoint_and_radar_paths(axes, geometry)
    _draw_targets_with_motion(axes, geometry, 0.05 * reach_m, arrow_s)
    if detections is not None:
        top_view.draw_ground_detections(axes, detections)
    small = 1.0 if len(scene.names) <= _FEW_NAMES else 0.8
    for name, place in list(zip(scene.names, geometry.target_positions_m, strict=True))[
        :_MAX_NAMES
    ]:
        # Names are placed outwards unless the figure ends nearby.
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
    axes.set_xlabel(Y_LABEL.replace(")", ", stretched)") if is_narrow else Y_LABEL)
    axes.set_ylabel(X_LABEL)
    add_legend(axes)
    axes.set_label("The scene from above")
    return axes


def figure_height_in(scene: Scene) -> float:
    """Return a figure height (in) that has room for the names."""
    return _HIGH_IN if len(scene.targets) > _FEW_NAMES else TALL_IN


def _scene_geometry_from_above(scene: Scene, time_s: float, arrow_s: float) -> _SceneGeometry:
    at_s = np.array([time_s])
    here_m = np.array(scene.ego.position_m) + scene.ego.displacements_m(at_s)
    axes = scene.ego.axes(at_s)

    def to_radar_xy(places_m: np.ndarray) -> np.ndarray:
        """From coordinates of the scene, (n, 3), to x and y of the radar's, (n, 2)."""
        return to_local_axes(axes, (places_m - here_m)[None])[0, :, :2]

    on_ground = to_local_axes(axes, scene.ego.velocities_m_per_s(at_s)[:, None])
    arrows_m = arrow_s * (scene.target_velocities_m_per_s(at_s) + on_ground)[0, :, :2]
    courses_m, stops_m = [], [np.empty((0, 2))]
    for target_index in np.flatnonzero([bool(target.waypoints) for target in scene.targets]):
        target = scene.targets[target_index]
        arrows_m[target_index] = 0  # the path is drawn instead
        times_s = np.linspace(0, target.waypoints[-1].time_s, 200)
        courses_m.append(to_radar_xy(np.array(target.position_m) + target.displacements_m(times_s)))
        stops_m.append(to_radar_xy(np.array([point.position_m for point in target.waypoints])))
    facing = [target.headings_at_rad(at_s)[0] for target in scene.targets]
    facing_to = np.stack([np.cos(facing), np.sin(facing), np.zeros(len(facing))], axis=-1)
    times_s = time_s + np.linspace(0, arrow_s, 50)
    return _SceneGeometry(
        target_positions_m=scene.target_positions_m(at_s)[0, :, :2],
        scatterers_m=scene.scatterer_positions_m(at_s)[
            0, choose_body_scatterer_indices(scene, _MAX_POINTS), :2
        ],
        arrows_m=arrows_m,
        headings=to_local_axes(axes, facing_to[None])[0, :, :2],
        waypoint_paths_m=courses_m,
        waypoints_m=np.vstack(stops_m),
        ego_m=to_radar_xy(np.array(scene.ego.position_m) + scene.ego.displacements_m(times_s)),
    )


def _largest_target_distance_m(geometry: _SceneGeometry) -> float:
    points_m = np.vstack([geometry.target_positions_m, geometry.scatterers_m])
    return max(1.0, float(np.hypot(*points_m.T).max(initial=0.0)))


def _draw_range_arcs(axes: Axes, detected_m: Sequence[float]) -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
    for range_m in detected_m[:_MAX_ARCS]:
        axes.plot(
            range_m * np.sin(angle),
            range_m * np.cos(angle),
            color=ORANGE,
            linewidth=1.3 if len(detected_m) <= _FEW_ARCS else 0.6,
            linestyle=(0, (5, 3)),
            label="range of a detection",
        )


def _draw_waypoint_and_radar_paths(axes: Axes, geometry: _SceneGeometry) -> None:
    """Draw the paths through waypoints, and the path of the radar."""
    for course_m in geometry.waypoint_paths_m:
        axes.plot(*course_m.T[::-1], color=BLUE, linewidth=0.8, label="path through waypoints")
    axes.plot(*geometry.waypoints_m.T[::-1], linestyle="", marker="|", markersize=5, color=BLUE)
    axes.plot(*geometry.ego_m.T[::-1], color=INK, linewidth=1.4)
    top_view.draw_arrow(axes, geometry.ego_m[-2], geometry.ego_m[-1], INK)


def _draw_targets_with_motion(
    axes: Axes, geometry: _SceneGeometry, heading_line_m: float, arrow_s: float
) -> None:
    ends_m = geometry.target_positions_m + heading_line_m * geometry.headings
    for place, end in list(zip(geometry.target_positions_m, ends_m, strict=True))[:_MAX_ARROWS]:
        axes.plot(*np.array([place, end]).T[::-1], color=BLUE, linewidth=2.2, alpha=0.5)
    tips_m = geometry.target_positions_m + geometry.arrows_m
    for place, tip in list(zip(geometry.target_positions_m, tips_m, strict=True))[:_MAX_ARROWS]:
        top_view.draw_arrow(axes, place, tip, BLUE)
    if len(geometry.scatterers_m):
        axes.plot(
            *geometry.scatterers_m.T[::-1],
            linestyle="",
            marker=".",
            markersize=2,
            color=INK,
            label="scatterers of bodies",
        )
    axes.plot(
        *geometry.target_positions_m.T[::-1],
        linestyle="",
        marker="o",
        markersize=6 if len(geometry.target_positions_m) <= 8 else 3.5,
        color=BLUE,
        label=f"target, motion in {format_number(arrow_s)} s" if arrow_s else "target",
    )


def _arrow_duration_s(scene: Scene, time_s: float) -> float:
    """Choose a round duration in which the fastest object moves about a third of the view."""
    at_s = np.array([time_s])
    ego = scene.ego.velocities_m_per_s(at_s)
    on_ground = (
        scene.target_velocities_m_per_s(at_s)[0] + to_local_axes(scene.ego.axes(at_s), ego[None])[0]
    )
    fastest = float(np.linalg.norm(np.vstack([on_ground, ego])[:, :2], axis=1).max())
    reach_m = np.linalg.norm(scene.scatterer_positions_m(at_s)[0, :, :2], axis=1).max(initial=1.0)
    return top_view.round_down_to_1_2_5(0.3 * reach_m / fastest) if fastest > 0 else 0.0
