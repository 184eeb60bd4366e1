"""Shared elements of figures: legends, colour bars, panels, ticks and marks."""

from collections.abc import Sequence
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis as Ruler
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure, FigureBase
from matplotlib.font_manager import FontProperties
from matplotlib.legend import Legend
from matplotlib.ticker import FuncFormatter, NullFormatter

from dechirp.core.text import format_number, format_probability
from dechirp.report.figures.style import INK, ORANGE
from dechirp.report.labels import RANGE_LABEL, VELOCITY_LABEL
from dechirp.scene.scene import Scene

MapAxis = Literal["range", "velocity"]

AXIS_LABELS: dict[MapAxis, str] = {
    "range": RANGE_LABEL,
    "velocity": VELOCITY_LABEL,
}
"""Axis labels of maps."""

# Legend letters per inch times their size in points, and the width of a mark in letters.
_LETTERS, _MARK_LETTERS = 174.0, 6


def add_legend(
    axes: Axes, *, handles: Sequence[Artist] = (), title: str = "", **look: Any
) -> Legend | None:
    """Add a legend above the axes, with as few rows as their width allows.

    It contains the handles, or all labelled artists of the axes, each label once.
    """
    labelled = (handles, [str(handle.get_label()) for handle in handles])
    marks, names = labelled if handles else axes.get_legend_handles_labels()
    handle_of_label = dict(zip(names, marks, strict=True))
    if not handle_of_label:
        return None
    return axes.legend(
        list(handle_of_label.values()),
        list(handle_of_label),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.3,
        ncols=_count_legend_columns(axes, list(handle_of_label)),
        title=title or None,
        **{"handlelength": 1.4, "handletextpad": 0.5, "columnspacing": 1.2, **look},
    )


def _count_legend_columns(axes: Axes, names: Sequence[str]) -> int:
    """Return the largest number of legend columns that fits the axes."""
    size = FontProperties(size=mpl.rcParams["legend.fontsize"]).get_size_in_points()
    letters = axes.bbox.width / axes.figure.dpi * _LETTERS / size
    lengths = np.array([len(name) + _MARK_LETTERS for name in names])
    fitting = (
        n
        for n in range(len(names), 1, -1)
        if sum(column.max() for column in np.array_split(lengths, n)) <= letters
    )
    return next(fitting, 1)


def create_panels(figure: FigureBase, n_rows: int, n_columns: int, **options: Any) -> np.ndarray:
    """Create axes (n_rows, n_columns) in a figure, with constrained layout unless it has one."""
    if isinstance(figure, Figure) and figure.get_layout_engine() is None:
        figure.set_layout_engine("constrained")
    return np.asarray(figure.subplots(n_rows, n_columns, squeeze=False, **options))


def add_colour_bar(axes: Axes | Sequence[Axes], image: ScalarMappable, label: str) -> Colorbar:
    """Add a labelled colour bar beside the axes."""
    first_axes = axes if isinstance(axes, Axes) else axes[0]
    bar = first_axes.figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
    bar.outline.set_visible(False)
    bar.set_label(label)
    return bar


def draw_detection_circles(
    axes: Axes, x: np.ndarray, y: np.ndarray, *, size: float, width: float = 1.3
) -> None:
    """Draw circles around detections; sizes in points."""
    axes.plot(
        x,
        y,
        linestyle="",
        marker="o",
        markersize=size,
        markerfacecolor="none",
        markeredgecolor=ORANGE,
        markeredgewidth=width,
        label="detection",
    )


def draw_truth_marks(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    *,
    marker: str = "+",
    size: float = 7,
    name: str = "truth",
) -> None:
    """Draw crosses at true values: dark with a light rim, visible on noise and on peaks."""
    for color, width, label in (("#ffffff", 2.6, None), (INK, 1.1, name)):
        axes.plot(
            x,
            y,
            linestyle="",
            marker=marker,
            markersize=size + width,
            color=color,
            markeredgewidth=width,
            label=label,
        )


def outer_cell_edges(centres: np.ndarray) -> tuple[float, float]:
    """Return the outer edges of a line of cells; a single cell is one wide."""
    half = uniform_cell_width(centres) / 2
    return float(centres[0]) - half, float(centres[-1]) + half


def uniform_cell_width(centres: np.ndarray) -> float:
    """Return the step of an even axis; 1 for a single cell."""
    return float(centres[-1] - centres[0]) / max(centres.size - 1, 1) or 1.0


def range_axis_end_m(ranges_m: np.ndarray, full_m: float) -> float:
    """Return an end of a range axis that shows all given ranges with as much again behind them.

    Twice the farthest range, rounded up to 1, 2 or 5 times a power of ten; `full_m`, the end of the
    data, without ranges or if it is less. Ranges that are NaN, as of maps without velocity, do not
    count.
    """
    farthest_m = float(np.max(ranges_m[np.isfinite(ranges_m)], initial=0.0))
    if farthest_m <= 0:
        return full_m
    decade = 10.0 ** np.floor(np.log10(2 * farthest_m))
    end_m = next(n * decade for n in (1, 2, 5, 10) if n * decade >= 2 * farthest_m)
    return min(end_m, full_m)


def line_through_cell(
    power: xr.DataArray, cell: tuple[int, int], *, along: MapAxis
) -> xr.DataArray:
    """Return the values along range or velocity through a cell (velocity, range)."""
    row, column = cell
    return power.isel(velocity=row) if along == "range" else power.isel(range=column)


def set_decade_ticks(axis: Ruler) -> None:
    """Label the powers of ten, and with fewer than two of them, intermediate values."""
    low, high = sorted(axis.get_view_interval())
    axis.set_major_formatter(FuncFormatter(lambda position, _: _format_tick(position)))
    n_decades = np.floor(np.log10(high)) - np.ceil(np.log10(low)) + 1
    minor_formatter = FuncFormatter(
        lambda position, _: _format_tick(position) if f"{position:.0e}"[0] in "235" else ""
    )
    axis.set_minor_formatter(minor_formatter if n_decades < 2 else NullFormatter())


def _format_tick(position: float) -> str:
    return format_number(position, 3) if 1e-3 < position < 1e5 else format_probability(position)


def choose_body_scatterer_indices(
    scene: Scene, max_count: int, is_eligible: np.ndarray | None = None
) -> np.ndarray:
    """Choose at most `max_count` scatterers of bodies, evenly spread, and return their indices.

    `is_eligible` (n_scatterers,) restricts the choice.
    """
    has_body = np.array([target.body is not None for target in scene.targets], dtype=bool)
    is_candidate = has_body[scene.target_index_of_scatterer]
    indices = np.flatnonzero(is_candidate if is_eligible is None else is_candidate & is_eligible)
    return indices[:: -(-len(indices) // max_count) or 1]
