"""Samples as the whole numbers that a converter gives."""

import numba
import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting

_AT_ONCE = 2**20  # numbers; what is wrong is counted in 32 bits, for vectors of them


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
        they were. Times `scale`, in the precision of the cube, it is the cube bit by bit.

    Raises
    ------
    InvalidSetting
        If the cube has no scale, or samples that are no whole number of steps.
    """
    if "scale" not in cube.attrs:
        raise _no_codes()
    made = whole_numbers(cube.values, cube.attrs["scale"])
    dims = cube.dims if made.ndim == cube.ndim else (*cube.dims, "iq")
    return xr.DataArray(made, dims=dims, coords=cube.coords, name=cube.name, attrs=cube.attrs)


def is_coded(cube: xr.DataArray) -> bool:
    """Whether `codes` would give them."""
    try:
        codes(cube)
    except InvalidSetting:
        return False
    return True


def whole_numbers(samples: np.ndarray, scale: float) -> np.ndarray:
    """Codes of samples, int16 (...) or of complex ones (..., 2); raises as `codes`."""
    shape = (*samples.shape, 2) if np.iscomplexobj(samples) else samples.shape
    parts = np.ascontiguousarray(samples).reshape(-1).view(samples.real.dtype)
    step = parts.dtype.type(scale)
    made = np.empty(parts.size, np.int16)
    for start in range(0, parts.size, _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        if _rounded(parts[part], step, 1 / step, made[part]):
            raise _no_codes()
    return made.reshape(shape)


def _no_codes() -> InvalidSetting:
    return InvalidSetting(
        "cube",
        got="samples that are no codes of a converter",
        need="simulated with quantisation as the last of the impairments",
        fix="Add Quantisation(bits=12, full_scale_w=1e-5), in the end.",
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _rounded(parts: np.ndarray, scale: float, per_scale: float, codes: np.ndarray) -> int:
    """Fill in the codes; count samples that are none: beyond int16, between steps, not finite."""
    n_wrong = np.int32(0)
    for k in range(len(codes)):
        code = np.int16(np.int32(np.rint(parts[k] * per_scale)))
        codes[k] = code
        n_wrong += np.int32(parts.dtype.type(code) * scale != parts[k])
    return int(n_wrong)
