"""What views from above share, x forward up the page and y to the left: rings, detections."""

import math

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.core.words import TIMES, number
from dechirp.report.figures.style import INK, MUTED, ORANGE

SIDE, FORWARD = "y, m (left positive)", "x, m (forward)"

_MOST_ELLIPSES = 200
# The ellipse of a usual detection is drawn so wide, to each side, of the width of the figure.
_SEEN = 0.03
_PALE_ORANGE = "#e8ab84"
_FAINT = "#dfe5ea"


@value
class Seen:
    """Detections of one frame with directions, strongest first, each (n,)."""

    range_m: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    """0 where the array does not tell it."""
    range_std_m: np.ndarray
    azimuth_std_rad: np.ndarray
    is_sure: np.ndarray
    """Whether the fold of the velocity is known, with which the direction goes."""
    field_of_view_rad: float
    """Azimuths that were searched, to each side."""

    @property
    def places_m(self) -> np.ndarray:
        """(n, 2): x and y on the ground."""
        level_m = self.range_m * np.cos(self.elevation_rad)
        return np.stack(
            [level_m * np.cos(self.azimuth_rad), level_m * np.sin(self.azimuth_rad)], axis=-1
        )

    def ellipses_m(self) -> np.ndarray:
        """(n, 2, 65): ellipses about the places, one standard error to each side."""
        forward, left = np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)
        level_m = self.range_m * np.cos(self.elevation_rad)
        turn = np.linspace(0, 2 * np.pi, 65)
        along = self.range_std_m[:, None] * np.cos(turn)
        across = (level_m * self.azimuth_std_rad)[:, None] * np.sin(turn)
        return np.stack(
            [
                forward[:, None] * along - left[:, None] * across,
                left[:, None] * along + forward[:, None] * across,
            ],
            axis=1,
        )


def rings(axes: Axes, reach_m: float) -> None:
    """Draw rings of range about the radar, and the radar."""
    axes.grid(False)
    step_m = round_down(reach_m / 3)
    angle = np.linspace(-np.pi, np.pi, 361)
    for radius_m in np.arange(step_m, reach_m, step_m):
        axes.plot(radius_m * np.sin(angle), radius_m * np.cos(angle), color=_FAINT, linewidth=0.8)
    axes.axvline(0, color=_FAINT, linewidth=0.8)
    axes.plot(0, 0, marker="^", markersize=9, color=INK, linestyle="", label="radar", zorder=4)


def detections(axes: Axes, seen: Seen) -> None:
    """Draw detections, ellipses of their errors, and what was searched, within the axes."""
    width_m, height_m = (abs(float(np.diff(of)[0])) for of in (axes.get_xlim(), axes.get_ylim()))
    _field_of_view(axes, seen.field_of_view_rad, width_m + height_m)
    for chosen, color, name in (
        (seen.is_sure, ORANGE, "detection"),
        (~seen.is_sure, _PALE_ORANGE, "fold not known"),
    ):
        if chosen.any():
            axes.plot(
                *seen.places_m[chosen].T[::-1],
                linestyle="",
                marker="o",
                markersize=7,
                markerfacecolor="none",
                markeredgecolor=color,
                markeredgewidth=1.1,
                label=name,
                zorder=3,
            )
    times = magnified(float(np.median(seen.range_m * seen.azimuth_std_rad)), width_m)
    ellipses_m = seen.places_m[:, :, None] + times * seen.ellipses_m()
    for at, ellipse_m in enumerate(ellipses_m[:_MOST_ELLIPSES]):
        axes.plot(
            *ellipse_m[::-1],
            color=ORANGE if seen.is_sure[at] else _PALE_ORANGE,
            linewidth=1.3,
            label=f"standard errors {TIMES} {number(times)}" if at == 0 else None,
            zorder=3,
        )


def round_down(amount: float) -> float:
    """1, 2 or 5 times a power of ten, at most the amount."""
    decade = 10.0 ** math.floor(math.log10(amount))
    return max(step for step in (1.0, 2.0, 5.0) if step * decade <= amount * (1 + 1e-9)) * decade


def magnified(usual_m: float, width_m: float) -> float:
    """A round factor at which a usual ellipse can be seen, 1 where it can as it is."""
    return round_down(_SEEN * width_m / usual_m) if 0 < usual_m < _SEEN * width_m else 1.0


def arrow(axes: Axes, start: np.ndarray, end: np.ndarray, color: str) -> None:
    """Draw an arrow from one place to another, x and y of each; none where they are one."""
    if np.allclose(start, end):
        return
    axes.annotate(
        "",
        xy=(end[1], end[0]),
        xytext=(start[1], start[0]),
        arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.4, "shrinkA": 0},
    )


def _field_of_view(axes: Axes, half_rad: float, reach_m: float) -> None:
    if half_rad > np.radians(89.9):
        return
    for side in (-1, 1):
        axes.plot(
            [0, side * reach_m * np.sin(half_rad)],
            [0, reach_m * np.cos(half_rad)],
            color=MUTED,
            linewidth=0.8,
            linestyle=(0, (4, 4)),
            label="field of view" if side > 0 else None,
        )
