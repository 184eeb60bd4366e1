"""All members of the detector family on one range profile: masking, and the edge of clutter."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from dechirp.core.units import decibels
from dechirp.process.cfar.base import NoiseEstimator
from dechirp.process.cfar.side_by_side import Situation, masking_and_clutter_edge, side_by_side
from dechirp.report.figures.parts import panels
from dechirp.report.figures.style import BLUE, INK, ORANGE

_COLUMNS = 2
_ROW_IN = 1.35
_LOWEST_DB = -8.0


def beside_each_other(figure: FigureBase) -> list[Axes]:
    """Draw each member's threshold, all at the same false-alarm probability.

    Parameters
    ----------
    figure : Figure or SubFigure
        To fill; `height_in` says how high it should be.

    Returns
    -------
    list of Axes
        One for each member.
    """
    shown = masking_and_clutter_edge()
    thresholds = side_by_side(shown.power, shown.row)
    grid = panels(figure, _n_rows(len(thresholds)), _COLUMNS, sharex=True, sharey=True)
    for axes, (kind, threshold) in zip(grid.flat, thresholds.items(), strict=False):
        _one(axes, shown, kind, threshold)
    for axes in grid.flat[len(thresholds) :]:
        axes.set_axis_off()
    color = mpl.rcParams["axes.labelcolor"]
    figure.supxlabel("range, cells", color=color)
    figure.supylabel("power over the mean noise, dB", color=color)
    figure.legend(
        *grid[0, 0].get_legend_handles_labels(),
        loc="outside upper right",
        ncols=4,
        handlelength=1.4,
        columnspacing=1.2,
        handletextpad=0.4,
    )
    return list(grid.flat[: len(thresholds)])


def height_in() -> float:
    """Height of a figure in which all members have room."""
    return _ROW_IN * _n_rows(len(NoiseEstimator.members())) + 0.9


def _n_rows(n_members: int) -> int:
    return -(-n_members // _COLUMNS)


def _one(axes: Axes, shown: Situation, kind: str, threshold: np.ndarray) -> None:
    profile = shown.power[shown.row]
    cells = np.arange(profile.size)
    over = profile > threshold
    strong, weak = shown.targets
    axes.axvspan(shown.clutter_from - 0.5, cells[-1], color="#eef0f2", linewidth=0, label="clutter")
    axes.plot(
        cells,
        np.maximum(decibels(profile), _LOWEST_DB),
        color=BLUE,
        linewidth=0.9,
        drawstyle="steps-mid",
        label="power",
    )
    axes.plot(cells, decibels(threshold), color=ORANGE, linewidth=1.2, label="threshold")
    axes.plot(
        cells[over],
        decibels(profile[over]),
        linestyle="",
        marker="o",
        markersize=3.5,
        color=INK,
        label="detection",
    )
    n_false = int(over.sum()) - int(over[strong]) - int(over[weak])
    said = "both found" if over[weak] and over[strong] else "one masked"
    said += f", {n_false} false" if n_false else ""
    axes.set_title(f"{kind.replace('-', ' ')}: {said}", loc="left")
    axes.set_label(f"Threshold of {kind.replace('-', ' ')} on one profile: {said}")
    axes.set(xlim=(30, 170), ylim=(_LOWEST_DB, 42))
