"""Radar cubes: labelled samples, simulated or recorded."""

from functools import lru_cache
from typing import Literal

import numpy as np
import xarray as xr

from dechirp.core.conventions import (
    CUBE_AXES,
    axis_coordinate,
    chirp_time_coordinate,
    labelled_array,
    labelled_variable,
    transmitter_coordinate,
)
from dechirp.core.display import describe_class
from dechirp.core.errors import InvalidSetting
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


def label_cube(
    samples: np.ndarray,
    radar: Radar,
    *,
    units: Literal["W**0.5", "1"],
    first_frame: int = 0,
) -> xr.DataArray:
    """Label samples (frame, chirp, rx, sample) with the times of the radar, without copying.

    Coordinates: start of each frame and chirp, and of each sample from the start of the ramp, all
    in s; `transmitter` along `chirp` where transmitters take turns. `first_frame` is the number
    of the first frame. Where intervals differ between frames, `chirp` counts chirps and
    `chirp_time` holds the start of each chirp in each frame.
    """
    frame = radar.frame
    frame_numbers = range(first_frame, first_frame + len(samples))
    starts_s = np.array([frame.frame_start_s(number) for number in frame_numbers])
    frame_variables = {"frame": axis_coordinate("frame", starts_s)}
    if frame.n_intervals > 1:
        frame_variables["chirp_time"] = chirp_time_coordinate(
            np.array([frame.for_frame(number).chirp_starts_s for number in frame_numbers])
        )
    attributes = {"units": units, "convention": "beat = Tx x conj(Rx), receding positive"}
    return labelled_array(
        labelled_variable(CUBE_AXES, samples, attributes),
        xr.Coordinates(frame_variables),
        _coordinates_in_frame(frame, *samples.shape[1:]),
        name="cube",
    )


@lru_cache(maxsize=8)  # 0.6 ms
def _coordinates_in_frame(frame: Frame, n_chirps: int, n_rx: int, n_samples: int) -> xr.Coordinates:
    """Return the coordinates that do not change from frame to frame."""
    variables = {}
    if frame.n_intervals == 1:
        variables["chirp"] = axis_coordinate("chirp", frame.chirp_starts_s)
    else:
        variables["chirp"] = labelled_variable(("chirp",), np.arange(n_chirps), {"units": "1"})
    if frame.tdm_order is not None:
        variables["transmitter"] = transmitter_coordinate(frame.tdm_order, n_chirps)
    chirp = frame.chirp
    sample_times_s = chirp.adc_start_s + np.arange(n_samples) / chirp.sample_rate_hz
    variables["rx"] = axis_coordinate("rx", np.arange(n_rx))
    variables["sample"] = axis_coordinate("sample", sample_times_s)
    return xr.Coordinates(variables)


def check_cube_fits_radar(cube: xr.DataArray, radar: Radar) -> None:
    """Raise `InvalidSetting` unless the radar could have taken the cube, one frame or more."""
    if isinstance(cube, xr.DataArray) and set(cube.dims) == set(CUBE_AXES[1:]):
        raise InvalidSetting(
            "cube",
            value=f"one frame, over {', '.join(map(str, cube.dims))}",
            expected=f"an array over {', '.join(CUBE_AXES)}",
            fix='keep the axis frame with isel(frame=[0]), or add it with expand_dims("frame")',
        )
    _check_axes_and_sizes(cube, radar, CUBE_AXES)
    if not cube.sizes["frame"]:
        raise InvalidSetting(
            "cube", value="0 frames", expected="1 or more", fix="pass a cube that has frames"
        )


def select_only_frame(cube: xr.DataArray, radar: Radar) -> xr.DataArray:
    """Return a frame (chirp, rx, sample), in any order, of a cube with or without a frame axis.

    Raises `InvalidSetting` unless the cube has one frame that the radar could have taken.
    """
    if isinstance(cube, xr.DataArray) and "frame" in cube.dims:
        if (n_frames := cube.sizes["frame"]) != 1:
            raise InvalidSetting(
                "cube",
                value=f"{n_frames} frames",
                expected="one frame, without the axis frame or with one of length 1",
                fix="select one with isel(frame=0)" if n_frames else "pass a cube that has frames",
            )
        cube = cube.drop_vars("frame", errors="ignore").isel(frame=0)
    _check_axes_and_sizes(cube, radar, CUBE_AXES[1:])
    return cube


def _check_axes_and_sizes(cube: xr.DataArray, radar: Radar, axes: tuple[str, ...]) -> None:
    chirp = radar.frame.chirp
    if not isinstance(cube, xr.DataArray):
        raise InvalidSetting(
            "cube",
            value=describe_class(type(cube)),
            expected=f"an xarray.DataArray over {', '.join(axes)}",
            fix="name its axes: xarray.DataArray(array, dims=(...))",
        )
    if set(cube.dims) != set(axes):
        raise InvalidSetting(
            "cube",
            value=f"an array over {', '.join(map(str, cube.dims))}",
            expected=f"an array over {', '.join(axes)}",
            fix="rename its axes, and add missing ones of length 1 with expand_dims",
        )
    sizes = {"chirp": radar.frame.n_chirps_total, "rx": radar.array.n_rx, "sample": chirp.n_samples}
    for name, size in sizes.items():
        if cube.sizes[name] != size:
            raise InvalidSetting(
                "cube",
                value=f"{cube.sizes[name]} along {name}",
                expected=f"{size}, as the radar has",
                fix="pass the radar that the cube was taken with",
            )
    check_samples_complex_or_real(chirp, cube, setting="cube")


def check_samples_complex_or_real(
    chirp: Chirp, samples: np.ndarray | xr.DataArray, *, setting: str
) -> None:
    """Check that samples are complex or real as the chirp specifies."""
    if np.iscomplexobj(samples) != (chirp.sampling == "complex"):
        raise InvalidSetting(
            setting,
            value=f"samples of type {samples.dtype}",
            expected=f"{chirp.sampling} samples, as the chirp specifies",
            fix="set the chirp's sampling to that of the converter",
        )
