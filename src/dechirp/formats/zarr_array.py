"""Zarr folders (versions 2 and 3): one array of a group, or an array by itself.

Only a local folder is read, nothing that a link in it leads to. Of the codecs, only those
that change numbers into bytes and back: one of version 2 is Python's pickle, which runs what
it reads.
"""

import itertools
import json
import os
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.stored import (
    Part,
    Stored,
    absent_chunks,
    chosen,
    must_be_countable,
    must_be_plausible,
    parsing,
)
from dechirp.formats.arrays.zarr_chunks import must_unpack_to_size, packing_in
from dechirp.formats.base import Contents, Fit, Format, Told

NEED = "a Zarr array or group of version 2 or 3"

_MARKS = ("zarr.json", ".zarray", ".zgroup")
_LARGEST_TEXT = 2**20
_MOST_FOLDERS = 10_000
_MOST_FILES = 2**22
_DEEPEST = 16
_CODECS = {
    *("bytes", "transpose", "sharding_indexed", "crc32c"),
    *("blosc", "gzip", "zlib", "zstd", "lz4", "bz2", "lzma"),
    *("shuffle", "delta", "fixedscaleoffset", "bitround", "quantize", "astype"),
}


@value
class ZarrArray(Format):
    """Zarr: an array whose axes the user names.

    An array of numbers; what was never written of it becomes gaps.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by the files that say what the folder holds."""
        is_zarr = path.is_dir() and any((path / mark).is_file() for mark in _MARKS)
        return Fit.CONTAINER if is_zarr else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        stored, file_bytes = array_in(path, told)
        return contents(path, stored, told, file_bytes=file_bytes)


def array_in(path: Path, told: Told) -> tuple[Stored, int]:
    """Array that is meant, and how many bytes it takes on disk.

    Raises
    ------
    RecordingError
        If it is damaged, leads elsewhere, or it is not clear which one is meant.
    """
    with parsing(path, NEED):
        folders = {name: folder for name, folder in _arrays(path) if _has_numbers(folder)}
        meant = told.inside.strip("/") if told.inside else next(iter(folders), "")
        if meant in folders and (told.inside or len(folders) == 1):
            _must_be_plain(path, folders[meant])
        opened = {
            name: opened_array(folder)
            for name, folder in folders.items()
            if not unknown_codecs(folder)
        }
        known = {name: (array.shape, array.dtype) for name, array in opened.items()}
        name = chosen(path, known, told)
        return _stored(path, opened[name], folders[name])


def read_array(path: Path, folder: Path) -> np.ndarray:
    """All numbers of a small array, as one beside the samples.

    Raises
    ------
    RecordingError
        If it is damaged, leads elsewhere, or holds texts.
    """
    with parsing(path, NEED):
        _must_be_plain(path, folder)
        stored, _ = _stored(path, opened_array(folder), folder)  # what is not there is its filling
        return stored.read(tuple(slice(0, size) for size in stored.shape))


def _arrays(root: Path) -> Iterator[tuple[str, Path]]:
    """Names and folders of the arrays in a group, or of the array that it is."""
    waiting, n_folders = [root], 0
    while waiting and n_folders < _MOST_FOLDERS:
        folder = waiting.pop(0)
        n_folders += 1
        depth = len(folder.relative_to(root).parts)
        if metadata_of(folder) is not None:
            yield folder.relative_to(root).as_posix(), folder
        elif depth < _DEEPEST:
            there = sorted(folder.iterdir())
            waiting += [one for one in there if one.is_dir() and not one.is_symlink()]


def metadata_of(folder: Path) -> dict[str, Any] | None:
    """What an array says of itself; None if the folder is none."""
    for name in (".zarray", "zarr.json"):
        file = folder / name
        if file.is_file() and not file.is_symlink():
            said = read_json(file)
            if name == ".zarray" or said.get("node_type") == "array":
                return said
    return None


def read_json(file: Path) -> dict[str, Any]:
    """Mapping in a small JSON file; raises `ValueError` if it holds anything else."""
    with file.open("rb") as opened:
        text = opened.read(_LARGEST_TEXT + 1)
    if len(text) > _LARGEST_TEXT:
        raise ValueError(f"{file.name} is longer than {_LARGEST_TEXT} bytes")
    said = json.loads(text)
    if not isinstance(said, dict):
        raise ValueError(f"{file.name} holds no mapping")
    return said


def _codecs(said: Any) -> Iterator[str]:
    """Names of all codecs in the metadata of an array, those within others too."""
    if isinstance(said, list):
        for member in said:
            yield from _codecs(member)
    elif isinstance(said, dict):
        yield str(said.get("id", said.get("name", "?"))).removeprefix("numcodecs.")
        inner = said.get("configuration")
        for key in ("codecs", "index_codecs"):
            yield from _codecs(inner.get(key) if isinstance(inner, dict) else None)
    elif said is not None:
        yield str(said)


def unknown_codecs(folder: Path) -> list[str]:
    """Codecs of an array that are none of the known ones."""
    said = metadata_of(folder) or {}
    keys = ("codecs", "filters", "compressor", "storage_transformers")
    return sorted({name for key in keys for name in _codecs(said.get(key))} - _CODECS)


def _must_be_plain(path: Path, folder: Path) -> None:
    foreign = unknown_codecs(folder)
    if foreign:
        raise RecordingError(
            path,
            got=f"an array that needs the codec {', '.join(foreign)}",
            need=f"one with codecs out of {', '.join(sorted(_CODECS))}",
            fix="Save the samples again with one of them.",
        )


def _has_numbers(folder: Path) -> bool:
    """Whether an array may hold numbers; texts need codecs of their own."""
    said = metadata_of(folder) or {}
    if "dtype" in said:
        return isinstance(said["dtype"], list) or str(said["dtype"])[1:2] in tuple("iufc")
    kind = said.get("data_type")
    return isinstance(kind, dict) or str(kind).startswith(("int", "uint", "float", "complex"))


def opened_array(folder: Path) -> Any:
    """Array of Zarr's library, whose codecs are known; raises whatever that does of damage."""
    import zarr  # takes 0.3 s, for this format alone
    from zarr.storage import LocalStore

    with warnings.catch_warnings():  # of pairs, that their specification may change
        warnings.simplefilter("ignore")
        return zarr.open_array(LocalStore(folder, read_only=True), mode="r")


def files_in(folder: Path) -> tuple[set[str], int]:
    """Names of the files of an array, relative to its folder, and their bytes together.

    Raises `RecordingError` if one of them is a link.
    """
    names, n_bytes, waiting = set(), 0, [""]
    while waiting:
        prefix = waiting.pop()
        with os.scandir(folder / prefix) as entries:
            for entry in entries:
                name = f"{prefix}{entry.name}"
                if entry.is_symlink():
                    raise _link(folder, name)
                if entry.is_dir():
                    waiting.append(f"{name}/")
                elif not entry.is_file():  # a pipe would be waited for
                    raise ValueError(f"{name} is neither a file nor a folder")
                else:
                    names.add(name)
                    n_bytes += entry.stat().st_size
        if len(names) + len(waiting) > _MOST_FILES:
            raise ValueError(f"more than {_MOST_FILES} files")
    return names, n_bytes


def _link(folder: Path, name: str) -> RecordingError:
    return RecordingError(
        folder,
        got=f"a folder in which {name} is a link",
        need="one whose files lie in it: none may be read elsewhere",
        fix="Copy the folder with what its links lead to.",
    )


def _stored(path: Path, array: Any, folder: Path) -> tuple[Stored, int]:
    files, n_bytes = files_in(folder)
    key = array.metadata.encode_chunk_key
    sizes = tuple(int(size) for size in array.shards or array.chunks)
    packing = packing_in(path, array.metadata.to_dict(), sizes, array.dtype.itemsize)
    checked: set[str] = set()

    def read(part: Part) -> np.ndarray:
        with parsing(path, NEED):
            for place in _places(part, sizes):
                name = key(place)
                if name in files and name not in checked:
                    must_unpack_to_size(path, folder / name, packing)
                    checked.add(name)
            return np.asarray(array[part])

    stored = Stored(
        shape=tuple(int(size) for size in array.shape),
        dtype=array.dtype,
        read=read,
        chunk=sizes,
    )
    must_be_plausible(path, stored, file_bytes=n_bytes)
    must_be_countable(path, stored)
    absent = absent_chunks(stored, lambda place: key(place) in files)
    return replace(stored, absent=absent), n_bytes


def _places(part: Part, sizes: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Places, among all chunks of these sizes, of those that a part needs."""
    along = (
        range(one.start // size, -(-one.stop // size))
        for one, size in zip(part, sizes, strict=True)
    )
    return itertools.product(*along)
