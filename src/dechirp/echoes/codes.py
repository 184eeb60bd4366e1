"""Samples as the whole numbers that a converter gives."""

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting

# Codes are at most 2^15, float32 is right to 2^-24 of that: 0.004. What is no code is far off.
_OFF = 0.02


def codes(cube: xr.DataArray) -> xr.DataArray:
    """Whole numbers of a cube that went through `Quantisation`, cube / scale.

    Parameters
    ----------
    cube : DataArray
        With the attribute `scale`, as `simulate` gives it where `Quantisation` comes last.

    Returns
    -------
    DataArray, int16
        With one more axis `iq`, of 2, where samples are complex; coordinates and attributes as
        they were. Times `scale`, it is the cube.

    Raises
    ------
    InvalidSetting
        If the cube has no scale, or samples that are no whole number of steps.
    """
    made = _codes(cube)
    if made is None:
        raise InvalidSetting(
            "cube",
            got="samples that are no codes of a converter",
            need="simulated with quantisation as the last of the impairments",
            fix="Add Quantisation(bits=12, full_scale_w=1e-5), in the end.",
        )
    return made


def is_coded(cube: xr.DataArray) -> bool:
    """Whether `codes` would give them."""
    return _codes(cube) is not None


def _codes(cube: xr.DataArray) -> xr.DataArray | None:
    if "scale" not in cube.attrs:
        return None
    steps = cube.values / cube.attrs["scale"]
    dims = cube.dims
    if np.iscomplexobj(steps):
        parts = np.ascontiguousarray(steps).view(steps.real.dtype)
        steps, dims = parts.reshape(*steps.shape, 2), (*dims, "iq")
    whole = np.rint(steps)
    if np.abs(steps - whole).max(initial=0) > _OFF or np.abs(whole + 0.5).max(initial=0) > 2**15:
        return None
    return xr.DataArray(
        whole.astype(np.int16), dims=dims, coords=cube.coords, name=cube.name, attrs=cube.attrs
    )
