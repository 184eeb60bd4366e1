"""One HDF5 file with a recording, in the layout of netCDF-4.

Each axis is a dimension scale of its name, tables are groups, and the description is an attribute
of
the root. Nothing is compressed: noise is not compressible, and other programs cannot read the fast
filters of h5py.
"""

import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.atomic_files import atomic_file
from dechirp.core.errors import DechirpError, Mistake
from dechirp.recordings.arrays.json_columns import NUMBERS
from dechirp.recordings.recording import Recording, label_frames_as_cube
from dechirp.recordings.writers.adc_samples import (
    iter_code_or_float_arrays,
    write_as_codes_else_floats,
)
from dechirp.recordings.writers.base import Progress
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)

_RESERVED_NAMES = (
    "frame",
    "chirp",
    "rx",
    "sample",
    "iq",
    "cube",
    "gap",
    "transmitter",
    "chirp_time",
)
_VALID_NAME = re.compile(r"[^\W][^/\x00-\x1f\x7f]*(?<! )")  # accepted by netCDF
_NAME_RULE = "named with a letter or a digit first, without a slash"
_PARTS_SUFFIX = ".parts"  # appended to a column name: the axis of its real and imaginary parts
_NO_VARIABLE_LABEL = "This is a netCDF dimension but not a netCDF variable.%10d"


def check_recording_fits_hdf5(recording: Recording) -> None:
    """Raise `DechirpError` if such a file cannot hold a recording."""
    recording.check_has_samples()
    description, _ = recording_description_and_columns(recording, None)
    check_column_types(NUMBERS, recording.tables)
    for name, structure in description.tables.items():
        if name in _RESERVED_NAMES or not _VALID_NAME.fullmatch(name):
            expected = f"a name other than {', '.join(_RESERVED_NAMES)}, and {_NAME_RULE}"
            raise _unsupported_table_error("tables", f"with a table named {name!r}", expected)
        _check_table_names_and_axes(name, structure["variables"])


def _check_table_names_and_axes(table: str, columns: Mapping[str, Any]) -> None:
    where = f"tables.{table}"
    dims = {dim for column in columns.values() for dim in column["dims"]}
    for name in (*columns, *dims):
        if name.endswith(_PARTS_SUFFIX) or not _VALID_NAME.fullmatch(name):
            raise _unsupported_table_error(
                where, f"with a column or an axis named {name!r}", _NAME_RULE
            )
    for name, column in columns.items():
        if name in dims and column["dims"] != [name]:
            axes = ", ".join(column["dims"]) or "nothing"
            expected = f"over {name} itself, which is an axis of the table"
            raise _unsupported_table_error(where, f"with a column {name} over {axes}", expected)


def _unsupported_table_error(where: str, value: str, expected: str) -> DechirpError:
    fix = "leave it out, or change it before writing"
    return DechirpError(Mistake(setting=where, value=value, expected=expected, fix=fix))


def write_hdf5_file(
    recording: Recording,
    out: Path,
    progress: Progress | None,
    convert_complex: Callable[[np.ndarray], np.ndarray],
) -> tuple[Path, ...]:
    """Write a checked recording frame by frame.

    Parameters
    ----------
    recording : Recording
        Accepted by `check_recording_fits_hdf5`.
    out : Path
        The file.
    progress : callable, optional
        Called with the number of completed frames and of all frames.
    convert_complex : callable
        Converts complex numbers to their stored form: unchanged, or with a further axis of their
        two parts; floats are unchanged.

    Raises
    ------
    DechirpError
        If it cannot be written, the disk is full, or a sample is not finite.
    """

    def write(scale: float | None) -> None:
        description, columns = recording_description_and_columns(recording, scale)
        with atomic_hdf5_file(out) as (file, raise_deferred_error):
            write_text_attribute(file, "dechirp", description.json_text)
            write_text_attribute(file, "Conventions", "CF-1.11")
            cube = None
            for n_done, frame in enumerate(iter_code_or_float_arrays(recording, scale), 1):
                values = convert_complex(frame)
                if cube is None:
                    shape = (recording.n_frames, *values.shape)
                    cube = file.create_dataset("cube", shape, values.dtype)
                cube[n_done - 1] = values
                raise_deferred_error()
                if progress is not None:
                    progress(n_done, recording.n_frames)
            assert cube is not None
            _write_cube_coordinates(file, recording, has_parts=cube.ndim > len(recording.sizes))
            _write_cube_attributes(file, cube, recording, scale)
            for name, structure in description.tables.items():
                group = file.create_group(name, track_order=True)
                _write_table(group, structure["variables"], columns[name], convert_complex)

    write_as_codes_else_floats(recording, write)
    return (out,)


def _write_cube_coordinates(file: Any, recording: Recording, *, has_parts: bool) -> None:
    """Write dimension scales of the cube, and other coordinates of frames and chirps."""
    contents, shape = recording.contents, tuple(recording.sizes.values())
    sample_dtype = np.complex64 if recording.radar.frame.chirp.sampling == "complex" else np.float32
    empty = np.broadcast_to(sample_dtype(0), shape)  # labels only, without samples
    labels = dict(label_frames_as_cube(empty, contents, first_frame=0, gaps=contents.gaps).coords)
    if has_parts:
        attributes = {"long_name": "part of a complex sample"}
        labels["iq"] = xr.DataArray([0, 1], dims="iq", attrs=attributes)
    for name, label in labels.items():
        values = label.values.astype(np.uint8) if name in ("gap", "iq") else label.values
        dataset = file.create_dataset(name, data=values)
        _write_units_and_long_name(dataset, label.attrs)
        if label.dims == (name,):
            dataset.make_scale(name)
    if has_parts:
        file["iq"].attrs["flag_values"] = np.array([0, 1], np.uint8)
        write_text_attribute(file["iq"], "flag_meanings", "real imaginary")
    for name, label in labels.items():
        if label.dims != (name,):
            _attach_dimension_scales(file[name], label.dims)


def _write_cube_attributes(file: Any, cube: Any, recording: Recording, scale: float | None) -> None:
    _attach_dimension_scales(cube, (*recording.sizes, "iq"))
    write_text_attribute(cube, "long_name", "samples of the beat signal")
    write_text_attribute(cube, "units", recording.contents.units)
    write_text_attribute(cube, "convention", "beat = Tx x conj(Rx), receding positive")
    others = [name for name in ("transmitter", "chirp_time", "gap") if name in file]
    if others:
        write_text_attribute(cube, "coordinates", " ".join(others))
    if scale is not None:
        cube.attrs["scale_factor"] = np.float32(scale)


def _write_table(
    group: Any,
    structure: Mapping[str, Any],
    columns: Mapping[str, np.ndarray],
    convert_complex: Callable[[np.ndarray], np.ndarray],
) -> None:
    """Write a dataset for each column of a table, and a scale for each of its axes."""
    datasets: dict[str, tuple[Any, list[str]]] = {}
    for name, column in structure.items():
        values, dims = convert_complex(columns[name]), list(column["dims"])
        if column["is_text"]:
            values = _fixed_length_texts(values)
        has_parts = values.ndim > len(dims)
        dims += [f"{name}{_PARTS_SUFFIX}"] * has_parts
        is_flag = values.dtype == bool
        stored_dtype = np.uint8 if is_flag else values.dtype
        dataset = group.create_dataset(name, data=values, dtype=stored_dtype)
        _write_units_and_long_name(dataset, column["attrs"])
        if is_flag:
            write_text_attribute(dataset, "dtype", "bool")  # as xarray writes it
        if has_parts:
            write_text_attribute(dataset, "parts", "real imaginary")
        datasets[name] = dataset, dims
    sizes = {
        dim: size
        for dataset, dims in datasets.values()
        for dim, size in zip(dims, dataset.shape, strict=True)
    }
    for dim, size in sizes.items():
        if dim in datasets:
            datasets[dim][0].make_scale(dim)
        else:
            group.create_dataset(dim, (size,), np.float32).make_scale(_NO_VARIABLE_LABEL % size)
    for name, (dataset, dims) in datasets.items():
        if name not in sizes:
            _attach_dimension_scales(dataset, dims)
    others = [
        name for name, column in structure.items() if column["is_coordinate"] and name not in sizes
    ]
    if others:
        write_text_attribute(group, "coordinates", " ".join(others))


def _fixed_length_texts(encoded: np.ndarray) -> np.ndarray:
    """Return texts (...) of equal length from bytes (..., n).

    Texts of length 1 are padded, since HDF5 would store them as characters.
    """
    import h5py

    width = max(encoded.shape[-1], 2)
    padded = np.zeros((*encoded.shape[:-1], width), np.uint8)
    padded[..., : encoded.shape[-1]] = encoded
    text_dtype = h5py.string_dtype("utf-8", width)
    return (
        np.frombuffer(padded.tobytes(), f"S{width}").reshape(padded.shape[:-1]).astype(text_dtype)
    )


def _attach_dimension_scales(dataset: Any, dims: Iterable[Any]) -> None:
    """Attach scales to the axes of a dataset; further names are ignored."""
    for axis, dim in zip(range(dataset.ndim), dims, strict=False):
        dataset.dims[axis].attach_scale(dataset.parent[dim])


def _write_units_and_long_name(dataset: Any, attributes: Mapping[Any, Any]) -> None:
    """Write the attributes that other programs use; the description contains all."""
    for name in ("units", "long_name"):
        if isinstance(attribute := attributes.get(name), str):
            write_text_attribute(dataset, name, attribute)


class _ErrorDeferringFile(io.FileIO):
    """File whose writes never fail: the first error is stored, and later writes are skipped.

    HDF5 (2.0) crashes the process if it cannot write its buffers while closing.
    """

    error: OSError | None = None

    def write(self, data: Any) -> int:
        rest = memoryview(data).cast("B")
        n_bytes = len(rest)
        try:
            while rest and self.error is None:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.error = error
        return n_bytes

    def truncate(self, size: int | None = None) -> int:
        try:
            if self.error is None:
                return super().truncate(size)
        except OSError as error:
            self.error = error
        return self.tell() if size is None else size

    def raise_deferred_error(self) -> None:
        """Raise the first error, if there was one."""
        if self.error is not None:
            raise self.error


@contextmanager
def atomic_hdf5_file(out: Path) -> Iterator[tuple[Any, Callable[[], None]]]:
    """Create a file that replaces `out` at the end; yield it and its error check."""
    import h5py  # takes 0.1 s, needed for these formats only

    with atomic_file(out) as temporary, _ErrorDeferringFile(temporary, "w+") as disk:
        # netCDF needs group members in creation order. Before v108 attributes have at most
        # 64 KiB, and no checksum.
        with h5py.File(disk, "w", track_order=True, libver=("v108", "v108")) as file:
            yield file, disk.raise_deferred_error
        disk.raise_deferred_error()


def write_text_attribute(hdf5_object: Any, name: str, text: str) -> None:
    """Write a text attribute of fixed length, which readers can read safely."""
    import h5py

    encoded = text.encode(errors="replace")
    hdf5_object.attrs.create(name, encoded, dtype=h5py.string_dtype("utf-8", max(len(encoded), 1)))
