"""All members of the detector family on one range profile: masking, and the edge of clutter."""

from collections.abc import Callable, Mapping

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dechirp.core.units import decibels
from dechirp.process.cfar.side_by_side import Situation, masking_and_clutter_edge, side_by_side
from dechirp.report.figures.style import BLUE, INK, MUTED, ORANGE, draw, picture

_COLUMNS = 2
_HEIGHT_IN = 1.35
_LOWEST_DB = -8.0


def beside_each_other() -> Markup:
    """Draw each member's threshold, all at the same false-alarm probability."""
    paint, height_in = _paint()
    return draw(paint, label="Thresholds of all detectors on one profile", height_in=height_in)


def beside_each_other_picture() -> bytes:
    """The same as PNG, for pages that cannot draw it."""
    paint, height_in = _paint()
    return picture(paint, height_in=height_in)


def _paint() -> tuple[Callable[[Figure], None], float]:
    shown = masking_and_clutter_edge()
    thresholds = side_by_side(shown.power, shown.row)
    n_rows = -(-len(thresholds) // _COLUMNS)
    return lambda figure: _panels(figure, shown, thresholds, n_rows), _HEIGHT_IN * n_rows + 0.9


def _panels(
    figure: Figure, shown: Situation, thresholds: Mapping[str, np.ndarray], n_rows: int
) -> None:
    panels = figure.subplots(n_rows, _COLUMNS, sharex=True, sharey=True, squeeze=False)
    for axes, (kind, threshold) in zip(panels.flat, thresholds.items(), strict=False):
        _one(axes, shown, kind, threshold)
    for axes in panels.flat[len(thresholds) :]:
        axes.set_axis_off()
    figure.supxlabel("range, cells", fontsize=8.5, color=MUTED)
    figure.supylabel("power over the mean noise, dB", fontsize=8.5, color=MUTED)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(),
        loc="outside upper right",
        ncols=4,
        handlelength=1.4,
        columnspacing=1.2,
        handletextpad=0.4,
    )


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
    axes.set_title(f"{kind.replace('-', ' ')}: {said}", fontsize=8.5, loc="left")
    axes.set(xlim=(30, 170), ylim=(_LOWEST_DB, 42))
