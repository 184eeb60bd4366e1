"""Least-squares fit of the radar's velocity to the Doppler velocities of static detections."""

from typing import NamedTuple

import numpy as np

_MAX_STEPS = 30  # of the fit, at most; 5 to 10 are enough
_CONVERGED_M_PER_S = 1e-9


class Sightings(NamedTuple):
    """Detections of one frame as seen from the radar, (n,) each; m/s and rad."""

    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    """0 where unknown."""
    velocity_std: np.ndarray
    azimuth_std: np.ndarray
    elevation_std: np.ndarray
    period_m_per_s: np.ndarray
    """Period with which the velocity repeats."""

    def select_detections(self, rows: np.ndarray) -> "Sightings":
        """Return the sightings of a mask or of indices."""
        return Sightings(*(column[rows] for column in self))

    def horizontal_direction_components(self, azimuth_rad: np.ndarray) -> np.ndarray:
        """Return the horizontal part of the unit vectors at azimuths, (n, 2)."""
        directions = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)], axis=-1)
        return np.asarray(np.cos(self.elevation_rad)[:, None] * directions)


class VelocityEstimate(NamedTuple):
    """Estimated velocity of the radar."""

    velocity: np.ndarray
    """(vx, vy), m/s."""
    covariance: np.ndarray
    """(2, 2)."""
    n_detections: int
    """Number of detections used."""


def static_velocity_residuals_and_variances(
    sightings: Sightings, radar_velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the excess velocity of detections over static targets, and its variance.

    (..., n) each, for a radar of velocities (..., 2), broadcast against (n, 2). Within half a
    period of zero; the variance is that of the errors of velocity, azimuth and elevation.
    """
    vx, vy = radar_velocity[..., 0], radar_velocity[..., 1]
    c, s = np.cos(sightings.azimuth_rad), np.sin(sightings.azimuth_rad)
    radial, tangential = vx * c + vy * s, vy * c - vx * s
    residual = sightings.velocity_m_per_s + radial * np.cos(sightings.elevation_rad)
    residual = residual - sightings.period_m_per_s * np.rint(residual / sightings.period_m_per_s)
    variance = (
        sightings.velocity_std**2
        + (tangential * np.cos(sightings.elevation_rad) * sightings.azimuth_std) ** 2
        + (radial * np.sin(sightings.elevation_rad) * sightings.elevation_std) ** 2
    )
    return residual, variance


def fit_radar_velocity(sightings: Sightings, start_velocity: np.ndarray) -> VelocityEstimate:
    r"""Fit the velocity by least squares with errors in velocities and in azimuths.

    The condition :math:`v_i + u(\phi_i) \cdot V = 0` holds for adjusted velocities and azimuths;
    the sum of squared adjustments over their variances is minimised. A fit without errors in
    azimuth would bias V towards the middle of the azimuths.

    If residuals exceed their errors, a common variance is added to all velocities such that they
    agree: that of unknown heights and of cells with several targets. The covariance includes it.

    Parameters
    ----------
    sightings : Sighted
        Three or more, in two directions.
    start_velocity : array (2,)
        A velocity nearby, which resolves the velocity ambiguity.

    References
    ----------
    W. E. Deming, Statistical Adjustment of Data (1943). R. C. Paule and J. Mandel, Consensus
    values and weighting factors, Journal of Research of the NBS 87(5), 1982.
    """
    n = sightings.azimuth_rad.size
    start_residual, _ = static_velocity_residuals_and_variances(sightings, start_velocity)
    radial_part = sightings.horizontal_direction_components(sightings.azimuth_rad) @ start_velocity
    radial = start_residual - radial_part  # unambiguous
    azimuth, velocity, extra = sightings.azimuth_rad, start_velocity, 0.0
    for _ in range(_MAX_STEPS):
        adjusted = sightings._replace(azimuth_rad=azimuth)
        towards = adjusted.horizontal_direction_components(azimuth)
        slope = adjusted.horizontal_direction_components(azimuth + np.pi / 2) @ velocity
        _, variance = static_velocity_residuals_and_variances(adjusted, velocity)
        weight = 1 / (variance + extra)
        corrected = radial + slope * (sightings.azimuth_rad - azimuth)
        normal = (towards.T * weight) @ towards
        previous, velocity = velocity, -np.linalg.solve(normal, towards.T @ (weight * corrected))
        residual = corrected + towards @ velocity
        # A Newton step towards n - 2, the mean of the sum if all errors are known.
        excess, slowing = np.sum(weight * residual**2) - (n - 2), np.sum((weight * residual) ** 2)
        extra = max(extra + excess / slowing, 0.0) if slowing > 0 else 0.0
        azimuth = sightings.azimuth_rad - sightings.azimuth_std**2 * slope * residual * weight
        if abs(velocity - previous).max() < _CONVERGED_M_PER_S:
            break
    return VelocityEstimate(velocity, np.linalg.inv(normal), n)
