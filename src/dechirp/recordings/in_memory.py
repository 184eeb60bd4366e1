"""Recordings made from a cube in memory."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import cast

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import InvalidSetting
from dechirp.core.units import SAMPLE_UNITS, current_units
from dechirp.radar.cube import check_samples_complex_or_real
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, Units
from dechirp.recordings.recording import Recording


@check_argument_types
def recording_from_cube(
    cube: xr.DataArray,
    radar: Radar,
    *,
    tables: Mapping[str, xr.Dataset] = MappingProxyType({}),
    name: str = "memory",
) -> Recording:
    """Wrap samples in memory as a recording that can be written, processed or read frame by frame.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        As `simulate` or `labelled_cube` returns it, with any order of axes; not copied.
    radar : Radar
        The radar that recorded it.
    tables : mapping
        Tables to keep with it, by name, as `truth` and `detections`.
    name : str
        Replaces the path in messages.

    Raises
    ------
    InvalidSetting
        If it is not a cube, or does not match the radar.
    """
    _check_cube_axes(cube)
    samples = cube.transpose(*CUBE_AXES).values
    check_samples_complex_or_real(radar.frame.chirp, samples, setting="cube")
    frame = radar.frame
    expected_shape = (frame.n_chirps_total, radar.array.n_rx, frame.chirp.n_samples)
    units = current_units(cube.attrs.get("units"))
    if samples.shape[1:] != expected_shape or not len(samples) or units not in SAMPLE_UNITS:
        raise InvalidSetting(
            "cube",
            value=f"{len(samples)} frames of {samples.shape[1:]} in units of {units!r}",
            expected=f"at least one, of {expected_shape} (chirp, rx, sample), as in the"
            f" radar, in {' or '.join(SAMPLE_UNITS)}",
            fix="give the radar of the cube; set cube.attrs['units']",
        )

    def decode(number: int, out: np.ndarray) -> None:
        out[:] = samples[number]

    gaps = cube.coords["gap"].transpose("frame", "chirp").values if "gap" in cube.coords else None
    scale = cube.attrs.get("scale")
    contents = Contents(
        radar=radar,
        n_frames=len(samples),
        decode=decode,
        units=cast(Units, units),
        gaps=gaps,
        scale=None if scale is None else float(scale),
        tables=dict(tables),
    )
    return Recording(
        path=Path(name), format="memory", contents=contents, frame_numbers=range(len(samples))
    )


def _check_cube_axes(cube: object) -> None:
    """Raise `InvalidSetting` unless it has the axes of a cube, and gaps over its chirps."""
    axes = {str(axis) for axis in cube.dims} if isinstance(cube, xr.DataArray) else set()
    actual = f"a {type(cube).__name__} over {', '.join(sorted(axes)) or 'no named axes'}"
    if isinstance(cube, xr.DataArray) and axes == set(CUBE_AXES):
        gap = cube.coords.get("gap")
        if gap is None or set(gap.dims) == {"frame", "chirp"}:
            return
        actual = f"a cube whose gap is over {', '.join(map(str, gap.dims)) or 'no axis'}"
    raise InvalidSetting(
        "cube",
        value=actual,
        expected=f"a DataArray over {', '.join(CUBE_AXES)}, with a gap, if any, over"
        " frame and chirp",
        fix="label the samples, with labelled_cube of dechirp.radar.cube",
    )
