"""A recording in one HDF5 file, laid out as netCDF-4 wants it.

Each axis is a dimension scale of its name, tables are groups, and the description is an attribute
of the root. Nothing is compressed: noise is not worth it, and what h5py compresses quickly other
programs cannot read.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, Mistake
from dechirp.exchange.coded import if_codes, numbers
from dechirp.exchange.hdf5_disk import new_hdf5, say
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.writers.base import Progress
from dechirp.formats.arrays.json_columns import NUMBERS
from dechirp.formats.recording import Recording
from dechirp.radar.cube import labelled_cube

_OURS = ("frame", "chirp", "rx", "sample", "iq", "cube", "gap", "transmitter", "chirp_time")
_NAME = re.compile(r"[^\W][^/\x00-\x1f\x7f]*(?<! )")  # that netCDF takes
_NEED = "named with a letter or a digit first, without a slash"
_PARTS = ".parts"  # behind the name of a column: the axis of its real and imaginary parts
_NO_COORDINATE = "This is a netCDF dimension but not a netCDF variable.%10d"


def must_fit(recording: Recording) -> None:
    """Raise `DechirpError` where such a file cannot hold a recording."""
    recording.must_hold_samples()
    said, _ = said_of(recording, None)
    must_be_of(NUMBERS, recording.tables)
    for name, about in said.tables.items():
        if name in _OURS or not _NAME.fullmatch(name):
            need = f"one that is none of {', '.join(_OURS)}, and {_NEED}"
            raise _refused("tables", f"with a table named {name!r}", need)
        _must_fit(name, about["variables"])


def _must_fit(table: str, about: Mapping[str, Any]) -> None:
    where = f"tables.{table}"
    dims = {dim for of in about.values() for dim in of["dims"]}
    for name in (*about, *dims):
        if name.endswith(_PARTS) or not _NAME.fullmatch(name):
            raise _refused(where, f"with a column or an axis named {name!r}", _NEED)
    for name, of in about.items():
        if name in dims and of["dims"] != [name]:
            over = ", ".join(of["dims"]) or "nothing"
            need = f"over {name} itself, which is an axis of the table"
            raise _refused(where, f"with a column {name} over {over}", need)


def _refused(where: str, got: str, need: str) -> DechirpError:
    fix = "Leave it out, or change it before it is written."
    return DechirpError(Mistake(setting=where, got=got, need=need, fix=fix))


def write_file(
    recording: Recording,
    out: Path,
    progress: Progress | None,
    as_stored: Callable[[np.ndarray], np.ndarray],
) -> tuple[Path, ...]:
    """Write a recording that was checked, one frame after the other.

    Parameters
    ----------
    recording : Recording
        What `must_fit` let through.
    out : Path
        The file.
    progress : callable, optional
        Told the number of frames done and of all.
    as_stored : callable
        Gives floats as they are and complex numbers as the file has them: as they are, too, or
        with one more axis, of their two parts.

    Raises
    ------
    DechirpError
        If it cannot be written, the disk fills, or a sample is not finite.
    """

    def write(scale: float | None) -> None:
        said, columns = said_of(recording, scale)
        with new_hdf5(out) as (file, must_have_written):
            say(file, "dechirp", said.text)
            say(file, "Conventions", "CF-1.11")
            cube = None
            for done, frame in enumerate(numbers(recording, scale), 1):
                values = as_stored(frame)
                if cube is None:
                    shape = (recording.n_frames, *values.shape)
                    cube = file.create_dataset("cube", shape, values.dtype)
                cube[done - 1] = values
                must_have_written()
                if progress is not None:
                    progress(done, recording.n_frames)
            assert cube is not None
            _write_axes(file, recording, has_parts=cube.ndim > len(recording.sizes))
            _label_cube(file, cube, recording, scale)
            for name, about in said.tables.items():
                group = file.create_group(name, track_order=True)
                _write_table(group, about["variables"], columns[name], as_stored)

    if_codes(recording, write)
    return (out,)


def _write_axes(file: Any, recording: Recording, *, has_parts: bool) -> None:
    """Dimension scales of the cube, and what else is known of its frames and chirps."""
    contents, shape = recording.contents, tuple(recording.sizes.values())
    kind = np.complex64 if recording.radar.frame.chirp.sampling == "complex" else np.float32
    empty = np.broadcast_to(kind(0), shape)  # labels alone: no samples are held
    labels = dict(labelled_cube(empty, recording.radar, units=contents.units).coords)
    if contents.gaps is not None:
        words = {"long_name": "samples of the chirp were lost and are zero"}
        labels["gap"] = xr.DataArray(contents.gaps, dims=("frame", "chirp"), attrs=words)
    if has_parts:
        words = {"long_name": "part of a complex sample"}
        labels["iq"] = xr.DataArray([0, 1], dims="iq", attrs=words)
    for name, label in labels.items():
        values = label.values.astype(np.uint8) if name in ("gap", "iq") else label.values
        dataset = file.create_dataset(name, data=values)
        _say_of(dataset, label.attrs)
        if label.dims == (name,):
            dataset.make_scale(name)
    if has_parts:
        file["iq"].attrs["flag_values"] = np.array([0, 1], np.uint8)
        say(file["iq"], "flag_meanings", "real imaginary")
    for name, label in labels.items():
        if label.dims != (name,):
            _along(file[name], label.dims)


def _label_cube(file: Any, cube: Any, recording: Recording, scale: float | None) -> None:
    _along(cube, (*recording.sizes, "iq"))
    say(cube, "long_name", "samples of the beat signal")
    say(cube, "units", recording.contents.units)
    say(cube, "convention", "beat = Tx x conj(Rx), receding positive")
    others = [name for name in ("transmitter", "chirp_time", "gap") if name in file]
    if others:
        say(cube, "coordinates", " ".join(others))
    if scale is not None:
        cube.attrs["scale_factor"] = np.float32(scale)


def _write_table(
    group: Any,
    about: Mapping[str, Any],
    columns: Mapping[str, np.ndarray],
    as_stored: Callable[[np.ndarray], np.ndarray],
) -> None:
    """A group with a dataset for each column, and a scale for each of its axes."""
    made: dict[str, tuple[Any, list[str]]] = {}
    for name, of in about.items():
        values, dims = as_stored(columns[name]), list(of["dims"])
        if of["is_text"]:
            values = _texts(values)
        has_parts = values.ndim > len(dims)
        dims += [f"{name}{_PARTS}"] * has_parts
        is_flag = values.dtype == bool
        kind = np.uint8 if is_flag else values.dtype
        dataset = group.create_dataset(name, data=values, dtype=kind)
        _say_of(dataset, of["attrs"])
        if is_flag:
            say(dataset, "dtype", "bool")  # as xarray says it
        if has_parts:
            say(dataset, "parts", "real imaginary")
        made[name] = dataset, dims
    sizes = {
        dim: size
        for dataset, dims in made.values()
        for dim, size in zip(dims, dataset.shape, strict=True)
    }
    for dim, size in sizes.items():
        if dim in made:
            made[dim][0].make_scale(dim)
        else:
            group.create_dataset(dim, (size,), np.float32).make_scale(_NO_COORDINATE % size)
    for name, (dataset, dims) in made.items():
        if name not in sizes:
            _along(dataset, dims)
    others = [name for name, of in about.items() if of["is_coordinate"] and name not in sizes]
    if others:
        say(group, "coordinates", " ".join(others))


def _texts(encoded: np.ndarray) -> np.ndarray:
    """Texts (...) of one length, of their bytes (..., n); those of 1 would be characters."""
    import h5py

    width = max(encoded.shape[-1], 2)
    room = np.zeros((*encoded.shape[:-1], width), np.uint8)
    room[..., : encoded.shape[-1]] = encoded
    kind = h5py.string_dtype("utf-8", width)
    return np.frombuffer(room.tobytes(), f"S{width}").reshape(room.shape[:-1]).astype(kind)


def _along(dataset: Any, dims: Iterable[Any]) -> None:
    """Name the axes of a dataset: as many of those as it has."""
    for place, dim in zip(range(dataset.ndim), dims, strict=False):
        dataset.dims[place].attach_scale(dataset.parent[dim])


def _say_of(dataset: Any, attributes: Mapping[Any, Any]) -> None:
    """What other programs understand of the attributes; all are in the description."""
    for name in ("units", "long_name"):
        if isinstance(said := attributes.get(name), str):
            say(dataset, name, said)
