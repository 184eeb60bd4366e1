"""Flash of a straight line or face: the point of it that reflects like a mirror."""

import numpy as np
import scipy

FLASH_SPACING_M = 0.5
"""Spacing of the points of which one flashes."""
_MIN_SHARE = 1e-4  # echoes of ends that are 40 dB weaker are left out


def flash_shares(
    points_m: np.ndarray,
    foot_m: np.ndarray,
    distance_m: np.ndarray,
    *,
    half_length_m: float,
    wavelength_m: float,
) -> np.ndarray:
    r"""Return the share that each point of a line has in the reflection of a line without ends.

    The point nearest to the foot of the perpendicular from the radar has all of it, as echoes of
    several points would add up with their phases. By physical optics, the phase along the line
    grows with the square of the distance from the foot, so that the power is

    .. math:: \frac{1}{2} |F(u_2) - F(u_1)|^2, \quad u = 2 s / \sqrt{\lambda d}

    with the Fresnel integral F = C + j S, both ends at the distances s from the foot, and the radar
    at the distance d: 1/4 abreast of an end, 1 far from both.

    Parameters
    ----------
    points_m : array (n_points,)
        Positions of the points along the line, from its middle.
    foot_m, distance_m : array (n_positions,)
        Foot of the perpendicular along the line, and distance of the radar from it.

    Returns
    -------
    array (n_positions, n_points)
        Shares below 1e-4 are 0.

    References
    ----------
    E. F. Knott, J. F. Shaeffer, M. T. Tuley, Radar Cross Section, 2nd ed. (2004), 5.
    M. Born, E. Wolf, Principles of Optics, 7th ed. (1999), 8.7 (Fresnel integrals).
    """
    scale_m = np.sqrt(wavelength_m * np.maximum(distance_m, wavelength_m)) / 2
    ends = (np.array([[-half_length_m], [half_length_m]]) - foot_m) / scale_m
    sine, cosine = scipy.special.fresnel(ends)
    share = (np.diff(cosine, axis=0)[0] ** 2 + np.diff(sine, axis=0)[0] ** 2) / 2
    nearest = np.abs(points_m - foot_m[:, None]).argmin(axis=1)
    shares = np.zeros((len(foot_m), len(points_m)))
    shares[np.arange(len(foot_m)), nearest] = np.where(share > _MIN_SHARE, share, 0.0)
    return shares
