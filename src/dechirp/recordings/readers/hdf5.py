"""HDF5 files (`.h5`, netCDF 4): arrays whose axes the user names, and native files."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.hdf5_datasets import (
    EXPECTED,
    dataset_to_lazy_array,
    find_dataset_following_links,
    open_hdf5,
    open_lazy_dataset,
    read_fixed_length_text_attribute,
)
from dechirp.recordings.arrays.lazy_array import (
    ALLOWED_BYTES,
    convert_parser_errors,
    memory_exceeds_file_error,
)
from dechirp.recordings.arrays.named_axes import interpret_array_as_recording
from dechirp.recordings.description import is_native_description
from dechirp.recordings.native import (
    MAX_DESCRIPTION_CHARACTERS,
    is_native_without_array_hints,
    read_native_contents,
)
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints

_MAGIC = b"\x89HDF\r\n\x1a\n"
_STARTS = (0, 512, 1024, 2048)  # a user block may come first
_DESCRIPTION, _CUBE, _GAP, _FRAME = "dechirp", "cube", "gap", "frame"


@frozen_dataclass
class Hdf5(Format):
    """HDF5 and netCDF 4: a dataset whose axes the user names.

    Accepts datasets of numbers, and of pairs called real and imag, re and im, or r and i. A file
    written by `dechirp convert` needs no hints, unless the user names another array in it.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inner_name")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(_STARTS[-1] + len(_MAGIC))
        is_hdf5 = any(head.startswith(_MAGIC, start) for start in _STARTS)
        if not is_hdf5 or head.startswith(b"MATLAB 7.3"):
            return MatchQuality.NO
        return (
            MatchQuality.SELF_DESCRIBING
            if _read_native_description(path)
            else MatchQuality.CONTAINER
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        text = _read_native_description(path)
        if text is None or not is_native_without_array_hints(text, hints):
            return interpret_array_as_recording(
                path, open_lazy_dataset(path, hints), hints, file_bytes=path.stat().st_size
            )
        with convert_parser_errors(path, f"{EXPECTED} as it was written"):
            return _read_native_file(path, text, hints)


def _read_native_description(path: Path) -> str | None:
    """Return the description in a native file; None if the file is foreign or damaged."""
    try:
        with open_hdf5(path) as file:
            text = read_fixed_length_text_attribute(file, _DESCRIPTION)
    except Exception:  # foreign bytes: `read` reports the damage
        return None
    return (
        text
        if text and len(text) <= MAX_DESCRIPTION_CHARACTERS and is_native_description(text)
        else None
    )


def _read_native_file(path: Path, description_text: str, hints: RecordingHints) -> Contents:
    """Read a file written by dechirp."""
    file = open_hdf5(path)
    side_arrays = _SideArrays(path, file)
    return read_native_contents(
        path,
        description_text,
        dataset_to_lazy_array(path, file, side_arrays.find_dataset(_CUBE)),
        hints,
        read_column=side_arrays.read_column,
        gaps=None
        if find_dataset_following_links(path, file, _GAP) is None
        else side_arrays.read_array(_GAP),
        file_bytes=path.stat().st_size,
        frame_starts_s=None
        if find_dataset_following_links(path, file, _FRAME) is None
        else side_arrays.read_array(_FRAME),
    )


class _SideArrays:
    """Small arrays stored beside the samples, read at once; their total size is limited."""

    def __init__(self, path: Path, file: Any) -> None:
        self.path, self.file = path, file
        self.file_bytes, self.held_bytes = path.stat().st_size, 0

    def find_dataset(self, name: str) -> Any:
        """Return a dataset by name; raise `KeyError` if there is none."""
        dataset = find_dataset_following_links(self.path, self.file, name)
        if dataset is None:
            raise KeyError(f"no dataset {name}")
        return dataset

    def read_array(self, name: str) -> np.ndarray:
        """Read a whole dataset, unless all of them together exceed the memory limit."""
        dataset = self.find_dataset(name)
        if dataset.dtype.hasobject:  # variable length: a few bytes can reference the whole file
            raise TypeError(f"{name} of {dataset.dtype}")
        self.held_bytes += dataset.nbytes
        if self.held_bytes > 2 * self.file_bytes + ALLOWED_BYTES:
            claim = f"tables of {self.held_bytes} bytes"
            raise memory_exceeds_file_error(self.path, claim, file_bytes=self.file_bytes)
        if dataset.shape and dataset.size:
            part = tuple(slice(0, size) for size in dataset.shape)
            return dataset_to_lazy_array(self.path, self.file, dataset).read(part)
        return np.asarray(dataset[()])

    def read_column(self, table: str, name: str) -> np.ndarray:
        """Read a column in the form of `core.dataset_arrays`: text, flags or complex numbers."""
        values = self.read_array(f"{table}/{name}")
        dataset = self.find_dataset(f"{table}/{name}")
        if values.dtype.kind == "S":
            rows = np.frombuffer(values.tobytes(), np.uint8)
            return rows.reshape(*values.shape, values.dtype.itemsize)
        if read_fixed_length_text_attribute(dataset, "parts") == "real imaginary":
            return np.ascontiguousarray(values).view(np.result_type(values.dtype, 1j))[..., 0]
        return (
            values.astype(bool)
            if read_fixed_length_text_attribute(dataset, "dtype") == "bool"
            else values
        )
