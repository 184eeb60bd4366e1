"""Detections from frame to frame."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from dechirp.report.figures.parts import MAP_AXES, Axis, circles, legend
from dechirp.report.figures.style import INK

_MOST_POINTS = 1000


def over_time(
    axes: Axes,
    detections: xr.Dataset,
    *,
    variable: Axis,
    truth: tuple[np.ndarray, np.ndarray] | None = None,
) -> Axes:
    """Draw one estimate of the detections, strongest first, over time.

    Parameters
    ----------
    axes : Axes
        To draw on.
    detections : Dataset over `detection`
        At most 1000 of them are drawn.
    variable : range or velocity
        What is drawn.
    truth : times (frame,) in s, estimates (target, frame), optional
        What a perfect detector reports; a line for each target.

    Returns
    -------
    Axes
        Those given.
    """
    long = float(detections.time.max()) >= 1
    per_s, unit = (1.0, "s") if long else (1e3, "ms")
    if truth is not None:
        times_s, lines = truth
        for number, line in enumerate(lines):
            label = "truth" if number == 0 else None
            axes.plot(per_s * times_s, line, color=INK, linewidth=0.9, label=label)
    circles(
        axes,
        per_s * detections.time.values[:_MOST_POINTS],
        detections[variable].values[:_MOST_POINTS],
        size=3.5,
        width=1.0,
    )
    axes.set_xlabel(f"time, {unit}")
    axes.set_ylabel(MAP_AXES[variable])
    legend(axes)
    axes.set_label(f"Detections over time: {variable}")
    return axes
