"""Top view of tracks over all frames: x upwards, y to the left."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.text import TIMES_SIGN, format_number
from dechirp.core.values import frozen_dataclass
from dechirp.report.figures import top_view
from dechirp.report.figures.common import add_legend
from dechirp.report.figures.style import GREEN, INK, ORANGE, PALE, WIDTH_IN
from dechirp.report.labels import X_LABEL, Y_LABEL

_MAX_DETECTIONS, _MAX_PATHS = 2000, 200
_FEW = 8
_NUMBER_PT = 9.0
_PALE_BLUE = "#a3c8e2"
# Heights without margins: minimum, maximum for few tracks, maximum for many.
_LOW_IN, _HIGH_IN, _HIGHEST_IN = 3.0, 4.6, 7.4
_AROUND_IN = 0.75  # margin of labels and legend
_ARROW = 0.3  # length of the longest arrow as part of the view
_HEAD = 0.03  # part of the width; shorter arrows have no head


@frozen_dataclass
class TrackLine:
    """Track to draw."""

    number: int
    positions_m: np.ndarray
    """x and y in the frames of the track, (n_frames, 2)."""
    is_confirmed: np.ndarray
    """Mask of the confirmed frames, (n_frames,)."""
    velocity_m_per_s: np.ndarray
    """Velocity in the last confirmed frame, (2,)."""
    covariance_m2: np.ndarray
    """Covariance of x and y in the last confirmed frame, (2, 2)."""

    @property
    def last_confirmed_position_m(self) -> np.ndarray:
        """Position in the last confirmed frame, (2,)."""
        return np.asarray(self.positions_m[np.flatnonzero(self.is_confirmed)[-1]])

    def error_ellipse_m(self) -> np.ndarray:
        """Return the ellipse of one standard error about the origin, (2, 65)."""
        turn = np.linspace(0, 2 * np.pi, 65)
        variances, axes = np.linalg.eigh(self.covariance_m2)
        spread = np.sqrt(np.maximum(variances, 0))[:, None]
        return np.asarray(axes @ (spread * [np.cos(turn), np.sin(turn)]))


@frozen_dataclass
class TrackBackground:
    """Detections and true paths behind the tracks, x and y in coordinates of the radar."""

    detections_m: np.ndarray
    """Detections of all frames, strongest first, (n, 2)."""
    is_static: np.ndarray
    """Mask of the static detections, (n,)."""
    paths_m: np.ndarray
    """True paths, (n_targets, n_frames, 2); empty without the truth."""


def draw_tracks(axes: Axes, lines: Sequence[TrackLine], background: TrackBackground) -> Axes:
    """Draw tracks over detections and the true paths of the targets.

    Parameters
    ----------
    axes : Axes
        Axes to draw on, set to equal scales.
    lines : sequence of TrackLine
        At least one track.
    background : TrackBackground
        Detections and true paths.

    Returns
    -------
    Axes
        The given axes.
    """
    arrow_s = _arrow_duration_s(lines)
    front, back, side = _view_front_back_and_side_m(lines, arrow_s)
    # Widened to the aspect ratio of the axes.
    side = max(side, (front - back) * axes.bbox.width / axes.bbox.height / 2)
    axes.set_aspect("equal")
    axes.set(xlim=(side, -side), ylim=(back, front))
    top_view.draw_range_rings(axes, math.hypot(max(front, -back), side))
    _draw_detections_and_true_paths(axes, background)
    magnification = top_view.ellipse_magnification(
        float(np.median([abs(line.error_ellipse_m()).max() for line in lines])), 2 * side
    )
    for index, line in enumerate(lines):
        _draw_track(axes, line, arrow_s=arrow_s, magnification=magnification, is_first=index == 0)
    axes.set_xlabel(Y_LABEL)
    axes.set_ylabel(X_LABEL)
    add_legend(axes, markerscale=1.2)
    axes.set_label("Tracks from above")
    return axes


def figure_height_in(lines: Sequence[TrackLine]) -> float:
    """Return the figure height (in) for the extent of the tracks."""
    front, back, side = _view_front_back_and_side_m(lines, _arrow_duration_s(lines))
    highest_in = _HIGH_IN if len(lines) <= _FEW else _HIGHEST_IN
    inside_in = (WIDTH_IN - _AROUND_IN) * (front - back) / (2 * side)
    return min(max(inside_in, _LOW_IN), highest_in) + _AROUND_IN


def _view_front_back_and_side_m(
    lines: Sequence[TrackLine], arrow_s: float
) -> tuple[float, float, float]:
    """Return the limits of the view: front, back, and to each side."""
    shown_m = np.vstack(
        [
            *(line.positions_m for line in lines),
            *(line.last_confirmed_position_m + arrow_s * line.velocity_m_per_s for line in lines),
            [[0, 0]],
        ]
    )
    reach_m = max(1.0, float(np.hypot(*shown_m.T).max()))
    front, back = shown_m[:, 0].max() + 0.08 * reach_m, shown_m[:, 0].min() - 0.06 * reach_m
    return front, back, 1.15 * max(float(abs(shown_m[:, 1]).max()), 0.05 * reach_m)


def _draw_detections_and_true_paths(axes: Axes, background: TrackBackground) -> None:
    for is_chosen, color, name in (
        (background.is_static, PALE, "static detection"),
        (~background.is_static, ORANGE, "detection"),
    ):
        axes.plot(
            *background.detections_m[is_chosen][:_MAX_DETECTIONS].T[::-1],
            linestyle="",
            marker="o",
            markersize=2.2,
            markeredgewidth=0,
            color=color,
            alpha=0.45 if color == ORANGE else 1.0,
            label=name if is_chosen.any() else None,
            zorder=2,
        )
    for index, path_m in enumerate(background.paths_m[:_MAX_PATHS]):
        label = "truth" if index == 0 else None
        # Pale and wider than a track, so that it remains visible below one.
        axes.plot(*path_m.T[::-1], color=_PALE_BLUE, linewidth=2.6, label=label, zorder=2.5)


def _draw_track(
    axes: Axes, line: TrackLine, *, arrow_s: float, magnification: float, is_first: bool
) -> None:
    def label(name: str) -> str | None:
        return name if is_first else None

    axes.plot(*line.positions_m.T[::-1], color=INK, linewidth=0.5, zorder=3)
    confirmed_m = np.where(line.is_confirmed[:, None], line.positions_m, np.nan)
    axes.plot(*confirmed_m.T[::-1], color=INK, linewidth=1.3, label=label("track"), zorder=3)
    x, y = line.last_confirmed_position_m.tolist()
    axes.plot(y, x, marker="o", markersize=3.2, color=INK, zorder=4)
    ellipse_m = line.last_confirmed_position_m[:, None] + magnification * line.error_ellipse_m()
    axes.plot(
        *ellipse_m[::-1],
        color=INK,
        linewidth=0.7,
        label=label(
            "standard errors"
            + (f" {TIMES_SIGN} {format_number(magnification)}" if magnification != 1 else "")
        ),
        zorder=3,
    )
    tip = line.last_confirmed_position_m + arrow_s * line.velocity_m_per_s
    axes.plot(
        *np.array([line.last_confirmed_position_m, tip]).T[::-1],
        color=GREEN,
        linewidth=1.1,
        label=label(f"motion in {format_number(arrow_s)} s") if arrow_s else None,
        zorder=3.5,
    )
    width_m = abs(float(np.diff(axes.get_xlim())[0]))
    if np.hypot(*(tip - line.last_confirmed_position_m)) > _HEAD * width_m:
        top_view.draw_arrow(axes, line.last_confirmed_position_m, tip, GREEN)
    axes.annotate(
        str(line.number),
        (y, x),
        _track_number_offset_in_points(line),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=8,
        fontweight="bold",
        clip_on=True,
        zorder=5,
    )


def _track_number_offset_in_points(line: TrackLine) -> tuple[float, float]:
    """Return the offset of the track number in points: beside the path, away from x."""
    speed = float(np.hypot(*line.velocity_m_per_s))
    outward = np.array([-1.0 if line.last_confirmed_position_m[1] > 0 else 1.0, 0.0])
    if speed > 0:
        # Up is x and right is -y, so the components of the velocity are those of its normal.
        across = line.velocity_m_per_s / speed
        outward = across if across @ outward >= 0 else -across
    right, up = _NUMBER_PT * outward
    return float(right), float(up)


def _arrow_duration_s(lines: Sequence[TrackLine]) -> float:
    """Choose a round duration of velocity arrows; 0 if no track moves."""
    fastest = max(float(np.hypot(*line.velocity_m_per_s)) for line in lines)
    reach_m = max(float(np.hypot(*line.positions_m.T).max()) for line in lines)
    return (
        top_view.round_down_to_1_2_5(_ARROW * reach_m / fastest) if fastest * reach_m > 0 else 0.0
    )
