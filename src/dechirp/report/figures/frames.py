"""Detections over time."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.report.figures.common import AXIS_LABELS, MapAxis, add_legend, draw_detection_circles
from dechirp.report.figures.style import INK

_MAX_POINTS = 1000


def draw_estimates_over_time(
    axes: Axes,
    detections: xr.Dataset,
    *,
    variable: MapAxis,
    truth: tuple[np.ndarray, np.ndarray] | None = None,
) -> Axes:
    """Draw one estimate of the detections over time, strongest first.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    detections : Dataset over `detection`
        Detections, of which at most 1000 are drawn.
    variable : range or velocity
        Estimate to draw.
    truth : times (frame,) in s, estimates (target, frame), optional
        Apparent truth, a line for each target.

    Returns
    -------
    Axes
        The given axes.
    """
    long = float(detections.time.max()) >= 1
    per_s, unit = (1.0, "s") if long else (1e3, "ms")
    if truth is not None:
        times_s, lines = truth
        for number, line in enumerate(lines):
            label = "truth" if number == 0 else None
            axes.plot(per_s * times_s, line, color=INK, linewidth=0.9, label=label)
    draw_detection_circles(
        axes,
        per_s * detections.time.values[:_MAX_POINTS],
        detections[variable].values[:_MAX_POINTS],
        size=3.5,
        width=1.0,
    )
    axes.set_xlabel(f"Time ({unit})")
    axes.set_ylabel(AXIS_LABELS[variable])
    add_legend(axes)
    axes.set_label(f"Detections over time: {variable}")
    return axes
