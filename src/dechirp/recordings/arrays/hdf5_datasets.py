"""Datasets of an HDF5 file, as arrays that are read in parts.

Only data inside the file is read: links to other files, external storage and virtual datasets are
refused.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.recordings.arrays.decompression_limits import (
    exceeds_decompressed_size,
    lzf_decompressed_size,
)
from dechirp.recordings.arrays.lazy_array import (
    ArrayPart,
    LazyArray,
    check_plausible_size,
    choose_array_name,
    convert_parser_errors,
    count_chunks,
    is_numeric,
    memory_exceeds_file_error,
    reverse_axes,
    unwritten_chunk_indices_or_none,
)
from dechirp.recordings.readers.base import RecordingHints

EXPECTED = "an HDF5 file"
_MAX_OBJECTS = 10_000
_MAX_LINKS = 16
_MAX_DEPTH = 16
# The cache keeps chunks of several frames until the next frame needs them.
_CACHE_BYTES = 2**26
# Bytes at most that other filters add to a chunk before its compression.
_FILTER_OVERHEAD_BYTES = 1024
_DEFLATE, _FLETCHER32, _SZIP, _LZF = 1, 3, 4, 32000
_COMPRESSORS = (_DEFLATE, _SZIP, _LZF)
_CHECKSUM_BYTES = 4
_NON_NUMERIC_CLASSES = ("char", "logical", "cell", "struct", "function_handle")


def open_hdf5(path: Path) -> Any:
    """Open the file for reading; errors of the library for damaged bytes are passed on."""
    import h5py  # takes 0.1 s, only for this format

    return h5py.File(path, "r", rdcc_nbytes=_CACHE_BYTES)


def read_fixed_length_text_attribute(node: Any, name: str) -> str | None:
    """Return an attribute that is a fixed-length text; None if there is none.

    Variable-length texts are not read: in a damaged one, HDF5 (2.0) searches for ever.
    """
    import h5py

    if name not in node.attrs:
        return None
    attribute = node.attrs.get_id(name)
    string_info = h5py.check_string_dtype(attribute.dtype)
    if attribute.shape != () or string_info is None or string_info.length is None:
        return None
    text: bytes = node.attrs[name]
    return text.decode(errors="replace")


def open_lazy_dataset(
    path: Path, hints: RecordingHints, *, is_matlab_file: bool = False
) -> LazyArray:
    """Open the dataset to read, with its axes in the order of the file.

    Raises
    ------
    RecordingError
        If it is damaged, lies outside the file, or several datasets are possible.
    """
    with convert_parser_errors(path, EXPECTED):
        file = open_hdf5(path)
        datasets = _find_numeric_datasets(file, is_matlab_file=is_matlab_file)
        if hints.inner_name and hints.inner_name.strip("/") not in datasets:
            name = hints.inner_name.strip("/")
            dataset = find_dataset_following_links(path, file, name)
            if dataset is not None and _is_numeric_dataset(dataset, is_matlab_file=False):
                datasets[name] = dataset
        name = choose_array_name(
            path, {key: (dataset.shape, dataset.dtype) for key, dataset in datasets.items()}, hints
        )
        return dataset_to_lazy_array(path, file, datasets[name])


def open_matlab_arrays(path: Path) -> dict[str, LazyArray]:
    """Open all numeric arrays of a MATLAB file of version 7.3 by path, with MATLAB's axes.

    Raises
    ------
    RecordingError
        If the file is damaged.
    """
    with convert_parser_errors(path, EXPECTED):
        file = open_hdf5(path)
        return {
            name: reverse_axes(dataset_to_lazy_array(path, file, dataset))
            for name, dataset in _find_numeric_datasets(file, is_matlab_file=True).items()
        }


def _find_numeric_datasets(file: Any, *, is_matlab_file: bool) -> dict[str, Any]:
    """Find numeric datasets by path, along hard links only."""
    import h5py

    datasets: dict[str, Any] = {}
    visited, n_objects = set(), 0
    queue = [("", file["/"])]
    while queue and n_objects < _MAX_OBJECTS:
        prefix, group = queue.pop(0)
        address = h5py.h5o.get_info(group.id).addr
        if address in visited or prefix.count("/") > _MAX_DEPTH:  # groups can contain one another
            continue
        visited.add(address)
        for name in group:
            n_objects += 1
            if n_objects >= _MAX_OBJECTS:
                break
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            member = group[name]
            if isinstance(member, h5py.Group) and name != "#refs#":
                queue.append((f"{prefix}{name}/", member))
            elif isinstance(member, h5py.Dataset) and _is_numeric_dataset(
                member, is_matlab_file=is_matlab_file
            ):
                datasets[f"{prefix}{name}"] = member
    return datasets


def _is_numeric_dataset(dataset: Any, *, is_matlab_file: bool) -> bool:
    """Return whether samples can be made of a dataset."""
    try:
        shape, dtype = dataset.shape, dataset.dtype
    except TypeError:  # a type without NumPy equivalent
        return False
    matlab_class = (
        read_fixed_length_text_attribute(dataset, "MATLAB_class") if is_matlab_file else None
    )
    return bool(shape) and is_numeric(dtype) and matlab_class not in _NON_NUMERIC_CLASSES


def find_dataset_following_links(path: Path, file: Any, name: str) -> Any | None:
    """Return the dataset at a path, following links within the file; None if there is none.

    Raises
    ------
    RecordingError
        If the path leads to another file.
    """
    import h5py

    node, steps, n_links = file["/"], name.split("/"), 0
    while steps:
        step = steps.pop(0)
        link = node.get(step, getlink=True) if isinstance(node, h5py.Group) else None
        if isinstance(link, h5py.HardLink):
            node = node[step]
        elif isinstance(link, h5py.SoftLink) and n_links < _MAX_LINKS:
            n_links += 1
            node = file["/"] if link.path.startswith("/") else node
            steps = [part for part in link.path.split("/") if part not in ("", ".")] + steps
        elif isinstance(link, h5py.ExternalLink):
            raise _external_data_error(path, name, f"a link to {link.filename}")
        else:
            return None
    return node if isinstance(node, h5py.Dataset) else None


def _external_data_error(path: Path, name: str, description: str) -> RecordingError:
    """Return the error of samples outside the file."""
    return RecordingError(
        path,
        value=f"{name} is {description}",
        expected="samples inside the file; other files are not read",
        fix="copy the dataset into one file",
    )


def dataset_to_lazy_array(path: Path, file: Any, dataset: Any) -> LazyArray:
    """Convert a dataset to an array that is read in parts and keeps its file open.

    Raises
    ------
    RecordingError
        If its samples lie outside the file, or would take more memory than the file allows.
    """
    name = dataset.name
    if dataset.is_virtual:
        raise _external_data_error(path, name, "a virtual dataset")
    if dataset.external:
        raise _external_data_error(path, name, "external storage")

    checked: set[tuple[int, ...]] = set()
    filters = _read_filter_ids(path, dataset)
    is_compressed = any(kind in _COMPRESSORS for kind in filters)

    def read(part: ArrayPart) -> np.ndarray:
        assert file  # keeps the file open: its last reference closes it and its datasets
        with convert_parser_errors(path, EXPECTED):
            if is_compressed:
                _check_decompressed_chunk_sizes(path, dataset, part, filters, checked)
            values: np.ndarray = dataset[part]
        return values

    array = LazyArray(
        shape=tuple(int(size) for size in dataset.shape),
        dtype=dataset.dtype,
        read=read,
        chunk=dataset.chunks,
    )
    check_plausible_size(path, array, file_bytes=path.stat().st_size)
    return replace(array, absent_chunks=_unwritten_chunk_indices_or_none(path, array, dataset))


def _read_filter_ids(path: Path, dataset: Any) -> tuple[int, ...]:
    """Return the numbers of the filters of a dataset, in order of application.

    Raises
    ------
    RecordingError
        If any filter but a checksum follows the compression.
    """
    creation_properties = dataset.id.get_create_plist()
    kinds = tuple(
        creation_properties.get_filter(number)[0]
        for number in range(creation_properties.get_nfilters())
    )
    compressor_positions = [place for place, kind in enumerate(kinds) if kind in _COMPRESSORS]
    if compressor_positions and kinds[compressor_positions[0] + 1 :] not in ((), (_FLETCHER32,)):
        raise RecordingError(
            path,
            value=f"{dataset.name} with filters {list(kinds)}",
            expected="one compression (deflate (filter 1), LZF or SZIP) as the last filter",
            fix="save it again, with one compression or without",
        )
    return kinds


def _check_decompressed_chunk_sizes(
    path: Path,
    dataset: Any,
    part: ArrayPart,
    filter_ids: tuple[int, ...],
    checked_chunks: set[tuple[int, ...]],
) -> None:
    """Raise `RecordingError` if a compressed chunk holds more than a chunk of the array.

    HDF5 decompresses any amount: 2 MB can become 2 GB.
    """
    max_bytes = math.prod(dataset.chunks) * dataset.dtype.itemsize + _FILTER_OVERHEAD_BYTES
    for slices in dataset.iter_chunks(part):
        sizes = zip(slices, dataset.chunks, strict=True)
        start = tuple(axis_slice.start // size * size for axis_slice, size in sizes)
        if start in checked_chunks:
            continue
        checked_chunks.add(start)
        if not dataset.id.get_chunk_info_by_coord(start).size:  # never written
            continue
        skipped_filters, compressed = dataset.id.read_direct_chunk(start)
        used_filters = [
            kind for place, kind in enumerate(filter_ids) if not skipped_filters >> place & 1
        ]
        checksum_bytes = _CHECKSUM_BYTES if used_filters[-1:] == [_FLETCHER32] else 0
        if _exceeds_decompressed_size(
            used_filters, compressed[: len(compressed) - checksum_bytes], max_bytes
        ):
            description = (
                f"a chunk of {len(compressed)} bytes that decompresses to more than {max_bytes}"
            )
            raise memory_exceeds_file_error(path, description, file_bytes=path.stat().st_size)


def _exceeds_decompressed_size(filter_ids: list[int], compressed: bytes, max_bytes: int) -> bool:
    """Return whether a chunk decompresses to more than `max_bytes`."""
    if _DEFLATE in filter_ids:
        return exceeds_decompressed_size("zlib", {}, compressed, max_bytes)
    if _LZF in filter_ids:
        return lzf_decompressed_size(np.frombuffer(compressed, np.uint8)) > max_bytes
    # SZIP data begins with the size that the library allocates.
    return _SZIP in filter_ids and int.from_bytes(compressed[:4], "little") > max_bytes


def _unwritten_chunk_indices_or_none(
    path: Path, array: LazyArray, dataset: Any
) -> np.ndarray | None:
    """Return the chunks that were never written; None if all were."""
    if array.chunk is None:
        if dataset.id.get_storage_size() > 0:
            return None
        raise RecordingError(
            path,
            value=f"{dataset.name} is allocated, but was never written",
            expected="a dataset with samples",
            fix="record again, or name another dataset",
        )
    n_chunks = count_chunks(path, array)
    if dataset.id.get_num_chunks() >= n_chunks:
        return None
    sizes = array.chunk
    present: set[tuple[int, ...]] = set()

    def add_chunk(chunk: Any) -> None:
        starts = zip(chunk.chunk_offset, sizes, strict=True)
        present.add(tuple(start // size for start, size in starts))

    dataset.id.chunk_iter(add_chunk)
    return unwritten_chunk_indices_or_none(array, present.__contains__)
