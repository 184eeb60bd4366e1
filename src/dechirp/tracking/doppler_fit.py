"""The velocity of the radar by which detections that stand still have the velocities they have."""

from typing import NamedTuple

import numpy as np

_STEPS = 30  # of the fit, at most; 5 to 10 are enough
_CLOSE_M_PER_S = 1e-9


class Sighted(NamedTuple):
    """Detections of one frame, (n,) each; m/s and rad."""

    velocity_m_per_s: np.ndarray
    azimuth_rad: np.ndarray
    elevation_rad: np.ndarray
    """0 where it is not told."""
    velocity_std: np.ndarray
    azimuth_std: np.ndarray
    elevation_std: np.ndarray
    period_m_per_s: np.ndarray
    """After which its velocity goes round."""

    def of(self, rows: np.ndarray) -> "Sighted":
        """Some of them."""
        return Sighted(*(column[rows] for column in self))

    def towards(self, azimuth_rad: np.ndarray) -> np.ndarray:
        """Level part of the unit vectors towards them, (n, 2)."""
        directions = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)], axis=-1)
        return np.asarray(np.cos(self.elevation_rad)[:, None] * directions)


class Fit(NamedTuple):
    """A velocity of the radar."""

    velocity: np.ndarray
    """(vx, vy), m/s."""
    covariance: np.ndarray
    """(2, 2)."""
    n: int
    """Detections that it rests on."""


def residuals(sighted: Sighted, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much faster detections recede than if they stood still, and its variance.

    (..., n) each, for a radar of velocities (..., 2), broadcast against (n, 2). Within half a
    period of zero; the variance is that of the errors of velocity, azimuth and elevation.
    """
    vx, vy = velocity[..., 0], velocity[..., 1]
    c, s = np.cos(sighted.azimuth_rad), np.sin(sighted.azimuth_rad)
    along, across = vx * c + vy * s, vy * c - vx * s
    off = sighted.velocity_m_per_s + along * np.cos(sighted.elevation_rad)
    off = off - sighted.period_m_per_s * np.rint(off / sighted.period_m_per_s)
    variance = (
        sighted.velocity_std**2
        + (across * np.cos(sighted.elevation_rad) * sighted.azimuth_std) ** 2
        + (along * np.sin(sighted.elevation_rad) * sighted.elevation_std) ** 2
    )
    return off, variance


def fit(sighted: Sighted, about: np.ndarray) -> Fit:
    r"""Least squares with errors in velocities and in azimuths, for detections that stand still.

    What holds without errors, :math:`v_i + u(\phi_i) \cdot V = 0`, is made to hold of adjusted
    velocities and azimuths, the squares of whose adjustments, over their variances, are least.
    A fit without errors in azimuth would pull V towards the middle of the azimuths.

    Where residuals are larger than their errors say, as much variance is added to all
    velocities as makes them agree: that of heights and of cells that several share. The
    covariance holds with it.

    Parameters
    ----------
    sighted : Sighted
        Three or more, in two directions.
    about : array (2,)
        A velocity near, by which folds are told.

    References
    ----------
    W. E. Deming, Statistical Adjustment of Data (1943). R. C. Paule and J. Mandel, Consensus
    values and weighting factors, Journal of Research of the NBS 87(5), 1982.
    """
    n = sighted.azimuth_rad.size
    off, _ = residuals(sighted, about)
    along = sighted.towards(sighted.azimuth_rad) @ about
    radial = off - along  # unfolded
    azimuth, velocity, extra = sighted.azimuth_rad, about, 0.0
    for _ in range(_STEPS):
        at = sighted._replace(azimuth_rad=azimuth)
        towards = at.towards(azimuth)
        slope = at.towards(azimuth + np.pi / 2) @ velocity
        _, variance = residuals(at, velocity)
        weight = 1 / (variance + extra)
        shown = radial + slope * (sighted.azimuth_rad - azimuth)
        normal = (towards.T * weight) @ towards
        before, velocity = velocity, -np.linalg.solve(normal, towards.T @ (weight * shown))
        left = shown + towards @ velocity
        # A step of Newton towards n - 2, the mean of what is summed if all errors are told.
        excess, slowing = np.sum(weight * left**2) - (n - 2), np.sum((weight * left) ** 2)
        extra = max(extra + excess / slowing, 0.0) if slowing > 0 else 0.0
        azimuth = sighted.azimuth_rad - sighted.azimuth_std**2 * slope * left * weight
        if abs(velocity - before).max() < _CLOSE_M_PER_S:
            break
    return Fit(velocity, np.linalg.inv(normal), n)
