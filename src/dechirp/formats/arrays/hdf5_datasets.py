"""Datasets of an HDF5 file, as arrays that are read in parts.

Only what lies in the file itself is read: no links to other files, no external storage, no
virtual datasets.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.formats.arrays.stored import (
    Part,
    Stored,
    absent_chunks,
    chosen,
    is_numeric,
    must_be_countable,
    must_be_plausible,
    parsing,
    too_large,
)
from dechirp.formats.arrays.unpacking import size_of_lzf, unpacks_beyond
from dechirp.formats.base import Told

NEED = "an HDF5 file"
_MOST_OBJECTS = 10_000
_MOST_HOPS = 16
_DEEPEST = 16
# Chunks of several frames are kept until the next frame needs them.
_CACHE_BYTES = 2**26
_FILTERS_ADD = 1024  # bytes at most that others add to a chunk before it is compressed
_DEFLATE, _FLETCHER32, _SZIP, _LZF = 1, 3, 4, 32000
_PACKERS = (_DEFLATE, _SZIP, _LZF)
_CHECKSUM_BYTES = 4
_NOT_NUMBERS = ("char", "logical", "cell", "struct", "function_handle")


def opened(path: Path) -> Any:
    """The file, open to be read; whatever its library raises of damaged bytes goes through."""
    import h5py  # takes 0.1 s, for this format alone

    return h5py.File(path, "r", rdcc_nbytes=_CACHE_BYTES)


def text_of(thing: Any, name: str) -> str | None:
    """Attribute of a group or dataset that is one text of fixed length; None if there is none.

    Others are not read: in one of variable length that is damaged, HDF5 (2.0) searches for ever.
    """
    import h5py

    if name not in thing.attrs:
        return None
    attribute = thing.attrs.get_id(name)
    kind = h5py.check_string_dtype(attribute.dtype)
    if attribute.shape != () or kind is None or kind.length is None:
        return None
    text: bytes = thing.attrs[name]
    return text.decode(errors="replace")


def dataset_in(path: Path, told: Told, *, of_matlab: bool = False) -> Stored:
    """Dataset that is meant, with its axes in the order of the file.

    Raises
    ------
    RecordingError
        If it is damaged, lies elsewhere, or it is not clear which one is meant.
    """
    with parsing(path, NEED):
        file = opened(path)
        found = _datasets(file, of_matlab=of_matlab)
        if told.inside and told.inside.strip("/") not in found:
            name = told.inside.strip("/")
            meant = named(path, file, name)
            if meant is not None and _has_numbers(meant, of_matlab=False):
                found[name] = meant
        name = chosen(path, {key: (one.shape, one.dtype) for key, one in found.items()}, told)
        return stored(path, file, found[name])


def _datasets(file: Any, *, of_matlab: bool) -> dict[str, Any]:
    """Datasets of numbers by path, found along hard links alone."""
    import h5py

    found: dict[str, Any] = {}
    seen, n_objects = set(), 0
    waiting = [("", file["/"])]
    while waiting and n_objects < _MOST_OBJECTS:
        prefix, group = waiting.pop(0)
        address = h5py.h5o.get_info(group.id).addr
        if address in seen or prefix.count("/") > _DEEPEST:  # groups can hold one another
            continue
        seen.add(address)
        for name in group:
            n_objects += 1
            if n_objects >= _MOST_OBJECTS:
                break
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            member = group[name]
            if isinstance(member, h5py.Group) and name != "#refs#":
                waiting.append((f"{prefix}{name}/", member))
            elif isinstance(member, h5py.Dataset) and _has_numbers(member, of_matlab=of_matlab):
                found[f"{prefix}{name}"] = member
    return found


def _has_numbers(dataset: Any, *, of_matlab: bool) -> bool:
    try:
        shape, dtype = dataset.shape, dataset.dtype
    except TypeError:  # of a type that NumPy has not
        return False
    said = text_of(dataset, "MATLAB_class") if of_matlab else None
    return bool(shape) and is_numeric(dtype) and said not in _NOT_NUMBERS


def named(path: Path, file: Any, name: str) -> Any | None:
    """Dataset of a path that leads through links within the file; none if it leads nowhere.

    Raises
    ------
    RecordingError
        If it leads to another file.
    """
    import h5py

    here, ahead, hops = file["/"], name.split("/"), 0
    while ahead:
        step = ahead.pop(0)
        link = here.get(step, getlink=True) if isinstance(here, h5py.Group) else None
        if isinstance(link, h5py.HardLink):
            here = here[step]
        elif isinstance(link, h5py.SoftLink) and hops < _MOST_HOPS:
            hops += 1
            here = file["/"] if link.path.startswith("/") else here
            ahead = [part for part in link.path.split("/") if part not in ("", ".")] + ahead
        elif isinstance(link, h5py.ExternalLink):
            raise _elsewhere(path, name, f"a link to {link.filename}")
        else:
            return None
    return here if isinstance(here, h5py.Dataset) else None


def _elsewhere(path: Path, name: str, what: str) -> RecordingError:
    return RecordingError(
        path,
        got=f"a file whose {name} is {what}",
        need="samples in the file itself: it may not make other files be read",
        fix="Copy the dataset into one file.",
    )


def stored(path: Path, file: Any, dataset: Any) -> Stored:
    """A dataset as an array that is read in parts; it keeps its file open.

    Raises
    ------
    RecordingError
        If its samples lie elsewhere, or would take more memory than the file is worth.
    """
    name = dataset.name
    if dataset.is_virtual:
        raise _elsewhere(path, name, "a virtual dataset, made of others")
    if dataset.external:
        raise _elsewhere(path, name, "in external storage")

    checked: set[tuple[int, ...]] = set()
    filters = _filters(path, dataset)
    is_packed = any(kind in _PACKERS for kind in filters)

    def read(part: Part) -> np.ndarray:
        assert file  # closed with its last reference, and its datasets with it
        with parsing(path, NEED):
            if is_packed:
                _must_unpack_to_size(path, dataset, part, filters, checked)
            made: np.ndarray = dataset[part]
        return made

    array = Stored(
        shape=tuple(int(size) for size in dataset.shape),
        dtype=dataset.dtype,
        read=read,
        chunk=dataset.chunks,
    )
    must_be_plausible(path, array, file_bytes=path.stat().st_size)
    return replace(array, absent=_absent(path, array, dataset))


def _filters(path: Path, dataset: Any) -> tuple[int, ...]:
    """Numbers of the filters that a dataset went through, in this order.

    Raises
    ------
    RecordingError
        If more was made of what one had compressed than a checksum was added.
    """
    made = dataset.id.get_create_plist()
    kinds = tuple(made.get_filter(number)[0] for number in range(made.get_nfilters()))
    packed = [place for place, kind in enumerate(kinds) if kind in _PACKERS]
    if packed and kinds[packed[0] + 1 :] not in ((), (_FLETCHER32,)):
        raise RecordingError(
            path,
            got=f"a file whose {dataset.name} went through filters {list(kinds)}",
            need="samples that were compressed once (deflate, filter 1, LZF or SZIP), last of all",
            fix="Save it again, with one compression or without.",
        )
    return kinds


def _must_unpack_to_size(
    path: Path,
    dataset: Any,
    part: Part,
    filters: tuple[int, ...],
    checked: set[tuple[int, ...]],
) -> None:
    """Raise `RecordingError` if a compressed chunk holds more than a chunk of the array.

    HDF5 itself unpacks whatever is there: 2 MB can become 2 GB.
    """
    most = math.prod(dataset.chunks) * dataset.dtype.itemsize + _FILTERS_ADD
    for slices in dataset.iter_chunks(part):
        sizes = zip(slices, dataset.chunks, strict=True)
        start = tuple(along.start // size * size for along, size in sizes)
        if start in checked:
            continue
        checked.add(start)
        if not dataset.id.get_chunk_info_by_coord(start).size:  # never written
            continue
        skipped, packed = dataset.id.read_direct_chunk(start)
        used = [kind for place, kind in enumerate(filters) if not skipped >> place & 1]
        n_behind = _CHECKSUM_BYTES if used[-1:] == [_FLETCHER32] else 0
        if _unpacks_beyond(used, packed[: len(packed) - n_behind], most):
            what = f"a piece of {len(packed)} bytes that unpacks to more than {most}"
            raise too_large(path, what, file_bytes=path.stat().st_size)


def _unpacks_beyond(filters: list[int], packed: bytes, most: int) -> bool:
    if _DEFLATE in filters:
        return unpacks_beyond("zlib", {}, packed, most)
    if _LZF in filters:
        return size_of_lzf(np.frombuffer(packed, np.uint8)) > most
    # SZIP begins with the size that room is made for.
    return _SZIP in filters and int.from_bytes(packed[:4], "little") > most


def _absent(path: Path, array: Stored, dataset: Any) -> np.ndarray | None:
    """Chunks that were never written."""
    if array.chunk is None:
        if dataset.id.get_storage_size() > 0:
            return None
        raise RecordingError(
            path,
            got=f"a file whose {dataset.name} was made, but never written",
            need="one with samples",
            fix="Record again, or name another array.",
        )
    n_chunks = must_be_countable(path, array)
    if dataset.id.get_num_chunks() >= n_chunks:
        return None
    sizes = array.chunk
    there: set[tuple[int, ...]] = set()

    def note(chunk: Any) -> None:
        starts = zip(chunk.chunk_offset, sizes, strict=True)
        there.add(tuple(start // size for start, size in starts))

    dataset.id.chunk_iter(note)
    return absent_chunks(array, there.__contains__)
