"""What two rules call targets in a noisy frame, and why."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import FigureBase

from dechirp.core.values import value
from dechirp.report.figures.parts import MAP_AXES, circles, edges, panels
from dechirp.report.figures.style import BLUE, ORANGE
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
    figure: FigureBase,
    decided: Sequence[Sequence[Decided]],
    *,
    target: Place,
    reach: tuple[float, float],
) -> list[Axes]:
    """Draw the cells over threshold about the target, a row a frame, a column a rule.

    Parameters
    ----------
    figure : Figure or SubFigure
        To fill.
    decided : sequence of sequence of Decided
        For each frame what each rule decided.
    target : Place
        In the middle, circled.
    reach : tuple of float
        How far from the target to look, in m and m/s.

    Returns
    -------
    list of Axes
        Row by row.
    """
    at_m, at_m_per_s = float(target.range_m), float(target.velocity_m_per_s)
    grid = panels(figure, len(decided), len(decided[0]), sharex=True, sharey=True)
    for axes, one in zip(grid.flat, (one for row in decided for one in row), strict=True):
        axes.grid(False)
        axes.imshow(
            np.where(one.over, 1.0, np.nan),
            cmap=ListedColormap([BLUE]),
            extent=(*edges(one.range_m), *edges(one.velocity_m_per_s)),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
        circles(axes, np.array([at_m]), np.array([at_m_per_s]), size=26, width=0.9)
        axes.set(
            xlim=(max(at_m - reach[0], 0.0), at_m + reach[0]),
            ylim=(at_m_per_s - reach[1], at_m_per_s + reach[1]),
        )
        axes.set_title(one.title, loc="left")
        axes.set_label(f"Cells over threshold: {one.title}")
    for axes in grid[-1]:
        axes.set_xlabel(MAP_AXES["range"])
    figure.supylabel(MAP_AXES["velocity"], color=mpl.rcParams["axes.labelcolor"])
    return list(grid.flat)


@value
class Line:
    """Power of one rule's map along range through the target, and its threshold, dB."""

    title: str
    range_m: np.ndarray
    power_db: np.ndarray
    threshold_db: np.ndarray


def thresholds(
    figure: FigureBase, lines: Sequence[Line], *, around_m: float, reach_m: float
) -> list[Axes]:
    """Draw power and threshold along range of each rule, side by side, over the mean noise.

    Parameters
    ----------
    figure : Figure or SubFigure
        To fill.
    lines : sequence of Line
        One a rule.
    around_m, reach_m : float
        Range in the middle, and how far to look to each side.

    Returns
    -------
    list of Axes
        From left to right.
    """
    beside: list[Axes] = panels(figure, 1, len(lines), sharex=True, sharey=True)[0].tolist()
    for axes, line in zip(beside, lines, strict=True):
        _cut(axes, line, around_m - reach_m, around_m + reach_m)
    beside[0].set_ylabel("power over the mean noise, dB")
    figure.legend(
        *beside[0].get_legend_handles_labels(),
        loc="outside upper right",
        ncols=2,
        handlelength=1.4,
    )
    return beside


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
    axes.set_title(line.title, loc="left")
    axes.set_xlabel(MAP_AXES["range"])
    axes.set_label(f"Power and threshold along range: {line.title}")
