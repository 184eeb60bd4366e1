"""Comparison figures of a recording and its twin."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.report.figures.common import AXIS_LABELS, MapAxis, add_legend, line_through_cell
from dechirp.report.figures.style import BLUE, MUTED, ORANGE, reduce_line_to_extremes
from dechirp.report.labels import power_label


def draw_recorded_and_twin_cut(
    axes: Axes,
    recorded: xr.DataArray,
    twin: xr.DataArray,
    *,
    along: MapAxis,
    cell: tuple[int, int],
    units: str,
) -> Axes:
    """Draw both maps along one axis through a cell.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    recorded, twin : DataArray (velocity, range)
        Power map, W or full scale squared.
    along, cell, units
        See `cfar.draw_recorded_and_twin_cut`.

    Returns
    -------
    Axes
        The given axes.
    """
    lines = [
        ("recording", line_through_cell(recorded, cell, along=along), BLUE, 1.5),
        ("twin", line_through_cell(twin, cell, along=along), ORANGE, 1.0),
    ]
    highest = max(float(power_to_dbm_or_dbfs(line.values.max(), units)) for _, line, _, _ in lines)
    lowest = min(
        float(power_to_dbm_or_dbfs(np.median(line.values), units)) for _, line, _, _ in lines
    )
    for name, line, color, width in lines:
        thinned = reduce_line_to_extremes(
            line[along].values, power_to_dbm_or_dbfs(line.values, units)
        )
        axes.plot(*thinned, color=color, linewidth=width, label=name)
    axes.set_ylim(lowest - 20, highest + 4)
    axes.margins(x=0)
    axes.set_xlabel(AXIS_LABELS[along])
    axes.set_ylabel(power_label(power_level_unit(units)))
    add_legend(axes)
    axes.set_label(f"Recording and twin along {along}")
    return axes


def draw_noise_levels_over_range(
    axes: Axes, noise_by_range: Sequence[Mapping[str, Any]], *, unit: str
) -> Axes:
    """Draw the noise levels of both over range.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    noise_by_range : sequence of mapping
        Each with `range_m`, `recorded_db` and `twin_db`.
    unit : str
        Unit of the levels: dBm or dBFS.

    Returns
    -------
    Axes
        The given axes.
    """
    range_m = [interval["range_m"] for interval in noise_by_range]
    for name, key, color, width in (
        ("recording", "recorded_db", BLUE, 2.4),
        ("twin", "twin_db", ORANGE, 1.1),
    ):
        level_db = [
            np.nan if interval[key] is None else interval[key] for interval in noise_by_range
        ]
        axes.plot(range_m, level_db, color=color, linewidth=width, marker=".", label=name)
    axes.set_xlabel(AXIS_LABELS["range"])
    axes.set_ylabel(f"Noise per cell ({unit})")
    add_legend(axes)
    axes.set_label("Noise over range")
    return axes


def draw_peak_power_differences(
    axes: Axes, peaks: Sequence[Mapping[str, Any]], *, tolerance_db: float
) -> Axes:
    """Draw the power differences of the peaks over their SNR, with the spread by noise.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    peaks : sequence of mapping
        Each with `snr_db`, `power_difference_db`, `power_std_db` and whether it was `judged`.
    tolerance_db : float
        Tolerated difference, drawn as lines.

    Returns
    -------
    Axes
        The given axes.
    """
    groups = (
        ("judged", [row for row in peaks if row["judged"]], BLUE),
        ("not judged", [row for row in peaks if not row["judged"]], "#a9b6c2"),
    )
    for side, label in ((-tolerance_db, None), (tolerance_db, "allowed")):
        axes.axhline(side, color=MUTED, linewidth=0.9, linestyle=":", label=label)
    for name, group_rows, color in groups:
        if group_rows:
            axes.errorbar(
                [row["snr_db"] for row in group_rows],
                [row["power_difference_db"] for row in group_rows],
                yerr=[row["power_std_db"] for row in group_rows],
                linestyle="",
                marker="o",
                markersize=3,
                elinewidth=0.8,
                color=color,
                label=name,
            )
    axes.set_xlabel("SNR of the peak (dB)")
    axes.set_ylabel("Power difference, twin \N{MINUS SIGN} recording (dB)")
    add_legend(axes)
    axes.set_label("Power differences over SNR")
    return axes
