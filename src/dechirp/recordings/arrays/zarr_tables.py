"""Tables beside the samples in a Zarr store: groups, as xarray writes them."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.recordings.arrays.lazy_array import (
    ALLOWED_BYTES,
    LazyArray,
    check_plausible_size,
    convert_parser_errors,
)
from dechirp.recordings.arrays.zarr_arrays import (
    find_absent_chunks,
    find_unsupported_codecs,
    list_files_and_total_size,
    open_zarr_array,
    read_array_metadata,
    read_json_object,
    read_small_array,
)
from dechirp.recordings.arrays.zarr_chunks import (
    check_chunk_file_decompressed_size,
    parse_chunk_compression,
)

_MARK = "zarr.json"
_EXPECTED = "an unchanged table: a Zarr group of version 3"
_STRING_CODEC = "vlen-utf8"
_MAX_TEXT_CHARACTERS = 10_000


class ZarrTables(Mapping[str, xr.Dataset]):
    """Groups of a store, read on first use; raises `RecordingError` if one is damaged."""

    def __init__(self, store: Path, *, without: tuple[str, ...] = ()) -> None:
        marks = sorted(store.glob(f"*/{_MARK}"))
        self._folders = {
            mark.parent.name: mark.parent
            for mark in marks
            if mark.parent.name not in without and not mark.parent.is_symlink()
            if _read_node_type(mark) == "group"
        }
        self._read: dict[str, xr.Dataset] = {}

    def __getitem__(self, name: str) -> xr.Dataset:
        if name not in self._read:
            self._read[name] = _read_group_as_dataset(self._folders[name])
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._folders)

    def __len__(self) -> int:
        return len(self._folders)


def _read_node_type(metadata_file: Path) -> Any:
    """Return the node type in a metadata file."""
    with convert_parser_errors(metadata_file.parent, _EXPECTED):
        return read_json_object(metadata_file).get("node_type")


def _read_group_as_dataset(folder: Path) -> xr.Dataset:
    """Read a group as a dataset."""
    with convert_parser_errors(folder, _EXPECTED):
        attributes = dict(read_json_object(folder / _MARK).get("attributes") or {})
        coordinates = set(str(attributes.pop("coordinates", "")).split())
        variables = {}
        for mark in sorted(folder.glob(f"*/{_MARK}")):
            name, array = mark.parent.name, mark.parent
            metadata = read_array_metadata(array) or {}
            variable_attributes = dict(metadata.get("attributes") or {})
            # NaN for floats, which needs no replacement.
            variable_attributes.pop("_FillValue", None)
            coordinates |= set(str(variable_attributes.pop("coordinates", "")).split())
            is_text = metadata.get("data_type") == "string"
            values = (
                _read_string_array(folder, array) if is_text else read_small_array(folder, array)
            )
            # Flags as written by xarray before 2026.9.
            if variable_attributes.get("dtype") == "bool":
                values, _ = values.astype(bool), variable_attributes.pop("dtype")
            variables[name] = xr.Variable(
                tuple(metadata.get("dimension_names") or ()), values, variable_attributes
            )
        table = xr.Dataset(variables, attrs=attributes)
        return table.set_coords([name for name in coordinates if name in variables])


def _read_string_array(path: Path, folder: Path) -> np.ndarray:
    """Read an array of texts, limited in size and length."""
    unsupported_codecs = set(find_unsupported_codecs(folder)) - {_STRING_CODEC}
    if unsupported_codecs:
        raise ValueError(f"{folder.name} needs the codec {', '.join(sorted(unsupported_codecs))}")
    files, n_bytes = list_files_and_total_size(folder)
    array = open_zarr_array(folder)
    lengths = LazyArray(  # length of each text, 4 bytes
        shape=array.shape,
        dtype=np.dtype(np.int32),
        read=array.__getitem__,
        chunk=array.shards or array.chunks,
    )
    check_plausible_size(path, lengths, file_bytes=n_bytes)
    encode_key = array.metadata.encode_chunk_key
    find_absent_chunks(path, lengths, lambda index: encode_key(index) in files)
    metadata = array.metadata.to_dict()
    other_codecs = [codec for codec in metadata["codecs"] if codec["name"] != _STRING_CODEC]
    layout = parse_chunk_compression(
        path, {**metadata, "codecs": other_codecs}, (2 * n_bytes + ALLOWED_BYTES,), 1
    )
    for name in files - {_MARK}:
        check_chunk_file_decompressed_size(path, folder / name, layout)
    strings = np.asarray(array[...], object)
    if max((len(text) for text in strings.ravel()), default=0) > _MAX_TEXT_CHARACTERS:
        raise ValueError(f"{folder.name} has texts of more than {_MAX_TEXT_CHARACTERS} characters")
    return np.asarray(strings, str)
