"""Track initiation: the first state of a track from one detection."""

import numpy as np

from dechirp.tracking.measurements import Measurements


def initial_states(frame: Measurements, speed_std_m_per_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute means (n, 4) and covariances (n, 4, 4) of x, vx, y, vy.

    Along the line of sight from range and range rate; across it from the azimuth and an unknown
    velocity. A speed v across and an azimuth error d change the rate by v d, which adds to its
    error. An ambiguous rate is ignored if 4 standard deviations of speed exceed half a span.
    """
    azimuth, range_m, rate = frame.z.T
    azimuth_variance, range_variance, rate_variance = frame.variance.T
    has_rate = np.isfinite(rate) & (4 * speed_std_m_per_s < frame.span_m_per_s / 2)
    speed_variance = speed_std_m_per_s**2
    radial_speed = np.where(has_rate, rate, 0.0)
    radial_variance = np.where(
        has_rate, rate_variance + speed_variance * azimuth_variance, speed_variance
    )
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    rotation = np.zeros(
        (len(range_m), 4, 4)
    )  # x vx y vy from radial and tangential position and speed
    rotation[:, [0, 1, 2, 3], [0, 1, 2, 3]] = cos[:, None]
    rotation[:, [0, 1], [2, 3]], rotation[:, [2, 3], [0, 1]] = -sin[:, None], sin[:, None]
    zeros = np.zeros_like(range_m)
    mean = np.stack([range_m, radial_speed, zeros, zeros], axis=-1)
    variance = np.stack(
        [
            range_variance,
            radial_variance,
            range_m**2 * azimuth_variance,
            np.full_like(range_m, speed_variance),
        ],
        axis=-1,
    )
    return (
        np.einsum("nij,nj->ni", rotation, mean),
        np.einsum("nij,nj,nkj->nik", rotation, variance, rotation),
    )
