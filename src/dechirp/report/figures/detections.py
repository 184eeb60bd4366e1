"""Detections and thresholds of several rules in noisy frames."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import FigureBase

from dechirp.core.values import frozen_dataclass
from dechirp.report.figures.common import (
    AXIS_LABELS,
    create_panels,
    draw_detection_circles,
    outer_cell_edges,
)
from dechirp.report.figures.style import BLUE, ORANGE
from dechirp.report.labels import POWER_OVER_NOISE_LABEL
from dechirp.scene.aliasing import RangeVelocity


@frozen_dataclass
class DetectionMask:
    """Mask of the cells that a rule detects, with its axes."""

    title: str
    is_detected: np.ndarray
    """Array (velocity, range)."""
    range_m: np.ndarray
    velocity_m_per_s: np.ndarray


def draw_detection_maps(
    figure: FigureBase,
    masks: Sequence[Sequence[DetectionMask]],
    *,
    target: RangeVelocity,
    half_widths: tuple[float, float],
) -> list[Axes]:
    """Draw the detected cells around the target, a row per frame and a column per rule.

    Parameters
    ----------
    figure : Figure or SubFigure
        Figure to fill.
    masks : sequence of sequence of DetectionMask
        Masks of all rules for each frame.
    target : RangeVelocity
        Position in the middle, marked by a circle.
    half_widths : tuple of float
        Largest distance from the target, in m and m/s.

    Returns
    -------
    list of Axes
        Axes, row by row.
    """
    at_m, at_m_per_s = float(target.range_m), float(target.velocity_m_per_s)
    grid = create_panels(figure, len(masks), len(masks[0]), sharex=True, sharey=True)
    for axes, mask in zip(grid.flat, (mask for row in masks for mask in row), strict=True):
        axes.grid(False)
        axes.imshow(
            np.where(mask.is_detected, 1.0, np.nan),
            cmap=ListedColormap([BLUE]),
            extent=(*outer_cell_edges(mask.range_m), *outer_cell_edges(mask.velocity_m_per_s)),
            origin="lower",
            aspect="auto",
            interpolation="none",
        )
        draw_detection_circles(axes, np.array([at_m]), np.array([at_m_per_s]), size=26, width=0.9)
        axes.set(
            xlim=(max(at_m - half_widths[0], 0.0), at_m + half_widths[0]),
            ylim=(at_m_per_s - half_widths[1], at_m_per_s + half_widths[1]),
        )
        axes.set_title(mask.title, loc="left")
        axes.set_label(f"Cells over threshold: {mask.title}")
    for axes in grid[-1]:
        axes.set_xlabel(AXIS_LABELS["range"])
    figure.supylabel(AXIS_LABELS["velocity"], color=mpl.rcParams["axes.labelcolor"])
    return list(grid.flat)


@frozen_dataclass
class ThresholdLine:
    """Power and threshold of a rule along range through the target, dB."""

    title: str
    range_m: np.ndarray
    power_db: np.ndarray
    threshold_db: np.ndarray


def draw_power_and_threshold_lines(
    figure: FigureBase, lines: Sequence[ThresholdLine], *, around_m: float, reach_m: float
) -> list[Axes]:
    """Draw power and threshold of each rule along range, side by side, over the mean noise.

    Parameters
    ----------
    figure : Figure or SubFigure
        Figure to fill.
    lines : sequence of ThresholdLine
        One line per rule.
    around_m, reach_m : float
        Range in the middle, and extent to each side.

    Returns
    -------
    list of Axes
        Axes from left to right.
    """
    panels: list[Axes] = create_panels(figure, 1, len(lines), sharex=True, sharey=True)[0].tolist()
    for axes, line in zip(panels, lines, strict=True):
        _draw_power_and_threshold_line(axes, line, around_m - reach_m, around_m + reach_m)
    panels[0].set_ylabel(POWER_OVER_NOISE_LABEL)
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside upper right",
        ncols=2,
        handlelength=1.4,
    )
    return panels


def _draw_power_and_threshold_line(
    axes: Axes, line: ThresholdLine, min_m: float, max_m: float
) -> None:
    is_shown = (line.range_m >= min_m) & (line.range_m <= max_m)
    axes.plot(
        line.range_m[is_shown],
        np.maximum(line.power_db[is_shown], -15.0),
        color=BLUE,
        linewidth=1.0,
        label="power",
    )
    axes.plot(
        line.range_m[is_shown],
        line.threshold_db[is_shown],
        color=ORANGE,
        linewidth=1.3,
        label="threshold",
    )
    axes.set(xlim=(min_m, max_m))
    axes.set_title(line.title, loc="left")
    axes.set_xlabel(AXIS_LABELS["range"])
    axes.set_label(f"Power and threshold along range: {line.title}")
