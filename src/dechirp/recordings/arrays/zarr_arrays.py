"""Arrays in Zarr folders (versions 2 and 3), in a group or alone.

Only a local folder is read, without following links. Only codecs that convert numbers to bytes and
back are accepted: a codec of version 2 is Python's pickle, which executes what it reads.
"""

import itertools
import json
import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.recordings.arrays.lazy_array import (
    ArrayPart,
    LazyArray,
    check_plausible_size,
    choose_array_name,
    convert_parser_errors,
    count_chunks,
    format_shape,
    unwritten_chunk_indices_or_none,
)
from dechirp.recordings.arrays.zarr_chunks import (
    check_chunk_file_decompressed_size,
    parse_chunk_compression,
)
from dechirp.recordings.readers.base import RecordingHints

EXPECTED = "a Zarr array or group of version 2 or 3"

METADATA_NAMES = ("zarr.json", ".zarray", ".zgroup")
_MAX_METADATA_BYTES = 2**20
_MAX_FOLDERS = 10_000
_MAX_FILES = 2**22
_MAX_DEPTH = 16
_MAX_ABSENT_CHUNKS, _MAX_ABSENT_PER_PRESENT_CHUNK = 2**12, 100
"""Absent chunks that are read as fill values. Each takes the Zarr library 0.2 ms, so that a wrong
shape with 2^20 of them takes minutes.
"""
_KNOWN_CODECS = {
    *("bytes", "transpose", "sharding_indexed", "crc32c"),
    *("blosc", "gzip", "zlib", "zstd", "lz4", "bz2", "lzma"),
    *("shuffle", "delta", "fixedscaleoffset", "bitround", "quantize", "astype"),
}


def open_lazy_array_and_disk_bytes(path: Path, hints: RecordingHints) -> tuple[LazyArray, int]:
    """Open the array to read; return it with its size on disk.

    Raises
    ------
    RecordingError
        If it is damaged, contains links, or several arrays are possible.
    """
    with convert_parser_errors(path, EXPECTED):
        folders = {
            name: folder for name, folder in _iter_array_folders(path) if _is_numeric_array(folder)
        }
        inner_name = hints.inner_name.strip("/") if hints.inner_name else next(iter(folders), "")
        if inner_name in folders and (hints.inner_name or len(folders) == 1):
            _check_codecs_supported(path, folders[inner_name])
        arrays = {
            name: open_zarr_array(folder)
            for name, folder in folders.items()
            if not find_unsupported_codecs(folder)
        }
        array_types = {name: (array.shape, array.dtype) for name, array in arrays.items()}
        name = choose_array_name(path, array_types, hints)
        return _checked_lazy_array_and_disk_bytes(path, arrays[name], folders[name])


def read_small_array(path: Path, folder: Path) -> np.ndarray:
    """Read all numbers of a small array, such as one beside the samples.

    Raises
    ------
    RecordingError
        If it is damaged, contains links, or holds texts.
    """
    with convert_parser_errors(path, EXPECTED):
        _check_codecs_supported(path, folder)
        # Absent chunks hold the fill value.
        array, _ = _checked_lazy_array_and_disk_bytes(path, open_zarr_array(folder), folder)
        return array.read(tuple(slice(0, size) for size in array.shape))


def _iter_array_folders(root: Path) -> Iterator[tuple[str, Path]]:
    """Yield names and folders of the arrays in a group, or of a single array."""
    queue, n_folders = [root], 0
    while queue and n_folders < _MAX_FOLDERS:
        folder = queue.pop(0)
        n_folders += 1
        depth = len(folder.relative_to(root).parts)
        if read_array_metadata(folder) is not None:
            yield folder.relative_to(root).as_posix(), folder
        elif depth < _MAX_DEPTH:
            entries = sorted(folder.iterdir())
            queue += [entry for entry in entries if entry.is_dir() and not entry.is_symlink()]


def read_array_metadata(folder: Path) -> dict[str, Any] | None:
    """Return the metadata of an array; None if the folder is not an array."""
    for name in (".zarray", "zarr.json"):
        file = folder / name
        if file.is_file() and not file.is_symlink():
            metadata = read_json_object(file)
            if name == ".zarray" or metadata.get("node_type") == "array":
                return metadata
    return None


def read_json_object(file: Path) -> dict[str, Any]:
    """Read a mapping from a small JSON file; raise `ValueError` for anything else."""
    with file.open("rb") as stream:
        text = stream.read(_MAX_METADATA_BYTES + 1)
    if len(text) > _MAX_METADATA_BYTES:
        raise ValueError(f"{file.name} is longer than {_MAX_METADATA_BYTES} bytes")
    document = json.loads(text)
    if not isinstance(document, dict):
        raise ValueError(f"{file.name} is not a mapping")
    return document


def _iter_codec_names(metadata: Any) -> Iterator[str]:
    """Yield the names of all codecs in the metadata of an array, including nested ones."""
    if isinstance(metadata, list):
        for member in metadata:
            yield from _iter_codec_names(member)
    elif isinstance(metadata, dict):
        yield str(metadata.get("id", metadata.get("name", "?"))).removeprefix("numcodecs.")
        configuration = metadata.get("configuration")
        for key in ("codecs", "index_codecs"):
            yield from _iter_codec_names(
                configuration.get(key) if isinstance(configuration, dict) else None
            )
    elif metadata is not None:
        yield str(metadata)


def find_unsupported_codecs(folder: Path) -> list[str]:
    """Return the codecs of an array that are not accepted."""
    metadata = read_array_metadata(folder) or {}
    keys = ("codecs", "filters", "compressor", "storage_transformers")
    return sorted(
        {name for key in keys for name in _iter_codec_names(metadata.get(key))} - _KNOWN_CODECS
    )


def _check_codecs_supported(path: Path, folder: Path) -> None:
    """Raise `RecordingError` if an array needs codecs that are not accepted."""
    unsupported_codecs = find_unsupported_codecs(folder)
    if unsupported_codecs:
        raise RecordingError(
            path,
            value=f"an array that needs the codec {', '.join(unsupported_codecs)}",
            expected=f"codecs out of {', '.join(sorted(_KNOWN_CODECS))}",
            fix="save the samples again with one of them",
        )


def _is_numeric_array(folder: Path) -> bool:
    """Return whether an array may hold numbers; texts need other codecs."""
    metadata = read_array_metadata(folder) or {}
    if "dtype" in metadata:
        return isinstance(metadata["dtype"], list) or str(metadata["dtype"])[1:2] in tuple("iufc")
    data_type = metadata.get("data_type")
    return isinstance(data_type, dict) or str(data_type).startswith(
        ("int", "uint", "float", "complex")
    )


def open_zarr_array(folder: Path) -> Any:
    """Open an array whose codecs were checked; pass on any error of the Zarr library."""
    import zarr  # takes 0.3 s, only for this format
    from zarr.storage import LocalStore

    with warnings.catch_warnings():  # about pairs: "the specification may change"
        warnings.simplefilter("ignore")
        return zarr.open_array(LocalStore(folder, read_only=True), mode="r")


def list_files_and_total_size(folder: Path) -> tuple[set[str], int]:
    """Return the names of the files of an array, relative to its folder, and their total size.

    Raises `RecordingError` if one of them is a link.
    """
    names, n_bytes, prefixes = set(), 0, [""]
    while prefixes:
        prefix = prefixes.pop()
        with os.scandir(folder / prefix) as entries:
            for entry in entries:
                name = f"{prefix}{entry.name}"
                if entry.is_symlink():
                    raise _symlink_error(folder, name)
                if entry.is_dir():
                    prefixes.append(f"{name}/")
                elif not entry.is_file():  # reading a pipe would block
                    raise ValueError(f"{name} is neither a file nor a folder")
                else:
                    names.add(name)
                    n_bytes += entry.stat().st_size
        if len(names) + len(prefixes) > _MAX_FILES:
            raise ValueError(f"more than {_MAX_FILES} files")
    return names, n_bytes


def _symlink_error(folder: Path, name: str) -> RecordingError:
    """Return the error of a link in a folder."""
    return RecordingError(
        folder,
        value=f"{name} is a link",
        expected="files inside the folder; links are not followed",
        fix="copy the folder and the targets of its links",
    )


def _checked_lazy_array_and_disk_bytes(
    path: Path, array: Any, folder: Path
) -> tuple[LazyArray, int]:
    """Convert an array of the Zarr library to one that checks each chunk before it is read."""
    files, n_bytes = list_files_and_total_size(folder)
    encode_key = array.metadata.encode_chunk_key
    sizes = tuple(int(size) for size in array.shards or array.chunks)
    layout = parse_chunk_compression(path, array.metadata.to_dict(), sizes, array.dtype.itemsize)
    checked: set[str] = set()

    def read(part: ArrayPart) -> np.ndarray:
        with convert_parser_errors(path, EXPECTED):
            for index in _chunk_indices_of_part(part, sizes):
                name = encode_key(index)
                if name in files and name not in checked:
                    check_chunk_file_decompressed_size(path, folder / name, layout)
                    checked.add(name)
            return np.asarray(array[part])

    lazy_array = LazyArray(
        shape=tuple(int(size) for size in array.shape),
        dtype=array.dtype,
        read=read,
        chunk=sizes,
    )
    check_plausible_size(path, lazy_array, file_bytes=n_bytes)
    absent_chunks = find_absent_chunks(path, lazy_array, lambda index: encode_key(index) in files)
    return replace(lazy_array, absent_chunks=absent_chunks), n_bytes


def find_absent_chunks(
    path: Path, array: LazyArray, is_present: Callable[[tuple[int, ...]], bool]
) -> np.ndarray | None:
    """Return `LazyArray.absent_chunks`; raise `RecordingError` if too few chunks are present."""
    n_chunks = count_chunks(path, array)
    absent_chunks = unwritten_chunk_indices_or_none(array, is_present)
    n_absent = 0 if absent_chunks is None else len(absent_chunks)
    n_present = n_chunks - n_absent
    if n_absent > _MAX_ABSENT_CHUNKS + _MAX_ABSENT_PER_PRESENT_CHUNK * n_present:
        raise RecordingError(
            path,
            value=f"an array of shape {format_shape(array.shape)} without {n_absent} of its"
            f" {n_chunks} chunks",
            expected=f"at most {_MAX_ABSENT_CHUNKS} absent chunks, and"
            f" {_MAX_ABSENT_PER_PRESENT_CHUNK} for each one present",
            fix="copy the folder again with all of its files, or resize the array to its written"
            " part",
        )
    return absent_chunks


def _chunk_indices_of_part(
    part: ArrayPart, chunk_sizes: tuple[int, ...]
) -> Iterator[tuple[int, ...]]:
    """Return the indices of the chunks that a part of the array needs."""
    axis_ranges = (
        range(axis_slice.start // size, -(-axis_slice.stop // size))
        for axis_slice, size in zip(part, chunk_sizes, strict=True)
    )
    return itertools.product(*axis_ranges)
