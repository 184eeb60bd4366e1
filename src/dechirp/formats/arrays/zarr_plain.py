"""Chunks of a Zarr array that nothing compresses: read as they lie, without 1 ms for each."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numba
import numpy as np

from dechirp.core.values import value
from dechirp.formats.arrays.stored import Part

_AT_ONCE = 2**20  # bytes that are read at a time, to stay in the cache


@value
class PlainChunks:
    """Chunks of whole rows, (frame, chirp) of them to a file, the numbers one after the other."""

    folder: Path
    separator: str
    frames: int
    chirps: int
    row_shape: tuple[int, ...]
    """Of the numbers of a chirp."""
    dtype: np.dtype

    def read(self, index: int, first: int, stop: int) -> Iterator[tuple[int, np.ndarray]]:
        """Chirps of a frame, some at a time: the number of the first, and (chirp, ...).

        Raises
        ------
        OSError, ValueError
            If a file is not there, or not as long as it has to be.
        """
        row_bytes = math.prod(self.row_shape) * self.dtype.itemsize
        step = max(1, _AT_ONCE // row_bytes)
        while first < stop:
            place, row = divmod(first, self.chirps)
            n_rows = min(step, stop - first, self.chirps - row)
            rows = np.empty((n_rows, *self.row_shape), self.dtype)
            start = (index % self.frames * self.chirps + row) * row_bytes
            self._fill(rows, (index // self.frames, place), start, row_bytes)
            yield first, rows
            first += n_rows

    def part(self, part: Part) -> np.ndarray:
        """Some chirps of some frames, as `Stored.read` gives them; raises as `read`."""
        frames, chirps = part[:2]
        shape = (frames.stop - frames.start, chirps.stop - chirps.start, *self.row_shape)
        made = np.empty(shape, self.dtype)
        for index in range(frames.start, frames.stop):
            for first, rows in self.read(index, chirps.start, chirps.stop):
                at = first - chirps.start
                made[index - frames.start, at : at + len(rows)] = rows
        return made

    def _fill(self, rows: np.ndarray, place: tuple[int, int], start: int, row_bytes: int) -> None:
        key = (*place, *(0 for _ in self.row_shape))
        name = self.separator.join(("c", *map(str, key)))
        with (self.folder / name).open("rb", buffering=0) as file:
            file.seek(start)
            n_read = file.readinto(rows.data.cast("B"))
            is_whole = file.seek(0, 2) == self.frames * self.chirps * row_bytes
        if n_read != rows.nbytes or not is_whole:
            raise ValueError(f"the piece {name} has not the bytes of its numbers")


def plain_chunks(folder: Path, said: Mapping[str, Any], dtype: np.dtype) -> PlainChunks | None:
    """Chunks of an array, of what it says of itself; None where Zarr has to read them.

    Raises
    ------
    LookupError, TypeError, ValueError
        If it says nothing that makes sense.
    """
    plain = [{"name": "bytes", "configuration": {"endian": "little"}}]
    keys, chunk = said["chunk_key_encoding"], said["chunk_grid"]["configuration"]["chunk_shape"]
    separator = keys.get("configuration", {}).get("separator", "/")
    is_plain = said["codecs"] == plain and keys["name"] == "default" and separator in ("/", ".")
    if not is_plain or list(chunk[2:]) != list(said["shape"][2:]) or min(chunk) < 1:
        return None
    return PlainChunks(
        folder=folder,
        separator=separator,
        frames=chunk[0],
        chirps=chunk[1],
        row_shape=tuple(chunk[2:]),
        dtype=dtype.newbyteorder("<"),
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def scale_codes(codes: np.ndarray, scale: float, samples: np.ndarray) -> None:
    """Fill float32 samples with int16 codes in steps of `scale`, float32; both flat."""
    for k in range(len(codes)):
        samples[k] = np.float32(codes[k]) * scale
