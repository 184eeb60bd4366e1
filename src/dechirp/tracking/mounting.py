"""Mounting angle of a radar, from frames in which its car drives straight on."""

import math
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from dechirp.core.checks import check_number
from dechirp.core.errors import InvalidSetting
from dechirp.tracking.ego import ego_velocity_and_covariance_columns

# Increasing errors for less would make them 9 % too large on average for ten frames.
_SCATTER_PROBABILITY = 0.95
_N_STEPS = 20  # 4 converge to 1e-12


class MountingAngle(NamedTuple):
    """Yaw angle of a radar on its car."""

    yaw_rad: float
    """Of its x axis, positive to the left of the driving direction."""
    yaw_std_rad: float
    n_frames: int
    """Number of frames used."""


def mounting_angle(ego: xr.Dataset, min_speed_m_per_s: float = 3.0) -> MountingAngle:
    """Estimate the yaw of a radar whose car drives straight forward, without sideslip.

    Then the radar moves in the heading of the car: in its own axes at minus the yaw. In a bend the
    direction differs by the yaw rate times the lever arm to the rear axle: exclude bends.

    Parameters
    ----------
    ego : Dataset over `frame`
        From `ego_motion`. Frames without a velocity, or slower than `min_speed_m_per_s`, are
        ignored.

    Returns
    -------
    Mounting
        The standard error assumes independent errors of frames; it is increased by the Birge
        ratio (1932) if they scatter more than expected at a probability of 0.05. It does not
        include errors common to all frames: an uncalibrated array appears as a mounting angle.

    Raises
    ------
    InvalidSetting
        If columns are missing, or fewer than two frames are usable.
    """
    check_number("min_speed_m_per_s", min_speed_m_per_s, above=0.0)
    motion = ego_velocity_and_covariance_columns(ego)
    is_fast = np.hypot(*motion[:2]) >= min_speed_m_per_s  # NaN is not
    if is_fast.sum() < 2:
        raise InvalidSetting(
            "ego",
            value=f"{is_fast.sum()} of {is_fast.size} frames at {min_speed_m_per_s:.4g} m/s or"
            " more",
            expected="two or more frames with a known velocity",
            fix="use frames in which the car drives straight on, among static targets",
        )
    vx, vy, vx_std, vy_std, covariance = motion[:, is_fast]
    heading = math.atan2(vy.sum(), vx.sum())
    for _ in range(_N_STEPS):
        c, s = math.cos(heading), math.sin(heading)
        sideways, forward = vy * c - vx * s, vx * c + vy * s
        variance = (vy_std * c) ** 2 + (vx_std * s) ** 2 - 2 * c * s * covariance
        information = np.sum(forward**2 / variance)
        heading += np.sum(sideways * forward / variance) / information
    scatter, n_free = float(np.sum(sideways**2 / variance)), int(is_fast.sum()) - 1
    birge = (
        scatter / n_free
        if scatter > scipy.special.chdtri(n_free, 1 - _SCATTER_PROBABILITY)
        else 1.0
    )
    yaw = math.remainder(-heading, 2 * math.pi)
    return MountingAngle(yaw, math.sqrt(birge / information), n_free + 1)
