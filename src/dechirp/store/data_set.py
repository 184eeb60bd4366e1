"""A data set on disk (zarr 3): what makes arrays of shards, and the small columns beside them."""

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

from dechirp.core.errors import DechirpError, Mistake
from dechirp.store.shards import Shards, left_over

FORMAT_VERSION = 1
GROUPS = ("settings", "truth", "detections")

Store: TypeAlias = zarr.Group

_CHUNK_BYTES = 2**22
_MAKING = ".making"


@dataclass(frozen=True)
class Column:
    """One array of small values over (point, trial, ...)."""

    path: str
    """Name, with the group before it: `truth/range`."""
    dtype: str
    dims: tuple[str, ...] = ()
    shape: tuple[int, ...] = ()
    fill: float | int | bool = 0
    """Where nothing was made."""
    attributes: Mapping[str, Any] | None = None


class Columns:
    """Columns over points and trials, written a few points at a time, in their order."""

    def __init__(
        self, store: Store, columns: Iterable[Column], n_points: int, n_trials: int
    ) -> None:
        self._columns = {one.path: one for one in columns}
        sizes = [prod(one.shape) * np.dtype(one.dtype).itemsize for one in self._columns.values()]
        self._per_slab = min(max(_CHUNK_BYTES // (n_trials * max(sizes)), 1), n_points)
        self._n_points, self._n_trials = n_points, n_trials
        self._arrays = {one.path: self._array(store, one) for one in self._columns.values()}
        self._begin(0)

    def put(self, point: int, first: int, values: Mapping[str, np.ndarray]) -> None:
        """Keep values of trials `first`, ... of a point: of each column, (n, ...)."""
        while point >= self._first + self._per_slab:
            self.end()
            self._begin(self._first + self._per_slab)
        for path, of in values.items():
            self._slab[path][point - self._first, first : first + len(of)] = of

    def end(self) -> None:
        """Write what is kept."""
        last = min(self._first + self._per_slab, self._n_points)
        for path, array in self._arrays.items():
            array[self._first : last] = self._slab[path][: last - self._first]

    def _begin(self, first: int) -> None:
        self._first = first
        self._slab = {
            path: np.full((self._per_slab, self._n_trials, *one.shape), one.fill, one.dtype)
            for path, one in self._columns.items()
        }

    def _array(self, store: Store, one: Column) -> zarr.Array[Any]:
        return store.create_array(
            one.path,
            shape=(self._n_points, self._n_trials, *one.shape),
            chunks=(self._per_slab, self._n_trials, *one.shape),
            dtype=one.dtype,
            fill_value=one.fill,
            dimension_names=("point", "trial", *one.dims),
            attributes=dict(one.attributes or {}),
        )


class Rows:
    """Columns of detections, one below the other, as long as there are any."""

    def __init__(self, store: Store, group: str, columns: Mapping[str, Column]) -> None:
        self._arrays = {
            name: store.create_array(
                f"{group}/{name}",
                shape=(0,),
                chunks=(_CHUNK_BYTES // 8,),
                dtype=one.dtype,
                dimension_names=("detection",),
                attributes=dict(one.attributes or {}),
            )
            for name, one in columns.items()
        }
        self._kept: list[Mapping[str, np.ndarray]] = []
        self._n_kept = self._n_written = 0

    @property
    def n(self) -> int:
        """Rows so far."""
        return self._n_written + self._n_kept

    def put(self, rows: Mapping[str, np.ndarray]) -> None:
        """Append rows: of each column, (n,)."""
        self._kept.append(rows)
        self._n_kept += len(next(iter(rows.values())))
        if self._n_kept >= _CHUNK_BYTES // 8:
            self._write(self._n_kept - self._n_kept % (_CHUNK_BYTES // 8))

    def end(self) -> None:
        """Write what is kept."""
        self._write(self._n_kept)

    def _write(self, n: int) -> None:
        """Write the first n that wait: whole chunks, but at the end."""
        left: dict[str, np.ndarray] = {}
        for name, array in self._arrays.items():
            waiting = np.concatenate([np.empty(0, array.dtype), *(one[name] for one in self._kept)])
            array.resize((self._n_written + n,))
            array[self._n_written :] = waiting[:n]
            left[name] = waiting[n:]
        self._kept = [left]
        self._n_kept, self._n_written = self._n_kept - n, self._n_written + n


def is_complete(folder: Path) -> bool:
    """Whether a data set can be opened: what says how to read it is written last."""
    return (folder / "zarr.json").is_file()


def missing(folder: Path, shards: Iterable[Shards], blocks: np.ndarray) -> list[str]:
    """Files of counted blocks that are not there; `blocks`: point, first trial and trials."""
    there = {one.name: _names(folder / one.name) for one in shards}
    return [
        f"{one.name}/{name}"
        for one in shards
        for point, first, n in blocks.tolist()
        for name in one.files(point, first, n)
        if name not in there[one.name]
    ]


def complete(
    folder: Path,
    shards: Iterable[Shards],
    blocks: np.ndarray,
    *,
    about: Mapping[str, xr.Dataset],
    fill: Callable[[Store], None],
) -> None:
    """Make a data set of the shards of counted blocks; others are taken away.

    `about` has small tables by group, under an empty name what stands at the top; `fill` adds
    all else. A call that is
    interrupted leaves nothing that can be opened, and the next one begins anew.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    making = folder / _MAKING
    try:
        folder.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(making, ignore_errors=True)
        _drop_others(folder, shards, blocks)
        for name, table in about.items():
            _add_table(making, name, table)
        store = zarr.open_group(making, mode="r+")
        for one in shards:
            one.empty(store)
        fill(store)
        _consolidate(making)
        if hasattr(os, "sync"):
            os.sync()
        _move(making, folder, {one.name for one in shards})
    except OSError as error:
        raise DechirpError(
            Mistake(
                setting="--out",
                got=f"{folder}, not writable ({error.strerror or error})",
                need="a folder with room",
                fix="All trials are kept. Mend it, and call again to complete the data set.",
            )
        ) from None
    finally:
        shutil.rmtree(making, ignore_errors=True)


def read_data_set(folder: Path) -> dict[str, xr.Dataset]:
    """What stands at the top (under an empty name), and the groups; read when it is asked for.

    Raises
    ------
    DechirpError
        If there is no whole data set in the folder.
    """
    if not is_complete(folder):
        raise DechirpError(
            Mistake(
                setting="data set",
                got=f"{folder}, which has no data set that is whole",
                need="the folder data.zarr of a study that has ended",
                fix="Call `dechirp study` again with the same file and folder.",
            )
        )
    names = ("", *(one for one in GROUPS if (folder / one).is_dir()))
    return {
        name: xr.open_dataset(folder, engine="zarr", group=name or None, chunks=None)
        for name in names
    }


def n_bytes(folder: Path) -> int:
    """What all of its files take."""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def _add_table(making: Path, name: str, table: xr.Dataset) -> None:
    # Texts of variable length: zarr has no settled form for those of a fixed one.
    texts = {key: v.astype(object) for key, v in table.variables.items() if v.dtype.kind == "U"}
    table.assign(texts).to_zarr(
        making, group=name or None, mode="a", zarr_format=3, consolidated=False
    )


def _consolidate(making: Path) -> None:
    """Say once more at the top of each group what is in it: it is opened at once then."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that other readers may not look at it
        for group in (*GROUPS, None):
            if group is None or (making / group).is_dir():
                zarr.consolidate_metadata(making, path=group)


def _names(folder: Path) -> set[str]:
    try:
        return {file.name for file in folder.iterdir()}
    except FileNotFoundError:
        return set()


def _drop_others(folder: Path, shards: Iterable[Shards], blocks: np.ndarray) -> None:
    """Take away shards past the end of a point, and what killed workers left."""
    for one in shards:
        wanted = {name for block in blocks.tolist() for name in one.files(*block)}
        for name in _names(folder / one.name) - wanted:
            if name.startswith("c.") or left_over(name):
                (folder / one.name / name).unlink()


def _move(making: Path, folder: Path, beside: set[str]) -> None:
    """Put what was made into its place, what says that it is a data set last."""
    for one in sorted(making.iterdir()):
        if one.name in beside:
            (one / "zarr.json").replace(folder / one.name / "zarr.json")
        elif one.is_dir():
            with suppress(FileNotFoundError):
                shutil.rmtree(folder / one.name)
            one.replace(folder / one.name)
    (making / "zarr.json").replace(folder / "zarr.json")
