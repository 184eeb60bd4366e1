"""Large arrays over points and trials, one file for each shard: several trials of one point.

Any worker that has the trials writes their files, on any machine, durably and reproducibly. The
array metadata is written last, see `data_set.py`.
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
"""Shard size; a shard is in memory twice, as numbers and compressed."""

# Compressed size of 14 MB cubes and 28 MB maps: 0.56 for codes with 30 steps of noise, 0.75 for
# maps, 1.00 for full-range noise. zstd needs as much space and 1.5 times as long.
_COMPRESSOR = BloscCodec(cname="lz4", shuffle="bitshuffle")
_CHUNK_KEYS: Any = {"name": "default", "separator": "."}  # one folder instead of one for each axis


@dataclass(frozen=True)
class ShardedArray:
    """Array of int16 over (point, trial, ...)."""

    name: str
    dims: tuple[str, ...]
    """Axes of an item; each index of the first, usually the frame, is a chunk."""
    shape: tuple[int, ...]
    n_points: int
    n_trials: int
    trials_per_block: int
    """Trials in a block; a shard has as many, or an equal part of them."""
    attributes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def uncompressed_item_bytes(self) -> int:
        """Uncompressed size of one item."""
        return 2 * prod(self.shape)

    @property
    def trials_per_shard(self) -> int:
        """Trials in a shard: the most that fit and divide a block; at least one."""
        block = min(self.trials_per_block, self.n_trials)
        fits = max(SHARD_BYTES // self.uncompressed_item_bytes, 1)
        return next(n for n in range(min(block, fits), 0, -1) if block % n == 0)

    def create_array_metadata(self, store: zarr.Group) -> None:
        """Write the metadata of the array, but no shard."""
        self._create_sharded_array(store, self.n_points, self.n_trials)

    def write_shard(self, folder: Path, point: int, first_trial: int, items: np.ndarray) -> None:
        """Write the shard of the trials `first_trial`, `first + 1`, ... of a point, durably.

        `items`: int16, (n, ...), fewer than `trials_per_shard` at the end of a point.

        Raises
        ------
        DechirpError
            If it cannot be written, or the disk is full.
        """
        memory: dict[str, Buffer] = {}
        array = self._create_sharded_array(
            zarr.create_group(MemoryStore(memory)), 1, self.trials_per_shard
        )
        array[0, : len(items)] = items
        content = memory[f"{self.name}/{self._shard_file_name(0, 0)}"].to_bytes()
        _write_file_durably(
            folder / self.name / self._shard_file_name(point, first_trial // self.trials_per_shard),
            content,
        )

    def shard_names_of_trials(self, point: int, first_trial: int, n_trials: int) -> Iterable[str]:
        """Yield the shard names of n trials of a point, from the first trial of a block on."""
        for number in range(
            first_trial // self.trials_per_shard,
            -(-(first_trial + n_trials) // self.trials_per_shard),
        ):
            yield self._shard_file_name(point, number)

    def _shard_file_name(self, point: int, shard_number: int) -> str:
        return ".".join(["c", str(point), str(shard_number), *("0" for _ in self.shape)])

    def _create_sharded_array(
        self, store: zarr.Group, n_points: int, n_trials: int
    ) -> zarr.Array[Any]:
        return store.create_array(
            self.name,
            shape=(n_points, n_trials, *self.shape),
            chunks=(1, 1, 1, *self.shape[1:]),
            shards=(1, self.trials_per_shard, *self.shape),
            dtype="int16",
            compressors=_COMPRESSOR,
            chunk_key_encoding=_CHUNK_KEYS,
            dimension_names=("point", "trial", *self.dims),
            attributes=dict(self.attributes),
            config={"write_empty_chunks": True},  # shards of zeros are files, too
        )


def _write_file_durably(path: Path, content: bytes) -> None:
    """Write a file atomically, also in case of a power failure."""
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
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
                value=f"{path.parent}, not writable ({error.strerror or error})",
                expected="a folder with room that every worker can write",
                fix="correct this and call again to continue; earlier results are kept",
            )
        ) from None


def is_temporary_shard_file(name: str) -> bool:
    """Return True for the temporary file of a worker that was killed while writing."""
    return re.fullmatch(r"\.c\.[0-9.]+\.[0-9a-f]{8}", name) is not None
