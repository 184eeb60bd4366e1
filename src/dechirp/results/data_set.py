"""Data set on disk (Zarr 3): metadata of sharded arrays, and small columns next to them."""

import os
import shutil
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import xarray as xr
import zarr
from xarray.backends import BackendArray
from xarray.core import indexing

from dechirp.core.errors import DechirpError, Mistake
from dechirp.recordings.arrays.lazy_array import (
    LazyArray,
    check_plausible_size,
    convert_parser_errors,
)
from dechirp.recordings.arrays.zarr_arrays import find_absent_chunks, list_files_and_total_size
from dechirp.results.shards import ShardedArray, is_temporary_shard_file

FORMAT_VERSION = 1
MARK = "dechirp_data_set"
"""Attribute of the root group with the version of the format; recordings have none."""
GROUPS = ("settings", "truth", "detections")
EXPECTED = "an unchanged data set of a study"

Store: TypeAlias = zarr.Group

_CHUNK_BYTES = 2**22
_STAGING_FOLDER = ".making"


@dataclass(frozen=True)
class TrialColumn:
    """One array of small values over (point, trial, ...)."""

    path: str
    """Name, with its group: `truth/range`."""
    dtype: str
    dims: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    fill_value: float | int | bool = 0
    """Value of trials without a result."""
    attributes: Mapping[str, Any] | None = None


class TrialColumns:
    """Columns over points and trials, written several points at a time, in order."""

    def __init__(
        self, store: Store, columns: Iterable[TrialColumn], n_points: int, n_trials: int
    ) -> None:
        self._columns = {column.path: column for column in columns}
        sizes = [
            prod(column.shape) * np.dtype(column.dtype).itemsize
            for column in self._columns.values()
        ]
        self._per_slab = min(max(_CHUNK_BYTES // (n_trials * max(sizes)), 1), n_points)
        self._n_points, self._n_trials = n_points, n_trials
        self._arrays = {
            column.path: self._create_trial_array(store, column)
            for column in self._columns.values()
        }
        self._start_trial_buffer(0)

    def buffer_trial_values(
        self, point: int, first_trial: int, values: Mapping[str, np.ndarray]
    ) -> None:
        """Buffer the values of trials `first_trial`, ... of a point: (n, ...) for each column."""
        while point >= self._first + self._per_slab:
            self.flush()
            self._start_trial_buffer(self._first + self._per_slab)
        for path, trial_values in values.items():
            self._slab[path][point - self._first, first_trial : first_trial + len(trial_values)] = (
                trial_values
            )

    def flush(self) -> None:
        """Write the buffered values."""
        last = min(self._first + self._per_slab, self._n_points)
        for path, array in self._arrays.items():
            array[self._first : last] = self._slab[path][: last - self._first]

    def _start_trial_buffer(self, first_point: int) -> None:
        self._first = first_point
        self._slab = {
            path: np.full(
                (self._per_slab, self._n_trials, *column.shape), column.fill_value, column.dtype
            )
            for path, column in self._columns.items()
        }

    def _create_trial_array(self, store: Store, column: TrialColumn) -> zarr.Array[Any]:
        return store.create_array(
            column.path,
            shape=(self._n_points, self._n_trials, *column.shape),
            chunks=(self._per_slab, self._n_trials, *column.shape),
            dtype=column.dtype,
            fill_value=column.fill_value,
            dimension_names=("point", "trial", *column.dims),
            attributes=dict(column.attributes or {}),
        )


class DetectionRows:
    """Growing columns of detections, one row for each detection."""

    def __init__(self, store: Store, group: str, columns: Mapping[str, TrialColumn]) -> None:
        self._arrays = {
            name: store.create_array(
                f"{group}/{name}",
                shape=(0,),
                chunks=(_CHUNK_BYTES // 8,),
                dtype=column.dtype,
                dimension_names=("detection",),
                attributes=dict(column.attributes or {}),
            )
            for name, column in columns.items()
        }
        self._pending: list[Mapping[str, np.ndarray]] = []
        self._n_pending = self._n_written = 0

    @property
    def n_rows(self) -> int:
        """Number of rows so far."""
        return self._n_written + self._n_pending

    def append_rows(self, rows: Mapping[str, np.ndarray]) -> None:
        """Append rows: (n,) for each column."""
        self._pending.append(rows)
        self._n_pending += len(next(iter(rows.values())))
        if self._n_pending >= _CHUNK_BYTES // 8:
            self._write_pending_rows(self._n_pending - self._n_pending % (_CHUNK_BYTES // 8))

    def flush(self) -> None:
        """Write the pending rows."""
        self._write_pending_rows(self._n_pending)

    def _write_pending_rows(self, n: int) -> None:
        """Write the first n pending rows: complete chunks, except at the end."""
        remaining: dict[str, np.ndarray] = {}
        for name, array in self._arrays.items():
            waiting = np.concatenate(
                [np.empty(0, array.dtype), *(rows[name] for rows in self._pending)]
            )
            array.resize((self._n_written + n,))
            array[self._n_written :] = waiting[:n]
            remaining[name] = waiting[n:]
        self._pending = [remaining]
        self._n_pending, self._n_written = self._n_pending - n, self._n_written + n


def is_data_set_complete(folder: Path) -> bool:
    """Return True if a data set can be opened: its metadata is written last."""
    return (folder / "zarr.json").is_file()


def is_data_set(folder: Path) -> bool:
    """Return True if a Zarr folder is a complete data set, and no recording."""
    return is_data_set_complete(folder) and MARK.encode() in (folder / "zarr.json").read_bytes()


def missing_shard_files(
    folder: Path, shards: Iterable[ShardedArray], counted_blocks: np.ndarray
) -> list[str]:
    """List the absent shard files of counted blocks.

    `counted_blocks`: point, first trial and number of trials of each.
    """
    present = {array.name: _file_names(folder / array.name) for array in shards}
    return [
        f"{array.name}/{name}"
        for array in shards
        for point, first, n in counted_blocks.tolist()
        for name in array.shard_names_of_trials(point, first, n)
        if name not in present[array.name]
    ]


def finalise_data_set(
    folder: Path,
    shards: Iterable[ShardedArray],
    counted_blocks: np.ndarray,
    *,
    tables: Mapping[str, xr.Dataset],
    add_columns: Callable[[Store], None],
) -> None:
    """Complete the data set of counted blocks: write its metadata and columns, remove other shards.

    `tables` contains small tables by group, the root group under an empty name; `add_columns`
    writes all other columns. An interrupted call leaves nothing that can be opened, and the next
    call starts afresh.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    staging = folder / _STAGING_FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(staging, ignore_errors=True)
        _remove_uncounted_shards(folder, shards, counted_blocks)
        for name, table in tables.items():
            _write_zarr_group(staging, name, table)
        store = zarr.open_group(staging, mode="r+")
        for array in shards:
            array.create_array_metadata(store)
        add_columns(store)
        _consolidate_zarr_metadata(staging)
        if hasattr(os, "sync"):
            os.sync()
        _move_staged_files_into_place(staging, folder, {array.name for array in shards})
    except OSError as error:
        raise DechirpError(
            Mistake(
                setting="--out",
                value=f"{folder}, not writable ({error.strerror or error})",
                expected="a folder with room",
                fix="correct this and call again to complete the data set; all trials are kept",
            )
        ) from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def open_data_set_groups(folder: Path) -> dict[str, xr.Dataset]:
    """Open the root group (under an empty name) and the other groups, lazily.

    Raises
    ------
    DechirpError
        If the folder has no complete data set.
    RecordingError
        If its metadata or coordinates are damaged. Damage of other arrays raises it when they
        are loaded.
    """
    if not is_data_set_complete(folder):
        raise DechirpError(
            Mistake(
                setting="data set",
                value=f"{folder}, without a complete data set",
                expected="the folder data.zarr of a completed study",
                fix="call `dechirp study` again with the same file and folder",
            )
        )
    names = ("", *(group for group in GROUPS if (folder / group).is_dir()))
    with convert_parser_errors(folder, EXPECTED):
        for name in names:  # each has metadata of its own arrays, which xarray reads
            _check_coordinate_sizes(folder, zarr.open_group(folder, path=name or None, mode="r"))
        groups = {
            name: xr.open_dataset(folder, engine="zarr", group=name or None, chunks=None)
            for name in names
        }
    return {name: _convert_errors_of_lazy_arrays(group, folder) for name, group in groups.items()}


class _CheckedArray(BackendArray):
    """Lazy array that raises `RecordingError` if its part of the data set is damaged."""

    def __init__(self, variable: xr.Variable, folder: Path) -> None:
        self._variable, self._folder = variable, folder
        self.shape, self.dtype = variable.shape, variable.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self._read_part
        )

    def _read_part(self, part: tuple[Any, ...]) -> np.ndarray:
        with convert_parser_errors(self._folder, EXPECTED):
            return self._variable[part].to_numpy()


def _convert_errors_of_lazy_arrays(group: xr.Dataset, folder: Path) -> xr.Dataset:
    """Replace the lazy arrays of a group by ones that raise `RecordingError`."""
    checked = {}
    for name, array in group.data_vars.items():
        lazy_array = indexing.LazilyIndexedArray(_CheckedArray(array.variable, folder))
        cached = indexing.MemoryCachedArray(lazy_array)  # type: ignore[no-untyped-call]
        checked[name] = (array.dims, cached, array.attrs, array.encoding)
    return group.assign(checked)


def _check_coordinate_sizes(folder: Path, group: Store) -> None:
    """Raise `RecordingError` if a coordinate, which opening loads, exceeds what files can hold."""
    for name, array in group.arrays():
        if getattr(array.metadata, "dimension_names", None) == (name,):
            _check_array_size(folder, array)


def _check_array_size(folder: Path, array: Any) -> None:
    """Raise `RecordingError` if an array exceeds what its files can hold."""
    lazy_array = LazyArray(
        shape=array.shape, dtype=np.dtype(array.dtype), read=array.__getitem__, chunk=array.chunks
    )
    files, n_bytes = list_files_and_total_size(folder / array.path)
    check_plausible_size(folder, lazy_array, file_bytes=n_bytes)
    encode_key = array.metadata.encode_chunk_key
    find_absent_chunks(folder, lazy_array, lambda index: encode_key(index) in files)


def folder_size_bytes(folder: Path) -> int:
    """Return the total size of all files in a folder."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _write_zarr_group(staging: Path, group: str, table: xr.Dataset) -> None:
    # Variable-length texts: Zarr has no stable specification of fixed-length ones.
    texts = {key: v.astype(object) for key, v in table.variables.items() if v.dtype.kind == "U"}
    table.assign(texts).to_zarr(
        staging, group=group or None, mode="a", zarr_format=3, consolidated=False
    )


def _consolidate_zarr_metadata(staging: Path) -> None:
    """Copy the metadata of all arrays into their groups, so that opening needs one read."""
    with warnings.catch_warnings():
        # Other readers may ignore consolidated metadata.
        warnings.simplefilter("ignore", UserWarning)
        for group in (*GROUPS, None):
            if group is None or (staging / group).is_dir():
                zarr.consolidate_metadata(staging, path=group)


def _file_names(folder: Path) -> set[str]:
    try:
        return {file.name for file in folder.iterdir()}
    except FileNotFoundError:
        return set()


def _remove_uncounted_shards(
    folder: Path, shards: Iterable[ShardedArray], counted_blocks: np.ndarray
) -> None:
    """Remove shards past the end of a point, and temporary files of killed workers."""
    for array in shards:
        wanted = {
            name
            for block in counted_blocks.tolist()
            for name in array.shard_names_of_trials(*block)
        }
        for name in _file_names(folder / array.name) - wanted:
            if name.startswith("c.") or is_temporary_shard_file(name):
                (folder / array.name / name).unlink()


def _move_staged_files_into_place(staging: Path, folder: Path, shard_folders: set[str]) -> None:
    """Move the staged files into place, the metadata that marks a data set last."""
    for item in sorted(staging.iterdir()):
        if item.name in shard_folders:
            (item / "zarr.json").replace(folder / item.name / "zarr.json")
        elif item.is_dir():
            with suppress(FileNotFoundError):
                shutil.rmtree(folder / item.name)
            item.replace(folder / item.name)
    (staging / "zarr.json").replace(folder / "zarr.json")
