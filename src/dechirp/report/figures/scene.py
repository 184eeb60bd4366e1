"""The scene from above: x forward up the page, y to the left."""

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dechirp.report.figures.style import BLUE, INK, ORANGE, draw
from dechirp.report.words import number
from dechirp.scene.scene import Scene

_MOST_ARCS = 20
_MOST_NAMES = 12


def from_above(scene: Scene, *, time_s: float, detected_m: Sequence[float] = ()) -> Markup:
    """Draw targets with their velocities, the radar, and detections as arcs of equal range.

    Parameters
    ----------
    scene : Scene
        Drawn as it is at `time_s`, in coordinates of the radar.
    time_s : float
        Of the first estimates: the middle of the first frame.
    detected_m : sequence, m
        Ranges of the detections, strongest first; angles are not estimated.
    """
    places_m = scene.positions_m(time_s)[:, :2]
    velocities = np.array([target.velocity_m_per_s for target in scene.targets]).reshape(-1, 3)
    ego = np.array(scene.ego.velocity_m_per_s)
    reach_m = max(1.0, float(np.hypot(*places_m.T).max(initial=0.0)))
    arrow_s = _arrow_s(np.vstack([velocities, ego[None]]), reach_m)
    tips_m = places_m + arrow_s * velocities[:, :2]
    ends_m = np.vstack([places_m, tips_m, [[0.0, 0.0]], arrow_s * ego[None, :2]])
    front = ends_m[:, 0].max() + 0.12 * reach_m
    back = min(ends_m[:, 0].min() - 0.08 * reach_m, -0.1 * reach_m)
    # At least as wide as the figure: 1.4 times its height once the labels have their room.
    side = max(1.25 * abs(ends_m[:, 1]).max(), 0.7 * (front - back))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.grid(False)
        axes.set_aspect("equal")
        axes.set(xlim=(side, -side), ylim=(back, front))
        _rings(axes, math.hypot(max(front, -back), side))
        angle = np.linspace(-np.pi / 2, np.pi / 2, 181)
        for range_m in detected_m[:_MOST_ARCS]:
            axes.plot(
                range_m * np.sin(angle),
                range_m * np.cos(angle),
                color=ORANGE,
                linewidth=1.3,
                linestyle=(0, (5, 3)),
                label="range of a detection",
            )
        for place, tip in zip(places_m, tips_m, strict=True):
            _arrow(axes, place, tip, BLUE)
        _arrow(axes, np.zeros(2), arrow_s * ego[:2], INK)
        axes.plot(
            places_m[:, 1],
            places_m[:, 0],
            linestyle="",
            marker="o",
            markersize=6,
            color=BLUE,
            label=f"target, its way in {number(arrow_s)} s" if arrow_s else "target",
        )
        axes.plot(0, 0, marker="^", markersize=9, color=INK, linestyle="", label="radar")
        for name, place in list(zip(scene.names, places_m, strict=True))[:_MOST_NAMES]:
            axes.annotate(
                name, (place[1], place[0]), (7, 5), textcoords="offset points", clip_on=True
            )
        axes.set_xlabel("y, m (left positive)")
        axes.set_ylabel("x, m (forward)")
        handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        figure.legend(
            handles.values(), handles.keys(), loc="outside upper right", ncols=3, handlelength=1.6
        )

    return draw(paint, label="The scene from above", height_in=3.6)


def _arrow_s(velocities: np.ndarray, reach_m: float) -> float:
    """Choose a round time in which the fastest goes about a quarter of the way shown."""
    fastest = float(np.hypot(velocities[:, 0], velocities[:, 1]).max())
    return _round_down(0.3 * reach_m / fastest) if fastest > 0 else 0.0


def _round_down(amount: float) -> float:
    decade = 10.0 ** math.floor(math.log10(amount))
    return max(step for step in (1.0, 2.0, 5.0) if step * decade <= amount * (1 + 1e-9)) * decade


def _rings(axes: Axes, reach_m: float) -> None:
    step_m = _round_down(reach_m / 3)
    angle = np.linspace(-np.pi, np.pi, 361)
    for radius_m in np.arange(step_m, reach_m, step_m):
        axes.plot(
            radius_m * np.sin(angle), radius_m * np.cos(angle), color="#dfe5ea", linewidth=0.8
        )
    axes.axvline(0, color="#dfe5ea", linewidth=0.8)


def _arrow(axes: Axes, start: np.ndarray, end: np.ndarray, color: str) -> None:
    if np.allclose(start, end):
        return
    axes.annotate(
        "",
        xy=(end[1], end[0]),
        xytext=(start[1], start[0]),
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 0},
    )
