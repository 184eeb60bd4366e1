"""Tracks from above, over all frames: x forward up the page, y to the left."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.core.words import TIMES, number
from dechirp.report.figures import ground
from dechirp.report.figures.parts import legend
from dechirp.report.figures.style import GREEN, INK, ORANGE, PALE, WIDTH_IN

_MOST_DETECTIONS, _MOST_PATHS = 2000, 200
_FEW = 8
_NUMBER_PT = 9.0
_PALE_BLUE = "#a3c8e2"
_LOW_IN, _HIGH_IN, _HIGHEST_IN = 3.0, 4.6, 7.4  # without what is around; of few, of many
_AROUND_IN = 0.75  # what labels and the legend take of the width and of the height
_ARROW = 0.3  # the fastest goes so far, of what is shown
_HEAD = 0.03  # of the width: the head of an arrow would be longer than a shorter one


@value
class Line:
    """A track, as it is drawn."""

    number: int
    way_m: np.ndarray
    """(n_frames, 2): x and y in the frames in which it is."""
    is_confirmed: np.ndarray
    """(n_frames,)"""
    velocity_m_per_s: np.ndarray
    """(2,): in the last frame in which it is confirmed."""
    covariance_m2: np.ndarray
    """(2, 2): of x and y, then."""

    @property
    def end_m(self) -> np.ndarray:
        """Where it is in the last frame in which it is confirmed, (2,)."""
        return np.asarray(self.way_m[np.flatnonzero(self.is_confirmed)[-1]])

    def ellipse_m(self) -> np.ndarray:
        """(2, 65): about the end, one standard error along either axis."""
        turn = np.linspace(0, 2 * np.pi, 65)
        variances, axes = np.linalg.eigh(self.covariance_m2)
        spread = np.sqrt(np.maximum(variances, 0))[:, None]
        return np.asarray(axes @ (spread * [np.cos(turn), np.sin(turn)]))


@value
class Ground:
    """What tracks are drawn on, x and y in coordinates of the radar in each frame."""

    found_m: np.ndarray
    """(n, 2): detections of all frames, strongest first."""
    is_static: np.ndarray
    """(n,): whether each is known to stand still."""
    paths_m: np.ndarray
    """(n_targets, n_frames, 2): the truth; no targets where it is not known."""


def from_above(axes: Axes, lines: Sequence[Line], on: Ground) -> Axes:
    """Draw tracks over detections and the ways of the targets.

    Parameters
    ----------
    axes : Axes
        To draw on; a meter is equally long along both.
    lines : sequence of Line
        The tracks, one at least.
    on : Ground
        What is around them.

    Returns
    -------
    Axes
        Those given.
    """
    while_s = _while_s(lines)
    front, back, side = _ends_m(lines, while_s)
    # Wider where the axes would else be empty to both sides.
    side = max(side, (front - back) * axes.bbox.width / axes.bbox.height / 2)
    axes.set_aspect("equal")
    axes.set(xlim=(side, -side), ylim=(back, front))
    ground.rings(axes, math.hypot(max(front, -back), side))
    _ground(axes, on)
    times = ground.magnified(
        float(np.median([abs(line.ellipse_m()).max() for line in lines])), 2 * side
    )
    for at, line in enumerate(lines):
        _track(axes, line, while_s=while_s, times=times, is_first=at == 0)
    axes.set_xlabel(ground.SIDE)
    axes.set_ylabel(ground.FORWARD)
    legend(axes, markerscale=1.2)
    axes.set_label("Tracks from above")
    return axes


def height_in(lines: Sequence[Line]) -> float:
    """Height of a figure of the page that tracks fill: more than usual where they go far ahead."""
    front, back, side = _ends_m(lines, _while_s(lines))
    highest_in = _HIGH_IN if len(lines) <= _FEW else _HIGHEST_IN
    inside_in = (WIDTH_IN - _AROUND_IN) * (front - back) / (2 * side)
    return min(max(inside_in, _LOW_IN), highest_in) + _AROUND_IN


def _ends_m(lines: Sequence[Line], while_s: float) -> tuple[float, float, float]:
    """What is to be seen: how far to the front, to the back, and to each side."""
    shown_m = np.vstack(
        [
            *(line.way_m for line in lines),
            *(line.end_m + while_s * line.velocity_m_per_s for line in lines),
            [[0, 0]],
        ]
    )
    reach_m = max(1.0, float(np.hypot(*shown_m.T).max()))
    front, back = shown_m[:, 0].max() + 0.08 * reach_m, shown_m[:, 0].min() - 0.06 * reach_m
    return front, back, 1.15 * max(abs(shown_m[:, 1]).max(), 0.05 * reach_m)


def _ground(axes: Axes, on: Ground) -> None:
    for chosen, color, name in (
        (on.is_static, PALE, "detection that stands still"),
        (~on.is_static, ORANGE, "detection"),
    ):
        axes.plot(
            *on.found_m[chosen][:_MOST_DETECTIONS].T[::-1],
            linestyle="",
            marker="o",
            markersize=2.2,
            markeredgewidth=0,
            color=color,
            alpha=0.45 if color == ORANGE else 1.0,
            label=name if chosen.any() else None,
            zorder=2,
        )
    for at, path_m in enumerate(on.paths_m[:_MOST_PATHS]):
        label = "truth" if at == 0 else None
        # Wider than a track and pale, so that it shows on both sides of one that lies on it.
        axes.plot(*path_m.T[::-1], color=_PALE_BLUE, linewidth=2.6, label=label, zorder=2.5)


def _track(axes: Axes, line: Line, *, while_s: float, times: float, is_first: bool) -> None:
    def label(name: str) -> str | None:
        return name if is_first else None

    axes.plot(*line.way_m.T[::-1], color=INK, linewidth=0.5, zorder=3)
    confirmed_m = np.where(line.is_confirmed[:, None], line.way_m, np.nan)
    axes.plot(*confirmed_m.T[::-1], color=INK, linewidth=1.3, label=label("track"), zorder=3)
    x, y = line.end_m.tolist()
    axes.plot(y, x, marker="o", markersize=3.2, color=INK, zorder=4)
    around = line.end_m[:, None] + times * line.ellipse_m()
    axes.plot(
        *around[::-1],
        color=INK,
        linewidth=0.7,
        label=label("standard errors" + (f" {TIMES} {number(times)}" if times != 1 else "")),
        zorder=3,
    )
    tip = line.end_m + while_s * line.velocity_m_per_s
    axes.plot(
        *np.array([line.end_m, tip]).T[::-1],
        color=GREEN,
        linewidth=1.1,
        label=label(f"its way in {number(while_s)} s") if while_s else None,
        zorder=3.5,
    )
    width_m = abs(float(np.diff(axes.get_xlim())[0]))
    if np.hypot(*(tip - line.end_m)) > _HEAD * width_m:
        ground.arrow(axes, line.end_m, tip, GREEN)
    axes.annotate(
        str(line.number),
        (y, x),
        _beside(line),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8,
        fontweight="bold",
        clip_on=True,
        zorder=5,
    )


def _beside(line: Line) -> tuple[float, float]:
    """Where its number stands, in points to the right and up: beside its way, away from x."""
    speed = float(np.hypot(*line.velocity_m_per_s))
    outward = np.array([-1.0 if line.end_m[1] > 0 else 1.0, 0.0])
    if speed > 0:
        # Up is x and right is minus y, so a quarter turn of the velocity is itself.
        across = line.velocity_m_per_s / speed
        outward = across if across @ outward >= 0 else -across
    right, up = _NUMBER_PT * outward
    return float(right), float(up)


def _while_s(lines: Sequence[Line]) -> float:
    """A round time in which the fastest goes a part of what is shown; 0 where none moves."""
    fastest = max(float(np.hypot(*line.velocity_m_per_s)) for line in lines)
    reach_m = max(float(np.hypot(*line.way_m.T).max()) for line in lines)
    return ground.round_down(_ARROW * reach_m / fastest) if fastest * reach_m > 0 else 0.0
