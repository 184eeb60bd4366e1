"""Top view of detections without known targets: x upwards, y to the left."""

import math

import numpy as np
from matplotlib.axes import Axes

from dechirp.report.figures import top_view
from dechirp.report.figures.common import add_legend
from dechirp.report.figures.top_view import GroundDetections
from dechirp.report.labels import X_LABEL, Y_LABEL


def draw_detections_from_above(axes: Axes, detections: GroundDetections) -> Axes:
    """Draw the detections of an unknown scene from above.

    Parameters
    ----------
    axes : Axes
        Axes to draw on, set to equal scales.
    detections : GroundDetections
        Detections with directions, drawn with error ellipses.

    Returns
    -------
    Axes
        The given axes.
    """
    places_m = np.vstack([detections.positions_m, [[0, 0]]])
    reach_m = max(1.0, float(np.hypot(*places_m.T).max()))
    front = places_m[:, 0].max() + 0.12 * reach_m
    side = max(1.15 * abs(places_m[:, 1]).max(), 0.7 * front)
    axes.set_aspect("equal")
    axes.set(xlim=(side, -side), ylim=(-0.06 * reach_m, front))
    top_view.draw_range_rings(axes, math.hypot(front, side))
    top_view.draw_ground_detections(axes, detections)
    axes.set_xlabel(Y_LABEL)
    axes.set_ylabel(X_LABEL)
    add_legend(axes)
    axes.set_label("Detections from above")
    return axes
