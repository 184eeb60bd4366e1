"""Preview figures of a recording: first map, first profile, or points from above."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.report.figures.common import AXIS_LABELS, add_legend
from dechirp.report.figures.range_doppler import MarkedMap, draw_map, noise_power_from_median
from dechirp.report.figures.style import BLUE, ORANGE, reduce_line_to_extremes
from dechirp.report.labels import X_LABEL, Y_LABEL, power_label


def draw_map_or_range_profile(axes: Axes, power: xr.DataArray, *, units: str) -> Axes:
    """Draw the map of a frame, or its range profile if it has one chirp.

    Parameters
    ----------
    axes : Axes
        Axes to draw on; the colour bar of a map uses part of their space.
    power : DataArray (velocity, range)
        Power map, W or full scale squared.
    units : str
        Units of the samples: sqrt(W) gives dBm, other units dB relative to full scale.

    Returns
    -------
    Axes
        The given axes.
    """
    if power.sizes["velocity"] > 1:
        return draw_map(axes, MarkedMap(power=power, units=units))
    profile = power.isel(velocity=0)
    level_db = power_to_dbm_or_dbfs(profile.values, units)
    lowest_db = (
        float(power_to_dbm_or_dbfs(np.asarray(noise_power_from_median(profile.values)), units)) - 12
    )
    axes.plot(*reduce_line_to_extremes(profile.range.values, level_db), color=BLUE, linewidth=1.0)
    axes.set_xlabel(AXIS_LABELS["range"])
    axes.set_ylabel(power_label(power_level_unit(units)))
    axes.set_ylim(bottom=max(lowest_db, float(level_db.max()) - 100))
    axes.set_xlim(float(profile.range[0]), float(profile.range[-1]))
    axes.set_label("Power over range of one chirp")
    return axes


def draw_points_from_above(axes: Axes, points: xr.Dataset) -> Axes:
    """Draw all detections from above, moving ones in a second colour.

    Parameters
    ----------
    axes : Axes
        Axes to draw on, set to equal scales.
    points : Dataset over `detection`
        Points with range, azimuth, elevation and velocity.

    Returns
    -------
    Axes
        The given axes.
    """
    level_m = points.range * np.cos(points.elevation.fillna(0.0))  # NaN for a horizontal array
    forward, lateral = level_m * np.cos(points.azimuth), level_m * np.sin(points.azimuth)
    is_moving = abs(points.velocity) > 0
    for name, is_chosen, color in (("at rest", ~is_moving, BLUE), ("moving", is_moving, ORANGE)):
        if is_chosen.any():
            axes.plot(
                lateral.values[is_chosen.values],
                forward.values[is_chosen.values],
                linestyle="",
                marker=".",
                markersize=3,
                alpha=0.5,
                color=color,
                label=f"{name}, {int(is_chosen.sum())}",
            )
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()  # positive y to the left
    axes.set_xlabel(Y_LABEL)
    axes.set_ylabel(X_LABEL)
    add_legend(axes)
    axes.set_label("Detections from above")
    return axes
