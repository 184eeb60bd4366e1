"""The first look at a recording: its first map, its first profile, or the points it holds."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from dechirp.report.figures.range_doppler import MarkedMap, noise_power, whole_picture
from dechirp.report.figures.style import BLUE, ORANGE, picture, thinned
from dechirp.report.words import power_db, power_unit
from dechirp.scene.folding import Place

_NOWHERE = Place(np.empty(0), np.empty(0))


def first_map(power: xr.DataArray, *, units: str, title: str) -> bytes:
    """PNG of the map (velocity, range) of a frame; of one chirp, its profile over range."""
    if power.sizes["velocity"] == 1:
        return _profile(power.isel(velocity=0), units=units, title=title)
    marked = MarkedMap(power=power, units=units, found=_NOWHERE, truth=None)
    return whole_picture(marked, title=title)


def _profile(power: xr.DataArray, *, units: str, title: str) -> bytes:
    level_db = power_db(power.values, units)
    lowest_db = float(power_db(np.asarray(noise_power(power.values)), units)) - 12

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot(*thinned(power.range.values, level_db), color=BLUE, linewidth=1.0)
        axes.set_xlabel("range, m")
        axes.set_ylabel(f"power, {power_unit(units)}")
        axes.set_ylim(bottom=max(lowest_db, float(level_db.max()) - 100))
        axes.set_xlim(float(power.range[0]), float(power.range[-1]))
        figure.suptitle(title, fontsize=9)

    return picture(paint, height_in=3.2)


def points_from_above(points: xr.Dataset, *, title: str) -> bytes:
    """PNG of all detections seen from above, those that move in another colour."""
    ground = points.range * np.cos(points.elevation.fillna(0.0))  # a level array tells none
    forward, left = ground * np.cos(points.azimuth), ground * np.sin(points.azimuth)
    moving = abs(points.velocity) > 0
    groups = (("at rest", ~moving, BLUE), ("moving", moving, ORANGE))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        for name, chosen, color in groups:
            if chosen.any():
                axes.plot(
                    left.values[chosen.values],
                    forward.values[chosen.values],
                    linestyle="",
                    marker=".",
                    markersize=3,
                    alpha=0.5,
                    color=color,
                    label=f"{name}, {int(chosen.sum())}",
                )
        axes.set_aspect("equal", adjustable="datalim")
        axes.invert_xaxis()  # left is to the left
        axes.set_xlabel("left, m")
        axes.set_ylabel("forward, m")
        if axes.lines:
            axes.legend(loc="upper right")
        figure.suptitle(title, fontsize=9)

    return picture(paint, height_in=4.2)
