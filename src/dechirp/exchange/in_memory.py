"""A cube in memory as a recording, so that whatever takes one takes it."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import InvalidSetting
from dechirp.formats.base import Contents
from dechirp.formats.description import UNITS
from dechirp.formats.recording import Recording
from dechirp.radar.cube import must_be_sampled_as
from dechirp.radar.radar import Radar


def recording_of(
    cube: xr.DataArray,
    radar: Radar,
    *,
    tables: Mapping[str, xr.Dataset] = MappingProxyType({}),
    name: str = "memory",
) -> Recording:
    """Samples in memory as a recording that can be written, processed or read frame by frame.

    Parameters
    ----------
    cube : DataArray (frame, chirp, rx, sample)
        As `simulate` or `labelled_cube` gives it, any order of axes; not copied.
    radar : Radar
        What it was taken with.
    tables : mapping
        What travels with it, by name, as `truth` and `detections`.
    name : str
        Stands in messages where the path of a file would.

    Raises
    ------
    InvalidSetting
        If it is no cube, or not that radar's.
    """
    _must_be_cube(cube)
    samples = cube.transpose(*CUBE_AXES).values
    must_be_sampled_as(radar.frame.chirp, samples, where="cube")
    frame = radar.frame
    need = (frame.n_sent, radar.array.n_rx, frame.chirp.n_samples)
    units = cube.attrs.get("units")
    if samples.shape[1:] != need or not len(samples) or units not in UNITS:
        raise InvalidSetting(
            "cube",
            got=f"{len(samples)} frames of {samples.shape[1:]} in units of {units!r}",
            need=f"at least one, of {need} (chirp, rx, sample), as the radar has them, in"
            f" {' or '.join(UNITS)}",
            fix="Give the radar that the cube was made with; set cube.attrs['units'].",
        )

    def decode(number: int, out: np.ndarray) -> None:
        out[:] = samples[number]

    gaps = cube.coords["gap"].transpose("frame", "chirp").values if "gap" in cube.coords else None
    scale = cube.attrs.get("scale")
    contents = Contents(
        radar=radar,
        n_frames=len(samples),
        decode=decode,
        units=units,
        gaps=gaps,
        scale=None if scale is None else float(scale),
        tables=dict(tables),
    )
    return Recording(
        path=Path(name), format="memory", contents=contents, frame_numbers=range(len(samples))
    )


def _must_be_cube(cube: object) -> None:
    """Raise `InvalidSetting` unless it has the axes of a cube, and gaps those of its chirps."""
    axes = {str(axis) for axis in cube.dims} if isinstance(cube, xr.DataArray) else set()
    got = f"a {type(cube).__name__} over {', '.join(sorted(axes)) or 'no named axes'}"
    if isinstance(cube, xr.DataArray) and axes == set(CUBE_AXES):
        gap = cube.coords.get("gap")
        if gap is None or set(gap.dims) == {"frame", "chirp"}:
            return
        got = f"a cube whose gap is over {', '.join(map(str, gap.dims)) or 'no axis'}"
    raise InvalidSetting(
        "cube",
        got=got,
        need=f"a DataArray over {', '.join(CUBE_AXES)}, whose gap, if any, is over frame, chirp",
        fix="Label the samples, with labelled_cube of dechirp.radar.cube.",
    )
