"""A track's first state, from one detection."""

import numpy as np

from dechirp.tracking.measured import Measured


def first_states(frame: Measured, speed_std_m_per_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, 4) and covariances (n, 4, 4) of x, vx, y, vy.

    Along the line of sight the range and its rate; across, the azimuth and any velocity. A speed
    v across is seen along by an azimuth error d as v d, so the rate's error grows by that. A rate
    of unknown fold tells nothing where 4 standard deviations of speed exceed half a span.
    """
    azimuth, range_m, rate = frame.seen.T
    azimuth_variance, range_variance, rate_variance = frame.variance.T
    told = np.isfinite(rate) & (4 * speed_std_m_per_s < frame.span_m_per_s / 2)
    speed_variance = speed_std_m_per_s**2
    along = np.where(told, rate, 0.0)
    along_variance = np.where(
        told, rate_variance + speed_variance * azimuth_variance, speed_variance
    )
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.zeros((len(range_m), 4, 4))  # x vx y vy from along, its rate, across, its rate
    turn[:, [0, 1, 2, 3], [0, 1, 2, 3]] = cos[:, None]
    turn[:, [0, 1], [2, 3]], turn[:, [2, 3], [0, 1]] = -sin[:, None], sin[:, None]
    still = np.zeros_like(range_m)
    mean = np.stack([range_m, along, still, still], axis=-1)
    variance = np.stack(
        [
            range_variance,
            along_variance,
            range_m**2 * azimuth_variance,
            np.full_like(range_m, speed_variance),
        ],
        axis=-1,
    )
    return (
        np.einsum("nij,nj->ni", turn, mean),
        np.einsum("nij,nj,nkj->nik", turn, variance, turn),
    )
