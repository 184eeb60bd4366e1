"""The first look at a recording: its first map, its first profile, or the points it holds."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.words import power_db, power_unit
from dechirp.report.figures import ground
from dechirp.report.figures.parts import MAP_AXES, legend
from dechirp.report.figures.range_doppler import MarkedMap, noise_power, whole
from dechirp.report.figures.style import BLUE, ORANGE, thinned


def first_map(axes: Axes, power: xr.DataArray, *, units: str) -> Axes:
    """Draw the map of a frame; of one chirp, its profile over range.

    Parameters
    ----------
    axes : Axes
        To draw on; a map has a colour bar, which takes of their room.
    power : DataArray (velocity, range)
        W or full scale squared.
    units : str
        Of the samples: sqrt(W) gives dBm, all else dB relative to full scale.

    Returns
    -------
    Axes
        Those given.
    """
    if power.sizes["velocity"] > 1:
        return whole(axes, MarkedMap(power=power, units=units))
    profile = power.isel(velocity=0)
    level_db = power_db(profile.values, units)
    lowest_db = float(power_db(np.asarray(noise_power(profile.values)), units)) - 12
    axes.plot(*thinned(profile.range.values, level_db), color=BLUE, linewidth=1.0)
    axes.set_xlabel(MAP_AXES["range"])
    axes.set_ylabel(f"power, {power_unit(units)}")
    axes.set_ylim(bottom=max(lowest_db, float(level_db.max()) - 100))
    axes.set_xlim(float(profile.range[0]), float(profile.range[-1]))
    axes.set_label("Power over range of one chirp")
    return axes


def points_from_above(axes: Axes, points: xr.Dataset) -> Axes:
    """Draw all detections seen from above, those that move in another colour.

    Parameters
    ----------
    axes : Axes
        To draw on; a meter is equally long along both.
    points : Dataset over `detection`
        With range, azimuth, elevation and velocity.

    Returns
    -------
    Axes
        Those given.
    """
    level_m = points.range * np.cos(points.elevation.fillna(0.0))  # a level array tells none
    forward, left = level_m * np.cos(points.azimuth), level_m * np.sin(points.azimuth)
    moving = abs(points.velocity) > 0
    for name, chosen, color in (("at rest", ~moving, BLUE), ("moving", moving, ORANGE)):
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
    axes.set_xlabel(ground.SIDE)
    axes.set_ylabel(ground.FORWARD)
    legend(axes)
    axes.set_label("Detections from above")
    return axes
