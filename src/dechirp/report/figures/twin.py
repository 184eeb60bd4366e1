"""A recording and its twin in one figure: cuts through a peak, the noise, the differences."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.words import power_db, power_unit
from dechirp.report.figures.parts import MAP_AXES, Axis, legend, line_through
from dechirp.report.figures.style import BLUE, MUTED, ORANGE, thinned


def cut(
    axes: Axes,
    recorded: xr.DataArray,
    twin: xr.DataArray,
    *,
    along: Axis,
    cell: tuple[int, int],
    units: str,
) -> Axes:
    """Draw the maps of both along one axis through a cell.

    Parameters
    ----------
    axes : Axes
        To draw on.
    recorded, twin : DataArray (velocity, range)
        W or full scale squared.
    along, cell, units
        See `cfar.cut`.

    Returns
    -------
    Axes
        Those given.
    """
    lines = [
        ("recording", line_through(recorded, cell, along=along), BLUE, 1.5),
        ("twin", line_through(twin, cell, along=along), ORANGE, 1.0),
    ]
    highest = max(float(power_db(one.values.max(), units)) for _, one, _, _ in lines)
    lowest = min(float(power_db(np.median(one.values), units)) for _, one, _, _ in lines)
    for name, one, color, width in lines:
        shown = thinned(one[along].values, power_db(one.values, units))
        axes.plot(*shown, color=color, linewidth=width, label=name)
    axes.set_ylim(lowest - 20, highest + 4)
    axes.margins(x=0)
    axes.set_xlabel(MAP_AXES[along])
    axes.set_ylabel(f"power, {power_unit(units)}")
    legend(axes)
    axes.set_label(f"Recording and twin along {along}")
    return axes


def noise(axes: Axes, over_range: Sequence[Mapping[str, Any]], *, unit: str) -> Axes:
    """Draw the noise of both over range.

    Parameters
    ----------
    axes : Axes
        To draw on.
    over_range : sequence of mapping
        Each with `range_m`, `recorded_db` and `twin_db`.
    unit : str
        Of the levels: dBm or dBFS.

    Returns
    -------
    Axes
        Those given.
    """
    range_m = [one["range_m"] for one in over_range]
    for name, key, color, width in (
        ("recording", "recorded_db", BLUE, 2.4),
        ("twin", "twin_db", ORANGE, 1.1),
    ):
        level_db = [np.nan if one[key] is None else one[key] for one in over_range]
        axes.plot(range_m, level_db, color=color, linewidth=width, marker=".", label=name)
    axes.set_xlabel("range, m")
    axes.set_ylabel(f"noise in a cell, {unit}")
    legend(axes)
    axes.set_label("Noise over range")
    return axes


def apart(axes: Axes, rows: Sequence[Mapping[str, Any]], *, within_db: float) -> Axes:
    """Draw the differences of the peaks' powers over their ratio, with what noise explains.

    Parameters
    ----------
    axes : Axes
        To draw on.
    rows : sequence of mapping
        Each with `snr_db`, `power_difference_db`, `power_std_db` and whether it was `judged`.
    within_db : float
        Differences that are allowed, drawn across.

    Returns
    -------
    Axes
        Those given.
    """
    groups = (
        ("judged", [one for one in rows if one["judged"]], BLUE),
        ("not judged", [one for one in rows if not one["judged"]], "#a9b6c2"),
    )
    for side, label in ((-within_db, None), (within_db, "allowed")):
        axes.axhline(side, color=MUTED, linewidth=0.9, linestyle=":", label=label)
    for name, own, color in groups:
        if own:
            axes.errorbar(
                [one["snr_db"] for one in own],
                [one["power_difference_db"] for one in own],
                yerr=[one["power_std_db"] for one in own],
                linestyle="",
                marker="o",
                markersize=3,
                elinewidth=0.8,
                color=color,
                label=name,
            )
    axes.set_xlabel("peak over the noise in its cell, dB")
    axes.set_ylabel("twin less recording, dB")
    legend(axes)
    axes.set_label("Differences of power over the ratio to the noise")
    return axes
