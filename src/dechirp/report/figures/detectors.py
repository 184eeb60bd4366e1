"""Comparison of all CFAR detectors on one range profile: masking, and a clutter edge."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from dechirp.core.units import to_decibels
from dechirp.processing.cfar.base import NoiseEstimator
from dechirp.processing.cfar.member_comparison import (
    ExampleMap,
    compare_thresholds,
    make_example_map,
)
from dechirp.report.figures.common import create_panels
from dechirp.report.figures.style import BLUE, INK, ORANGE
from dechirp.report.labels import POWER_OVER_NOISE_LABEL

_COLUMNS = 2
_ROW_IN = 1.35
_LOWEST_DB = -8.0


def draw_detector_comparison(figure: FigureBase) -> list[Axes]:
    """Draw the thresholds of all detectors at the same false-alarm probability.

    Parameters
    ----------
    figure : Figure or SubFigure
        Figure to fill; see `figure_height_in` for its height.

    Returns
    -------
    list of Axes
        Axes of each detector.
    """
    situation = make_example_map()
    thresholds = compare_thresholds(situation.power, situation.row)
    grid = create_panels(figure, _n_panel_rows(len(thresholds)), _COLUMNS, sharex=True, sharey=True)
    for axes, (kind, threshold) in zip(grid.flat, thresholds.items(), strict=False):
        _draw_detector_threshold(axes, situation, kind, threshold)
    for axes in grid.flat[len(thresholds) :]:
        axes.set_axis_off()
    color = mpl.rcParams["axes.labelcolor"]
    figure.supxlabel("Range (cells)", color=color)
    figure.supylabel(POWER_OVER_NOISE_LABEL, color=color)
    figure.legend(
        *grid[0, 0].get_legend_handles_labels(),
        loc="outside upper right",
        ncols=4,
        handlelength=1.4,
        columnspacing=1.2,
        handletextpad=0.4,
    )
    return list(grid.flat[: len(thresholds)])


def figure_height_in() -> float:
    """Return the figure height (in) that all detectors need."""
    return _ROW_IN * _n_panel_rows(len(NoiseEstimator.members())) + 0.9


def _n_panel_rows(n_detectors: int) -> int:
    return -(-n_detectors // _COLUMNS)


def _draw_detector_threshold(
    axes: Axes, example: ExampleMap, detector_kind: str, threshold: np.ndarray
) -> None:
    profile = example.power[example.row]
    cells = np.arange(profile.size)
    exceeds = profile > threshold
    strong, weak = example.targets
    axes.axvspan(
        example.clutter_start - 0.5, cells[-1], color="#eef0f2", linewidth=0, label="clutter"
    )
    axes.plot(
        cells,
        np.maximum(to_decibels(profile), _LOWEST_DB),
        color=BLUE,
        linewidth=0.9,
        drawstyle="steps-mid",
        label="power",
    )
    axes.plot(cells, to_decibels(threshold), color=ORANGE, linewidth=1.2, label="threshold")
    axes.plot(
        cells[exceeds],
        to_decibels(profile[exceeds]),
        linestyle="",
        marker="o",
        markersize=3.5,
        color=INK,
        label="detection",
    )
    n_false = int(exceeds.sum()) - int(exceeds[strong]) - int(exceeds[weak])
    outcome = "both detected" if exceeds[weak] and exceeds[strong] else "one masked"
    outcome += f", {n_false} false" if n_false else ""
    axes.set_title(f"{detector_kind.replace('-', ' ')}: {outcome}", loc="left")
    axes.set_label(f"Threshold of {detector_kind.replace('-', ' ')} on one profile: {outcome}")
    axes.set(xlim=(30, 170), ylim=(_LOWEST_DB, 42))
