"""Tables beside the samples in a Zarr store: each a group, as xarray writes it."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.formats.arrays.stored import ALLOWED_BYTES, Stored, must_be_plausible, parsing
from dechirp.formats.arrays.zarr_chunks import must_unpack_to_size, packing_in
from dechirp.formats.zarr_array import (
    files_in,
    metadata_of,
    opened_array,
    read_array,
    read_json,
    unknown_codecs,
)

_MARK = "zarr.json"
_NEED = "a table as it was written: a Zarr group of version 3"
_TEXTS = "vlen-utf8"
_LONGEST_TEXT = 10_000


class Tables(Mapping[str, xr.Dataset]):
    """Groups of a store, read when they are asked for; raises `RecordingError` as it is read."""

    def __init__(self, store: Path, *, without: tuple[str, ...] = ()) -> None:
        marks = sorted(store.glob(f"*/{_MARK}"))
        self._folders = {
            mark.parent.name: mark.parent
            for mark in marks
            if mark.parent.name not in without and not mark.parent.is_symlink()
            if _node_type(mark) == "group"
        }
        self._read: dict[str, xr.Dataset] = {}

    def __getitem__(self, name: str) -> xr.Dataset:
        """Table of that name."""
        if name not in self._read:
            self._read[name] = _table(self._folders[name])
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the tables."""
        return iter(self._folders)

    def __len__(self) -> int:
        """Number of tables."""
        return len(self._folders)


def _node_type(mark: Path) -> Any:
    with parsing(mark.parent, _NEED):
        return read_json(mark).get("node_type")


def _table(folder: Path) -> xr.Dataset:
    with parsing(folder, _NEED):
        attributes = dict(read_json(folder / _MARK).get("attributes") or {})
        coordinates = set(str(attributes.pop("coordinates", "")).split())
        variables = {}
        for mark in sorted(folder.glob(f"*/{_MARK}")):
            name, array = mark.parent.name, mark.parent
            said = metadata_of(array) or {}
            about = dict(said.get("attributes") or {})
            about.pop("_FillValue", None)  # of floats: NaN, which is NaN anyway
            coordinates |= set(str(about.pop("coordinates", "")).split())
            is_text = said.get("data_type") == "string"
            values = _texts(folder, array) if is_text else read_array(folder, array)
            if about.get("dtype") == "bool":  # flags, as xarray wrote them before 2026.9
                values, _ = values.astype(bool), about.pop("dtype")
            variables[name] = xr.Variable(tuple(said.get("dimension_names") or ()), values, about)
        made = xr.Dataset(variables, attrs=attributes)
        return made.set_coords([name for name in coordinates if name in variables])


def _texts(path: Path, folder: Path) -> np.ndarray:
    foreign = set(unknown_codecs(folder)) - {_TEXTS}
    if foreign:
        raise ValueError(f"{folder.name} needs the codec {', '.join(sorted(foreign))}")
    files, n_bytes = files_in(folder)
    array = opened_array(folder)
    lengths = Stored(  # of each text, in 4 bytes
        shape=array.shape, dtype=np.dtype(np.int32), read=array.__getitem__, chunk=array.chunks
    )
    must_be_plausible(path, lengths, file_bytes=n_bytes)
    said = array.metadata.to_dict()
    rest = [one for one in said["codecs"] if one["name"] != _TEXTS]
    packing = packing_in(path, {**said, "codecs": rest}, (2 * n_bytes + ALLOWED_BYTES,), 1)
    for name in files - {_MARK}:
        must_unpack_to_size(path, folder / name, packing)
    read = np.asarray(array[...], object)
    if max((len(text) for text in read.ravel()), default=0) > _LONGEST_TEXT:
        raise ValueError(f"{folder.name} has texts of more than {_LONGEST_TEXT} characters")
    return np.asarray(read, str)
