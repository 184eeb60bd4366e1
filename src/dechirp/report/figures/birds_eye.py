"""Seen from above, x forward up the page and y to the left: the radar, and what it found."""

import math

import numpy as np
from matplotlib.axes import Axes

from dechirp.report.figures import ground
from dechirp.report.figures.ground import Seen
from dechirp.report.figures.parts import legend


def from_above(axes: Axes, seen: Seen) -> Axes:
    """Draw what was found of a scene that is not known.

    Parameters
    ----------
    axes : Axes
        To draw on; a meter is equally long along both.
    seen : Seen
        Detections with directions: places, with ellipses of their errors.

    Returns
    -------
    Axes
        Those given.
    """
    places_m = np.vstack([seen.places_m, [[0, 0]]])
    reach_m = max(1.0, float(np.hypot(*places_m.T).max()))
    front = places_m[:, 0].max() + 0.12 * reach_m
    side = max(1.15 * abs(places_m[:, 1]).max(), 0.7 * front)
    axes.set_aspect("equal")
    axes.set(xlim=(side, -side), ylim=(-0.06 * reach_m, front))
    ground.rings(axes, math.hypot(front, side))
    ground.detections(axes, seen)
    axes.set_xlabel(ground.SIDE)
    axes.set_ylabel(ground.FORWARD)
    legend(axes)
    axes.set_label("Detections from above")
    return axes
