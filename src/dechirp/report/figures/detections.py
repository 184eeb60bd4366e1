"""What two rules call targets in a noisy frame, and why."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from dechirp.core.values import value
from dechirp.report.figures.style import BLUE, MUTED, ORANGE, draw
from dechirp.scene.folding import Place


@value
class Decided:
    """Cells that a rule calls targets, and where they lie."""

    title: str
    over: np.ndarray
    """(velocity, range)."""
    range_m: np.ndarray
    velocity_m_per_s: np.ndarray


def maps(
    decided: Sequence[Sequence[Decided]], *, target: Place, reach: tuple[float, float]
) -> Markup:
    """Draw the cells over threshold about the target, a row a frame, a column a rule.

    `reach` is how far from the target to look, in m and m/s.
    """
    at_m, at_m_per_s = float(target.range_m), float(target.velocity_m_per_s)

    def paint(figure: Figure) -> None:
        panels = figure.subplots(
            len(decided), len(decided[0]), sharex=True, sharey=True, squeeze=False
        )
        for axes, one in zip(panels.flat, (one for row in decided for one in row), strict=True):
            axes.grid(False)
            axes.imshow(
                np.where(one.over, 1.0, np.nan),
                cmap=ListedColormap([BLUE]),
                extent=(*_edges(one.range_m), *_edges(one.velocity_m_per_s)),
                origin="lower",
                aspect="auto",
                interpolation="none",
            )
            axes.plot(
                at_m,
                at_m_per_s,
                marker="o",
                markersize=26,
                markerfacecolor="none",
                markeredgecolor=ORANGE,
                markeredgewidth=0.9,
                linestyle="",
            )
            axes.set(
                xlim=(max(at_m - reach[0], 0.0), at_m + reach[0]),
                ylim=(at_m_per_s - reach[1], at_m_per_s + reach[1]),
            )
            axes.set_title(one.title, fontsize=8.5, loc="left")
        for axes in panels[-1]:
            axes.set_xlabel("range, m")
        figure.supylabel("velocity, m/s (receding positive)", fontsize=8.5, color=MUTED)

    return draw(paint, label="Cells over threshold, by rule", height_in=1.9 * len(decided) + 0.4)


@value
class Line:
    """Power of one rule's map along range through the target, and its threshold, dB."""

    title: str
    range_m: np.ndarray
    power_db: np.ndarray
    threshold_db: np.ndarray


def thresholds(lines: Sequence[Line], *, around_m: float, reach_m: float) -> Markup:
    """Draw power and threshold along range of each rule, side by side, over the mean noise."""

    def paint(figure: Figure) -> None:
        beside = figure.subplots(1, len(lines), sharex=True, sharey=True, squeeze=False)[0]
        for axes, line in zip(beside, lines, strict=True):
            _cut(axes, line, around_m - reach_m, around_m + reach_m)
        beside[0].set_ylabel("power over the mean noise, dB")
        figure.legend(
            *beside[0].get_legend_handles_labels(),
            loc="outside upper right",
            ncols=2,
            handlelength=1.4,
        )

    return draw(paint, label="Power and threshold along range, by rule", height_in=2.7)


def _cut(axes: Axes, line: Line, left_m: float, right_m: float) -> None:
    shown = (line.range_m >= left_m) & (line.range_m <= right_m)
    axes.plot(
        line.range_m[shown],
        np.maximum(line.power_db[shown], -15.0),
        color=BLUE,
        linewidth=1.0,
        label="power",
    )
    axes.plot(
        line.range_m[shown],
        line.threshold_db[shown],
        color=ORANGE,
        linewidth=1.3,
        label="threshold",
    )
    axes.set(xlim=(left_m, right_m))
    axes.set_title(line.title, fontsize=8.5, loc="left")
    axes.set_xlabel("range, m")


def _edges(centres: np.ndarray) -> tuple[float, float]:
    half = (centres[1] - centres[0]) / 2
    return float(centres[0] - half), float(centres[-1] + half)
