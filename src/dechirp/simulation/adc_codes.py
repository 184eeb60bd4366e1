"""Integer ADC codes of quantised samples."""

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.compiled_kernels import kernel
from dechirp.core.errors import InvalidSetting

_BLOCK_SIZE = 2**20  # numbers; invalid ones are counted in 32 bits, which vectorises


@check_argument_types
def extract_adc_codes(cube: xr.DataArray) -> xr.DataArray:
    """Return the integer codes of a cube that passed through `Quantisation`: cube / scale.

    Parameters
    ----------
    cube : DataArray
        Has the attribute `scale`, which `simulate` sets if `Quantisation` is the last impairment.

    Returns
    -------
    DataArray, int16
        Has one more axis `iq`, of length 2, if the samples are complex; coordinates and attributes
        are kept. Multiplied by `scale` in the precision of the cube, it equals the cube bit by bit.

    Raises
    ------
    InvalidSetting
        If the cube has no scale, or a sample is not an integer number of steps.
    """
    if "scale" not in cube.attrs:
        raise _not_adc_codes_error()
    codes = samples_to_codes(cube.values, cube.attrs["scale"])
    dims = cube.dims if codes.ndim == cube.ndim else (*cube.dims, "iq")
    return xr.DataArray(codes, dims=dims, coords=cube.coords, name=cube.name, attrs=cube.attrs)


def has_adc_codes(cube: xr.DataArray) -> bool:
    """Return whether `extract_adc_codes` accepts a cube."""
    try:
        extract_adc_codes(cube)
    except InvalidSetting:
        return False
    return True


def samples_to_codes(samples: np.ndarray, scale: float) -> np.ndarray:
    """Convert samples to codes, int16 (...), or (..., 2) for complex samples.

    Raises
    ------
    InvalidSetting
        If a sample is not an integer number of steps.
    """
    shape = (*samples.shape, 2) if np.iscomplexobj(samples) else samples.shape
    parts = np.ascontiguousarray(samples).reshape(-1).view(samples.real.dtype)
    step = parts.dtype.type(scale)
    codes = np.empty(parts.size, np.int16)
    for start in range(0, parts.size, _BLOCK_SIZE):
        part = slice(start, start + _BLOCK_SIZE)
        if _fill_codes_and_count_invalid(parts[part], step, 1 / step, codes[part]):
            raise _not_adc_codes_error()
    return codes.reshape(shape)


def _not_adc_codes_error() -> InvalidSetting:
    return InvalidSetting(
        "cube",
        value="samples that are not ADC codes",
        expected="samples simulated with quantisation as the last impairment",
        fix="append Quantisation(bits=12, full_scale_w=1e-5) to the impairments",
    )


def _fill_codes_in_numpy(
    sample_values: np.ndarray, scale: float, inverse_scale: float, codes: np.ndarray
) -> int:
    """Plain twin of `_fill_codes_and_count_invalid`: equal codes of valid samples."""
    rounded = np.nan_to_num(np.rint(sample_values * inverse_scale))
    codes[:] = np.clip(rounded, -(2**31), 2**31 - 1).astype(np.int64).astype(np.int16)
    return int(np.count_nonzero(codes.astype(sample_values.dtype) * scale != sample_values))


@kernel(plain=_fill_codes_in_numpy)
def _fill_codes_and_count_invalid(
    sample_values: np.ndarray, scale: float, inverse_scale: float, codes: np.ndarray
) -> int:
    """Fill `codes`, and count invalid samples: beyond int16, between steps, or not finite."""
    n_invalid = np.int32(0)
    for k in range(len(codes)):
        code = np.int16(np.int32(np.rint(sample_values[k] * inverse_scale)))
        codes[k] = code
        n_invalid += np.int32(sample_values.dtype.type(code) * scale != sample_values[k])
    return int(n_invalid)
