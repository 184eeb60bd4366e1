"""Separation of tracks from detections and from each other, along and across their motion."""

import numpy as np

from dechirp.tracking.kalman_filter import StateEstimates


def is_within_separation(
    positions_m: np.ndarray, tracks: StateEstimates, along_m: float, across_m: float
) -> np.ndarray:
    r"""Return True for positions (n, 2) within the separation of any track, (n,).

    The area about a track is an ellipse, longer along the direction of motion: parts of a vehicle
    lie behind each other, its neighbours beside it. With the velocity :math:`v`, known but for its
    covariance, the shape matrix is the mean over the directions, weighted by the squared speed:

    .. math:: S = a^2 Q + b^2 (I - Q), \quad Q = E[v v^T] / E[v^T v]

    So it tends to a disc of the radius :math:`\sqrt{(a^2 + b^2) / 2}` for unknown directions.
    """
    if not len(tracks.mean):
        return np.zeros(len(positions_m), dtype=bool)
    velocity = tracks.mean[:, [1, 3]]
    moment = velocity[:, :, None] * velocity[:, None] + tracks.covariance[:, [1, 3]][..., [1, 3]]
    direction = moment / np.trace(moment, axis1=1, axis2=2)[:, None, None]
    shape_m2 = along_m**2 * direction + across_m**2 * (np.eye(2) - direction)
    offset_m = positions_m - tracks.mean[:, None, [0, 2]]
    scaled = np.linalg.solve(shape_m2[:, None], offset_m[..., None])[..., 0]
    return np.asarray((np.einsum("tni,tni->tn", offset_m, scaled) < 1).any(axis=0))
