"""Range-Doppler maps of plain arrays, without a `Radar`."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_integer
from dechirp.core.errors import InvalidSetting
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from dechirp.theory.windows import Window

__all__ = ["range_doppler_map"]

_MAX_BINS = 2**20


@check_argument_types
def range_doppler_map(
    samples: ArrayLike,
    window: Window | tuple[Window, Window] = "hann",
    *,
    n_bins: tuple[int, int] | None = None,
) -> np.ndarray:
    """Compute the range-Doppler map of beat samples, as `dechirp.power_map` does for a `Radar`.

    Parameters
    ----------
    samples : array (chirp, sample) or (channel, chirp, sample)
        One frame, real or complex; `np.moveaxis` brings other orders into this one.
    window : str or (str, str)
        Window over chirps and over samples; see `dechirp.windows.window_names`.
    n_bins : (int, int), optional
        Bins over velocity and range, for zero padding; as many as chirps and samples by default.

    Returns
    -------
    array (velocity, range)
        Mean power over the channels, in the unit of the squared samples; a tone on a bin keeps its
        power. Zero velocity is in row n_velocity // 2, receding is above it if a receding target
        has a positive Doppler frequency. Real samples give n_range // 2 + 1 ranges. Computed in
        single precision, like the map of the chain.

    Raises
    ------
    InvalidSetting
        If the samples are no finite array of two or three axes, all of them filled, a window is
        unknown, or there are fewer bins than points.
    """
    frame = _check_samples(samples)
    _, n_chirps, n_samples = frame.shape
    slow_window, fast_window = pair_of("window", window)
    n_velocity, n_range = (n_chirps, n_samples) if n_bins is None else pair_of("n_bins", n_bins)
    for n_of_axis, n_points in ((n_velocity, n_chirps), (n_range, n_samples)):
        # A single point has the same power in every bin.
        at_most = _MAX_BINS if n_points > 1 else 1
        check_integer("n_bins", n_of_axis, at_least=n_points, at_most=at_most)
    frame, exponent = scale_to_unity(frame)
    single = frame.astype(np.complex64 if np.iscomplexobj(frame) else np.float32)
    power = mean_range_doppler_power(
        single.transpose(1, 0, 2),
        "complex" if np.iscomplexobj(frame) else "real",
        Transform(window=fast_window, n_points=n_samples, n_bins=n_range),
        Transform(window=slow_window, n_points=n_chirps, n_bins=n_velocity),
    )
    return np.ldexp(power.astype(float), 2 * exponent)


def scale_to_unity(array: np.ndarray) -> tuple[np.ndarray, int]:
    """Divide an array by a power of two, exactly, so that its largest magnitude is 0.5 to 1.

    Returns the array and the exponent. Single precision ends at 1e-38: the power of an echo in
    square watts would not fit.
    """
    # Beyond -1000, the inverse of the power of two would overflow.
    exponent = max(int(np.frexp(np.max(np.abs(array), initial=0.0))[1]), -1000)
    return array * np.ldexp(1.0, -exponent), exponent


def pair_of(setting: str, value: Any) -> tuple[Any, Any]:
    """Return a pair as it is, and a single value twice."""
    if isinstance(value, tuple | list):
        if len(value) != 2:
            raise InvalidSetting(
                setting,
                value=value,
                expected="one value, or a pair for velocity and range",
                fix="give one value for both axes, or two",
            )
        return value[0], value[1]
    return value, value


def _check_samples(samples: ArrayLike) -> np.ndarray:
    """Return samples as (channel, chirp, sample), complex128 or float64."""
    array = np.asarray(samples)
    if array.dtype.kind not in "iufc" or array.ndim not in (2, 3) or array.size == 0:
        raise InvalidSetting(
            "samples",
            value=f"an array {array.shape} of {array.dtype}",
            expected="numbers over (chirp, sample) or (channel, chirp, sample)",
            fix="give one frame, with filled axes",
        )
    if not np.isfinite(array).all():
        raise InvalidSetting(
            "samples",
            value=f"{np.count_nonzero(~np.isfinite(array))} values that are not finite",
            expected="finite numbers",
            fix="set lost samples to 0: one NaN would invalidate the whole map",
        )
    array = array.astype(complex if np.iscomplexobj(array) else float)
    return array if array.ndim == 3 else array[None]
