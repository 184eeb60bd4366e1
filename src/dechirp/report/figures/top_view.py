"""Shared elements of top views, x upwards and y to the left: range rings and detections."""

import math

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.text import TIMES_SIGN, format_number
from dechirp.core.values import frozen_dataclass
from dechirp.report.figures.style import INK, MUTED, ORANGE

_MAX_ELLIPSES = 200
# Half width of a typical error ellipse as part of the figure width.
_VISIBLE_FRACTION = 0.03
_PALE_ORANGE = "#e8ab84"
_FAINT = "#dfe5ea"


@frozen_dataclass
class GroundDetections:
    """Detections of one frame with directions, strongest first, (n,) each."""

    range_m: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    """0 if the array does not measure elevation."""
    range_std_m: np.ndarray
    azimuth_std_rad: np.ndarray
    is_unambiguous: np.ndarray
    """Whether the velocity ambiguity, and therefore the direction, is resolved."""
    field_of_view_rad: float
    """Half width of the searched azimuth interval."""

    @property
    def positions_m(self) -> np.ndarray:
        """Positions on the ground, x and y, (n, 2)."""
        level_m = self.range_m * np.cos(self.elevation_rad)
        return np.stack(
            [level_m * np.cos(self.azimuth_rad), level_m * np.sin(self.azimuth_rad)], axis=-1
        )

    def error_ellipses_m(self) -> np.ndarray:
        """Return the error ellipses of one standard error about the origin, (n, 2, 65)."""
        cosine, sine = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        level_m = self.range_m * np.cos(self.elevation_rad)
        turn = np.linspace(0, 2 * np.pi, 65)
        radial = self.range_std_m[:, None] * np.cos(turn)
        lateral = (level_m * self.azimuth_std_rad)[:, None] * np.sin(turn)
        return np.stack(
            [
                cosine[:, None] * radial - sine[:, None] * lateral,
                sine[:, None] * radial + cosine[:, None] * lateral,
            ],
            axis=1,
        )


def draw_range_rings(axes: Axes, reach_m: float) -> None:
    """Draw the radar and rings of constant range."""
    axes.grid(False)
    step_m = round_down_to_1_2_5(reach_m / 3)
    angle = np.linspace(-np.pi, np.pi, 361)
    for radius_m in np.arange(step_m, reach_m, step_m):
        axes.plot(radius_m * np.sin(angle), radius_m * np.cos(angle), color=_FAINT, linewidth=0.8)
    axes.axvline(0, color=_FAINT, linewidth=0.8)
    axes.plot(0, 0, marker="^", markersize=9, color=INK, linestyle="", label="radar", zorder=4)


def draw_ground_detections(axes: Axes, detections: GroundDetections) -> None:
    """Draw detections with error ellipses, and the field of view, within the axes."""
    width_m, height_m = (
        abs(float(np.diff(limits)[0])) for limits in (axes.get_xlim(), axes.get_ylim())
    )
    _draw_field_of_view(axes, detections.field_of_view_rad, width_m + height_m)
    for is_chosen, color, name in (
        (detections.is_unambiguous, ORANGE, "detection"),
        (~detections.is_unambiguous, _PALE_ORANGE, "detection, velocity ambiguous"),
    ):
        if is_chosen.any():
            axes.plot(
                *detections.positions_m[is_chosen].T[::-1],
                linestyle="",
                marker="o",
                markersize=7,
                markerfacecolor="none",
                markeredgecolor=color,
                markeredgewidth=1.1,
                label=name,
                zorder=3,
            )
    magnification = ellipse_magnification(
        float(np.median(detections.range_m * detections.azimuth_std_rad)), width_m
    )
    ellipses_m = detections.positions_m[:, :, None] + magnification * detections.error_ellipses_m()
    for index, ellipse_m in enumerate(ellipses_m[:_MAX_ELLIPSES]):
        axes.plot(
            *ellipse_m[::-1],
            color=ORANGE if detections.is_unambiguous[index] else _PALE_ORANGE,
            linewidth=1.3,
            label=f"standard errors {TIMES_SIGN} {format_number(magnification)}"
            if index == 0
            else None,
            zorder=3,
        )


def round_down_to_1_2_5(amount: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten."""
    decade = 10.0 ** math.floor(math.log10(amount))
    return max(step for step in (1.0, 2.0, 5.0) if step * decade <= amount * (1 + 1e-9)) * decade


def ellipse_magnification(typical_ellipse_m: float, view_width_m: float) -> float:
    """Return a round factor that makes a typical ellipse visible; 1 if it is visible."""
    return (
        round_down_to_1_2_5(_VISIBLE_FRACTION * view_width_m / typical_ellipse_m)
        if 0 < typical_ellipse_m < _VISIBLE_FRACTION * view_width_m
        else 1.0
    )


def draw_arrow(axes: Axes, start: np.ndarray, end: np.ndarray, color: str) -> None:
    """Draw an arrow between two points (x, y); nothing if they coincide."""
    if np.allclose(start, end):
        return
    axes.annotate(
        "",
        xy=(end[1], end[0]),
        xytext=(start[1], start[0]),
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 0},
    )


def _draw_field_of_view(axes: Axes, half_angle_rad: float, reach_m: float) -> None:
    if half_angle_rad > np.radians(89.9):
        return
    for side in (-1, 1):
        axes.plot(
            [0, side * reach_m * np.sin(half_angle_rad)],
            [0, reach_m * np.cos(half_angle_rad)],
            color=MUTED,
            linewidth=0.8,
            linestyle=(0, (4, 4)),
            label="field of view" if side > 0 else None,
        )
