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

    def direction_components(self, n_axes: int) -> np.ndarray:
        """Return the first two or all three components of the unit vectors, (n, n_axes)."""
        horizontal = self.horizontal_direction_components(self.azimuth_rad)
        vertical = np.sin(self.elevation_rad)[:, None]
        return np.concatenate([horizontal, vertical][: n_axes - 1], axis=1)


class VelocityEstimate(NamedTuple):
    """Estimated velocity of the radar."""

    velocity: np.ndarray
    """(vx, vy) or (vx, vy, vz), m/s."""
    covariance: np.ndarray
    """(2, 2) or (3, 3)."""
    n_detections: int
    """Number of detections used."""


def static_velocity_residuals_and_variances(
    sightings: Sightings, radar_velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the excess velocity of detections over static targets, and its variance.

    (..., n) each, for a radar of velocities (..., 2) or (..., 3), broadcast against (n, 2) or
    (n, 3). Within half a period of zero; the variance is that of the errors of velocity, azimuth
    and elevation.
    """
    vx, vy = radar_velocity[..., 0], radar_velocity[..., 1]
    vz = radar_velocity[..., 2] if radar_velocity.shape[-1] == 3 else np.zeros_like(vx)
    cos_elevation, sin_elevation = np.cos(sightings.elevation_rad), np.sin(sightings.elevation_rad)
    c, s = np.cos(sightings.azimuth_rad), np.sin(sightings.azimuth_rad)
    radial, tangential = vx * c + vy * s, vy * c - vx * s
    residual = sightings.velocity_m_per_s + radial * cos_elevation + vz * sin_elevation
    residual = residual - sightings.period_m_per_s * np.rint(residual / sightings.period_m_per_s)
    variance = (
        sightings.velocity_std**2
        + (tangential * cos_elevation * sightings.azimuth_std) ** 2
        + ((vz * cos_elevation - radial * sin_elevation) * sightings.elevation_std) ** 2
    )
    return residual, variance


def fit_radar_velocity(sightings: Sightings, start_velocity: np.ndarray) -> VelocityEstimate:
    r"""Fit the velocity by least squares with errors in velocities and in azimuths.

    The condition :math:`v_i + u(\phi_i) \cdot V = 0` holds for adjusted velocities and azimuths;
    the sum of squared adjustments over their variances is minimised. A fit without errors in
    azimuth would bias V towards the middle of the azimuths.

    If residuals exceed their errors, a common variance is added to all velocities such that they
    agree: that of unknown heights and of cells with several targets. The covariance includes it.
    A velocity of three components is fitted with errors in elevations, too.

    Parameters
    ----------
    sightings : Sightings
        More than the components, in different directions.
    start_velocity : array (2,) or (3,)
        A velocity nearby, which resolves the velocity ambiguity.

    References
    ----------
    W. E. Deming, Statistical Adjustment of Data (1943). R. C. Paule and J. Mandel, Consensus
    values and weighting factors, Journal of Research of the NBS 87(5), 1982.
    """
    n, n_axes = sightings.azimuth_rad.size, len(start_velocity)
    start_residual, _ = static_velocity_residuals_and_variances(sightings, start_velocity)
    radial = start_residual - sightings.direction_components(n_axes) @ start_velocity  # unambiguous
    adjusted, velocity, extra = sightings, start_velocity, 0.0
    for _ in range(_MAX_STEPS):
        azimuth, elevation = adjusted.azimuth_rad, adjusted.elevation_rad
        towards = adjusted.direction_components(n_axes)
        across = adjusted.horizontal_direction_components(azimuth + np.pi / 2) @ velocity[:2]
        corrected = radial + across * (sightings.azimuth_rad - azimuth)
        if n_axes == 3:
            upward = adjusted._replace(elevation_rad=elevation + np.pi / 2)
            rise = upward.direction_components(3) @ velocity
            corrected = corrected + rise * (sightings.elevation_rad - elevation)
        _, variance = static_velocity_residuals_and_variances(adjusted, velocity)
        weight = 1 / (variance + extra)
        normal = (towards.T * weight) @ towards
        previous, velocity = velocity, -np.linalg.solve(normal, towards.T @ (weight * corrected))
        residual = corrected + towards @ velocity
        # A Newton step towards n minus the components, the mean of the sum if all errors are known.
        excess = np.sum(weight * residual**2) - (n - n_axes)
        slowing = np.sum((weight * residual) ** 2)
        extra = max(extra + excess / slowing, 0.0) if slowing > 0 else 0.0
        pull = residual * weight
        adjusted = adjusted._replace(
            azimuth_rad=sightings.azimuth_rad - sightings.azimuth_std**2 * across * pull
        )
        if n_axes == 3:
            adjusted = adjusted._replace(
                elevation_rad=sightings.elevation_rad - sightings.elevation_std**2 * rise * pull
            )
        if abs(velocity - previous).max() < _CONVERGED_M_PER_S:
            break
    return VelocityEstimate(velocity, np.linalg.inv(normal), n)
