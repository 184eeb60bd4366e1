"""What figures share: legends, colour bars, panels, marks for what is found and what is true."""

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

from dechirp.core.words import number, small
from dechirp.report.figures.style import INK, ORANGE

Axis = Literal["range", "velocity"]

MAP_AXES: dict[Axis, str] = {
    "range": "range, m",
    "velocity": "velocity, m/s (receding positive)",
}
"""What stands at the axes of maps."""

# Letters of a legend in an inch, times their size in points; and what a mark takes, in letters.
_LETTERS, _MARK_LETTERS = 174.0, 6


def legend(
    axes: Axes, *, handles: Sequence[Artist] = (), title: str = "", **look: Any
) -> Legend | None:
    """Say above the axes what marks stand for, in as few rows as their width allows.

    Of the handles, or of all that has a label on the axes; each name once.
    """
    found = (handles, [str(one.get_label()) for one in handles])
    marks, names = found if handles else axes.get_legend_handles_labels()
    named = dict(zip(names, marks, strict=True))
    if not named:
        return None
    return axes.legend(
        list(named.values()),
        list(named),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.3,
        ncols=_columns(axes, list(named)),
        title=title or None,
        **{"handlelength": 1.4, "handletextpad": 0.5, "columnspacing": 1.2, **look},
    )


def _columns(axes: Axes, names: Sequence[str]) -> int:
    """The most columns that names fit in side by side."""
    size = FontProperties(size=mpl.rcParams["legend.fontsize"]).get_size_in_points()
    letters = axes.bbox.width / axes.figure.dpi * _LETTERS / size
    lengths = np.array([len(name) + _MARK_LETTERS for name in names])
    fitting = (
        n
        for n in range(len(names), 1, -1)
        if sum(column.max() for column in np.array_split(lengths, n)) <= letters
    )
    return next(fitting, 1)


def panels(figure: FigureBase, n_rows: int, n_columns: int, **how: Any) -> np.ndarray:
    """Divide a figure into axes, (n_rows, n_columns); one without a layout gets one."""
    if isinstance(figure, Figure) and figure.get_layout_engine() is None:
        figure.set_layout_engine("constrained")
    return np.asarray(figure.subplots(n_rows, n_columns, squeeze=False, **how))


def colour_bar(axes: Axes | Sequence[Axes], image: ScalarMappable, words: str) -> Colorbar:
    """Say beside the axes what colours stand for."""
    of = axes if isinstance(axes, Axes) else axes[0]
    bar = of.figure.colorbar(image, ax=axes, pad=0.02, aspect=28)
    bar.outline.set_visible(False)
    bar.set_label(words)
    return bar


def circles(axes: Axes, x: np.ndarray, y: np.ndarray, *, size: float, width: float = 1.3) -> None:
    """Circle what was detected; sizes in points."""
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


def crosses(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    *,
    marker: str = "+",
    size: float = 7,
    name: str = "truth",
) -> None:
    """Mark what is true: dark on a light rim, to be seen on the noise and on the peak."""
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


def edges(centres: np.ndarray) -> tuple[float, float]:
    """Both ends of a line of cells, half a cell beyond the centres; one alone is one wide."""
    half = cell_width(centres) / 2
    return float(centres[0]) - half, float(centres[-1]) + half


def cell_width(centres: np.ndarray) -> float:
    """Step of an even axis; 1 where it has one cell alone."""
    return float(centres[-1] - centres[0]) / max(centres.size - 1, 1) or 1.0


def line_through(of: xr.DataArray, cell: tuple[int, int], *, along: Axis) -> xr.DataArray:
    """Values of a map over range or velocity, on the line through a cell (velocity, range)."""
    row, column = cell
    return of.isel(velocity=row) if along == "range" else of.isel(range=column)


def in_decades(ruler: Ruler) -> None:
    """Write powers of ten, and where there are fewer than two of them, numbers between as well."""
    low, high = sorted(ruler.get_view_interval())
    ruler.set_major_formatter(FuncFormatter(lambda one, _: _tick(one)))
    n_decades = np.floor(np.log10(high)) - np.ceil(np.log10(low)) + 1
    between = FuncFormatter(lambda one, _: _tick(one) if f"{one:.0e}"[0] in "235" else "")
    ruler.set_minor_formatter(between if n_decades < 2 else NullFormatter())


def _tick(one: float) -> str:
    return number(one, 3) if 1e-3 < one < 1e5 else small(one)
