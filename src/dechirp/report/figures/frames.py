"""Detections from frame to frame."""

from typing import Literal

import numpy as np
import xarray as xr
from markupsafe import Markup
from matplotlib.figure import Figure

from dechirp.report.figures.style import INK, ORANGE, draw

Variable = Literal["range", "velocity"]

_MOST_POINTS = 1000
_LABELS: dict[Variable, str] = {
    "range": "range, m",
    "velocity": "velocity, m/s (receding positive)",
}


def over_time(
    detections: xr.Dataset,
    *,
    variable: Variable,
    truth: tuple[np.ndarray, np.ndarray] | None = None,
) -> Markup:
    """Draw one estimate of the detections, strongest first, over time.

    Parameters
    ----------
    detections : Dataset over `detection`
        At most 1000 of them are drawn.
    variable : range or velocity
        What is drawn.
    truth : times (frame,) in s, estimates (target, frame), optional
        What a perfect detector reports; a line for each target.
    """
    long = float(detections.time.max()) >= 1
    per_s, unit = (1.0, "s") if long else (1e3, "ms")

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        if truth is not None:
            times_s, lines = truth
            for number, line in enumerate(lines):
                label = "truth" if number == 0 else None
                axes.plot(per_s * times_s, line, color=INK, linewidth=0.9, label=label)
        axes.plot(
            per_s * detections.time.values[:_MOST_POINTS],
            detections[variable].values[:_MOST_POINTS],
            linestyle="",
            marker="o",
            markersize=3.5,
            markerfacecolor="none",
            markeredgecolor=ORANGE,
            label="detection",
        )
        axes.set_xlabel(f"time, {unit}")
        axes.set_ylabel(_LABELS[variable])
        figure.legend(loc="outside upper right", ncols=2, handlelength=1.4)

    return draw(paint, label=f"Detections over time: {variable}", height_in=3.0)
