"""A recording and its twin in one figure: cuts through a peak, the noise, the differences."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from dechirp.report.figures.style import BLUE, MUTED, ORANGE, draw, thinned
from dechirp.report.words import power_db, power_unit

Axis = Literal["range", "velocity"]

_AXES: dict[Axis, str] = {"range": "range, m", "velocity": "velocity, m/s (receding positive)"}


def cut(
    recorded: xr.DataArray,
    twin: xr.DataArray,
    *,
    along: Axis,
    cell: tuple[int, int],
    units: str,
) -> Markup:
    """Draw both maps along one axis through a cell (velocity, range)."""
    across: Axis = "velocity" if along == "range" else "range"
    fixed = cell[0] if across == "velocity" else cell[1]
    lines = [
        ("recording", recorded.isel({across: fixed}), BLUE, 1.5),
        ("twin", twin.isel({across: fixed}), ORANGE, 1.0),
    ]
    highest = max(float(power_db(one.values.max(), units)) for _, one, _, _ in lines)
    lowest = min(float(power_db(np.median(one.values), units)) for _, one, _, _ in lines)

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for name, one, color, width in lines:
            shown = thinned(one[along].values, power_db(one.values, units))
            axes.plot(*shown, color=color, linewidth=width, label=name)
        axes.set_ylim(lowest - 20, highest + 4)
        axes.margins(x=0)
        axes.set_xlabel(_AXES[along])
        axes.set_ylabel(f"power, {power_unit(units)}")
        figure.legend(loc="outside upper right", ncols=2)

    return draw(paint, label=f"Recording and twin along {along}", height_in=2.8)


def noise(over_range: Sequence[Mapping[str, Any]], *, unit: str) -> Markup:
    """Draw the noise over range, of both."""
    range_m = [one["range_m"] for one in over_range]

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for name, key, color, width in (
            ("recording", "recorded_db", BLUE, 2.4),
            ("twin", "twin_db", ORANGE, 1.1),
        ):
            level_db = [np.nan if one[key] is None else one[key] for one in over_range]
            axes.plot(range_m, level_db, color=color, linewidth=width, marker=".", label=name)
        axes.set_xlabel("range, m")
        axes.set_ylabel(f"noise in a cell, {unit}")
        figure.legend(loc="outside upper right", ncols=2)

    return draw(paint, label="Noise over range", height_in=2.8)


def apart(rows: Sequence[Mapping[str, Any]], *, within_db: float) -> Markup:
    """Draw the differences of the peaks' powers over their ratio, with what noise explains."""
    groups = (
        ("judged", [one for one in rows if one["judged"]], BLUE),
        ("not judged", [r for r in rows if not r["judged"]], "#a9b6c2"),
    )

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for side in (-within_db, within_db):
            axes.axhline(side, color=MUTED, linewidth=0.9, linestyle=":")
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
        figure.legend(loc="outside upper right", ncols=2)

    return draw(paint, label="Differences of power over the ratio to the noise", height_in=2.8)
