"""The table of how the radar moves, frame by frame."""

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting

UNITS = {"vx": "m/s", "vy": "m/s", "vx_std": "m/s", "vy_std": "m/s", "vx_vy_covariance": "m2/s2"}


def motions(ego: xr.Dataset) -> np.ndarray:
    """Its columns in the order of `UNITS`, (5, n_frames), or `InvalidSetting` where there are none.

    NaN where the motion is not known.
    """
    got = None
    if not isinstance(ego, xr.Dataset):
        got = f"a {type(ego).__name__}"
    elif missing := [name for name in ("frame", *UNITS) if name not in ego]:
        got = f"without {', '.join(missing)}"
    if got is not None:
        raise InvalidSetting(
            "ego", got=got, need="the motion of each frame", fix="Give what `ego_motion` returns."
        )
    return np.array([ego[name].values for name in UNITS], dtype=float)
