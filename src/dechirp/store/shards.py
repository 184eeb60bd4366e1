"""Large arrays over points and trials, one file for each shard: some trials of one point.

Whoever has the trials writes their files, on any machine, whole and durable, and twice the same.
What makes an array of them is written last, see `data_set.py`.
"""

import os
import re
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.abc.buffer import Buffer
from zarr.codecs import BloscCodec
from zarr.storage import MemoryStore

from dechirp.core.errors import DechirpError, Mistake

SHARD_BYTES = 2**26
"""A shard is held in memory twice: as numbers, and packed."""

# Of 14 MB cubes and 28 MB maps: 0.56 of codes of 30 steps of noise, 0.75 of maps, 1.00 of noise
# that fills the numbers. zstd takes as much room, and one and a half times as long.
_PACKED = BloscCodec(cname="lz4", shuffle="bitshuffle")
_NAMES: Any = {"name": "default", "separator": "."}  # one folder, not one for each axis


@dataclass(frozen=True)
class Shards:
    """An array of whole numbers, int16, over (point, trial, ...)."""

    name: str
    dims: tuple[str, ...]
    """Of an item; the first of them, as a rule the frame, is a chunk each."""
    shape: tuple[int, ...]
    n_points: int
    n_trials: int
    block: int
    """Trials in a block; a shard has as many, or an equal part of them."""
    attributes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def item_bytes(self) -> int:
        """Of one item, before it is packed."""
        return 2 * prod(self.shape)

    @property
    def per_shard(self) -> int:
        """Trials in a shard: the most that fit and divide a block; at least one."""
        block = min(self.block, self.n_trials)
        fits = max(SHARD_BYTES // self.item_bytes, 1)
        return next(n for n in range(min(block, fits), 0, -1) if block % n == 0)

    def empty(self, store: zarr.Group) -> None:
        """Write what says how to read the shards, not one of them."""
        self._array(store, self.n_points, self.n_trials)

    def write(self, folder: Path, point: int, first: int, items: np.ndarray) -> None:
        """Write the shard of the trials `first`, `first + 1`, ... of a point, durable on return.

        `items`: int16, (n, ...), fewer than `per_shard` where the point has no more.

        Raises
        ------
        DechirpError
            If it cannot be written, or the disk is full.
        """
        memory: dict[str, Buffer] = {}
        array = self._array(zarr.create_group(MemoryStore(memory)), 1, self.per_shard)
        array[0, : len(items)] = items
        content = memory[f"{self.name}/{self._key(0, 0)}"].to_bytes()
        _write_durable(folder / self.name / self._key(point, first // self.per_shard), content)

    def files(self, point: int, first: int, n: int) -> Iterable[str]:
        """Names of the shards of n trials of a point, from the first of a block on."""
        for number in range(first // self.per_shard, -(-(first + n) // self.per_shard)):
            yield self._key(point, number)

    def _key(self, point: int, number: int) -> str:
        return ".".join(["c", str(point), str(number), *("0" for _ in self.shape)])

    def _array(self, store: zarr.Group, n_points: int, n_trials: int) -> zarr.Array[Any]:
        return store.create_array(
            self.name,
            shape=(n_points, n_trials, *self.shape),
            chunks=(1, 1, 1, *self.shape[1:]),
            shards=(1, self.per_shard, *self.shape),
            dtype="int16",
            compressors=_PACKED,
            chunk_key_encoding=_NAMES,
            dimension_names=("point", "trial", *self.dims),
            attributes=dict(self.attributes),
            config={"write_empty_chunks": True},  # a shard of zeros is a file all the same
        )


def _write_durable(path: Path, content: bytes) -> None:
    """Write a file that is whole, or not there, also after a loss of power."""
    made = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with made.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            made.replace(path)
        finally:
            made.unlink(missing_ok=True)
        if os.name == "posix":
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except OSError as error:
        raise DechirpError(
            Mistake(
                setting="--out",
                got=f"{path.parent}, not writable ({error.strerror or error})",
                need="a folder with room that every worker can write",
                fix="What was done before is kept. Mend it, and call again to go on.",
            )
        ) from None


def left_over(name: str) -> bool:
    """Whether a file is what a worker left that was killed while it wrote."""
    return re.fullmatch(r"\.c\.[0-9.]+\.[0-9a-f]{8}", name) is not None
