"""The angle at which a radar is mounted, from frames in which its car drives straight on."""

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.special import chdtri

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.tracking.motion import motions

_BY_CHANCE = 0.95  # raising errors for less makes them 9 % too large where ten frames are right
_STEPS = 20  # each takes off most of what is left; 4 are enough to 1e-12


class Mounting(NamedTuple):
    """How a radar looks."""

    yaw_rad: float
    """Of its x axis, to the left of where the car drives."""
    yaw_std_rad: float
    n_frames: int
    """Frames that it rests on."""


def mounting(ego: xr.Dataset, min_speed_m_per_s: float = 3.0) -> Mounting:
    """Yaw of a radar whose car drives straight forward, without sideslip.

    Then the radar moves where the car is heading: in its own axes at minus the yaw. In a bend it
    does not, by the yaw rate times its way ahead of the rear axle: leave bends out.

    Parameters
    ----------
    ego : Dataset over `frame`
        From `ego_motion`. Frames without a velocity, or slower than `min_speed_m_per_s`, do not
        count.

    Returns
    -------
    Mounting
        The standard error is that of frames whose errors are independent, raised where they
        scatter more than they say, beyond what chance does once in twenty times (Birge 1932).
        What is wrong alike in all frames it does not tell: an array that is not calibrated is a
        mounting angle.

    Raises
    ------
    InvalidSetting
        If columns are missing, or fewer than two frames count.
    """
    number("min_speed_m_per_s", min_speed_m_per_s, above=0.0)
    known = motions(ego)
    fast = np.hypot(*known[:2]) >= min_speed_m_per_s  # NaN is not
    if fast.sum() < 2:
        raise InvalidSetting(
            "ego",
            got=f"{fast.sum()} of {fast.size} frames at {min_speed_m_per_s:.4g} m/s or more",
            need="two or more whose velocity is known",
            fix="Take frames in which the car drives straight on, among things that stand still.",
        )
    vx, vy, vx_std, vy_std, covariance = known[:, fast]
    heading = math.atan2(vy.sum(), vx.sum())
    for _ in range(_STEPS):
        c, s = math.cos(heading), math.sin(heading)
        across, along = vy * c - vx * s, vx * c + vy * s
        variance = (vy_std * c) ** 2 + (vx_std * s) ** 2 - 2 * c * s * covariance
        information = np.sum(along**2 / variance)
        heading += np.sum(across * along / variance) / information
    scatter, n_free = float(np.sum(across**2 / variance)), int(fast.sum()) - 1
    birge = scatter / n_free if scatter > chdtri(n_free, 1 - _BY_CHANCE) else 1.0
    yaw = math.remainder(-heading, 2 * math.pi)
    return Mounting(yaw, math.sqrt(birge / information), n_free + 1)
