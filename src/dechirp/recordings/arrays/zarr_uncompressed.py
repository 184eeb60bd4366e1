"""Uncompressed chunks of a Zarr array, read directly, without 1 ms of overhead for each."""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.core.compiled_kernels import kernel
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import ArrayPart

_BLOCK_BYTES = 2**20  # bytes read at a time, small enough for the cache


@frozen_dataclass
class UncompressedChunks:
    """Chunks of complete rows, (frame, chirp) of them to a file, in C order."""

    folder: Path
    separator: str
    frames_per_chunk: int
    chirps_per_chunk: int
    row_shape: tuple[int, ...]
    """Shape of the numbers of a chirp."""
    dtype: np.dtype

    def iter_chirp_blocks(
        self, frame_index: int, first_chirp: int, stop_chirp: int
    ) -> Iterator[tuple[int, np.ndarray]]:
        """Yield chirps of a frame block by block: the number of the first, and (chirp, ...).

        Raises
        ------
        OSError, ValueError
            If a file is missing or has a wrong size.
        """
        row_bytes = math.prod(self.row_shape) * self.dtype.itemsize
        step = max(1, _BLOCK_BYTES // row_bytes)
        while first_chirp < stop_chirp:
            place, row = divmod(first_chirp, self.chirps_per_chunk)
            n_rows = min(step, stop_chirp - first_chirp, self.chirps_per_chunk - row)
            rows = np.empty((n_rows, *self.row_shape), self.dtype)
            start = (frame_index % self.frames_per_chunk * self.chirps_per_chunk + row) * row_bytes
            self._fill_chirps_from_chunk_file(
                rows, (frame_index // self.frames_per_chunk, place), start, row_bytes
            )
            yield first_chirp, rows
            first_chirp += n_rows

    def read_array_part(self, part: ArrayPart) -> np.ndarray:
        """Read some chirps of some frames, as `LazyArray.read`; raises as `iter_chirp_blocks`."""
        frames, chirps = part[:2]
        shape = (frames.stop - frames.start, chirps.stop - chirps.start, *self.row_shape)
        values = np.empty(shape, self.dtype)
        for index in range(frames.start, frames.stop):
            for first, rows in self.iter_chirp_blocks(index, chirps.start, chirps.stop):
                row = first - chirps.start
                values[index - frames.start, row : row + len(rows)] = rows
        return values

    def _fill_chirps_from_chunk_file(
        self,
        chirps: np.ndarray,
        chunk_index: tuple[int, int],
        start_byte: int,
        bytes_per_chirp: int,
    ) -> None:
        """Fill rows from the file of a chunk."""
        key = (*chunk_index, *(0 for _ in self.row_shape))
        name = self.separator.join(("c", *map(str, key)))
        with (self.folder / name).open("rb", buffering=0) as file:
            file.seek(start_byte)
            n_read = file.readinto(chirps.data.cast("B"))
            is_whole = (
                file.seek(0, 2) == self.frames_per_chunk * self.chirps_per_chunk * bytes_per_chirp
            )
        if n_read != chirps.nbytes or not is_whole:
            raise ValueError(f"the chunk {name} has a wrong size")


def parse_uncompressed_chunks(
    folder: Path, metadata: Mapping[str, Any], dtype: np.dtype
) -> UncompressedChunks | None:
    """Return the chunks described by the metadata of an array; None if Zarr has to read them.

    Raises
    ------
    LookupError, TypeError, ValueError
        If the metadata are invalid.
    """
    uncompressed_codecs = [{"name": "bytes", "configuration": {"endian": "little"}}]
    keys, chunk = (
        metadata["chunk_key_encoding"],
        metadata["chunk_grid"]["configuration"]["chunk_shape"],
    )
    separator = keys.get("configuration", {}).get("separator", "/")
    is_supported = (
        metadata["codecs"] == uncompressed_codecs
        and keys["name"] == "default"
        and separator in ("/", ".")
    )
    if not is_supported or list(chunk[2:]) != list(metadata["shape"][2:]) or min(chunk) < 1:
        return None
    return UncompressedChunks(
        folder=folder,
        separator=separator,
        frames_per_chunk=chunk[0],
        chirps_per_chunk=chunk[1],
        row_shape=tuple(chunk[2:]),
        dtype=dtype.newbyteorder("<"),
    )


def _scale_codes_into_samples_in_numpy(
    codes: np.ndarray, scale: float, samples: np.ndarray
) -> None:
    np.multiply(codes, np.float32(scale), out=samples)


@kernel(plain=_scale_codes_into_samples_in_numpy)
def scale_codes_into_samples(codes: np.ndarray, scale: float, samples: np.ndarray) -> None:
    """Fill float32 samples with int16 codes times `scale`, float32; both flat."""
    for k in range(len(codes)):
        samples[k] = np.float32(codes[k]) * scale
