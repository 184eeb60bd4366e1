"""Lazy arrays over memory-mapped and sequentially compressed files."""

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.recordings.arrays.lazy_array import ArrayPart, LazyArray, convert_parser_errors

_BLOCK_BYTES = 2**24
_READ_BYTES = 2**18
CACHE_BYTES = 2**26
"""Size up to which the last block of a compressed array stays in memory for the next frame."""


def open_memory_mapped_array(
    path: Path,
    dtype: np.dtype,
    shape: tuple[int, ...],
    *,
    offset: int = 0,
    fortran: bool = False,
) -> LazyArray:
    """Open an array that lies in a file as it would in memory.

    The file is mapped anew for each block, because the pages of a mapping count as memory of the
    process until it is closed.
    """
    slowest_axis = _slowest_axis(shape, fortran)
    order: Literal["C", "F"] = "F" if fortran else "C"
    row_bytes = math.prod(shape) // shape[slowest_axis] * dtype.itemsize
    step = max(1, _BLOCK_BYTES // row_bytes)

    def read(part: ArrayPart) -> np.ndarray:
        # In the order of the file: a copy into another one takes 3 times as long.
        sizes = [axis_slice.stop - axis_slice.start for axis_slice in part]
        values = np.empty(sizes, dtype, order=order)
        start = part[slowest_axis].start
        faster_axes = slice(slowest_axis) if fortran else slice(slowest_axis + 1, None)
        if tuple(sizes[faster_axes]) == shape[faster_axes]:
            # Adjacent bytes: 0.03 ms for a small frame, a mapping takes 0.15.
            _read_adjacent(path, offset + start * row_bytes, values.T if fortran else values)
            return values
        for first in range(start, part[slowest_axis].stop, step):
            rows = slice(first, min(first + step, part[slowest_axis].stop))
            block = (*part[:slowest_axis], rows, *part[slowest_axis + 1 :])
            target = [slice(None)] * len(shape)
            target[slowest_axis] = slice(rows.start - start, rows.stop - start)
            with _convert_changed_file_errors(path):
                mapping = np.memmap(path, dtype, "r", offset=offset, shape=shape, order=order)
                values[tuple(target)] = mapping[block]
        return values

    return LazyArray(shape=shape, dtype=dtype, read=read)


def _read_adjacent(path: Path, first_byte: int, values: np.ndarray) -> None:
    """Fill contiguous `values` from a byte of a file on."""
    into = values.view(np.uint8).reshape(-1).data
    with _convert_changed_file_errors(path), path.open("rb", buffering=0) as file:
        file.seek(first_byte)
        filled = 0
        while filled < len(into):
            n_bytes = file.readinto(into[filled:])
            if not n_bytes:
                raise ValueError("the file is too short")
            filled += n_bytes


class InflateStream:
    """Sequential reader of deflate-compressed bytes of a file.

    Reading backwards restarts from the beginning. The file is open only during a read.
    """

    def __init__(self, path: Path, start: int, n_bytes: int, *, expected: str, wbits: int) -> None:
        self._path, self._need, self._wbits = path, expected, wbits
        self._start, self._end = start, start + n_bytes
        self._restart_from_beginning()

    def _restart_from_beginning(self) -> None:
        self._inflater = zlib.decompressobj(self._wbits)
        self._packed_at = self._start
        self._at = 0

    def decompress_into(self, first_byte: int, into: np.ndarray) -> None:
        """Fill uint8 `into` with the decompressed bytes from `first_byte` on."""
        with convert_parser_errors(self._path, self._need):
            if first_byte < self._at:
                self._restart_from_beginning()
            while self._at < first_byte:
                self._inflate_next_bytes(first_byte - self._at)
            filled = 0
            while filled < into.size:
                block = self._inflate_next_bytes(into.size - filled)
                into[filled : filled + len(block)] = np.frombuffer(block, np.uint8)
                filled += len(block)

    def read_first_bytes(self, n_bytes: int) -> bytes:
        """Return at most the first `n_bytes` decompressed bytes."""
        blocks: list[bytes] = []
        with convert_parser_errors(self._path, self._need), suppress(EOFError):
            self._restart_from_beginning()
            while self._at < n_bytes:
                blocks.append(self._inflate_next_bytes(n_bytes - self._at))
        return b"".join(blocks)

    def _inflate_next_bytes(self, max_bytes: int) -> bytes:
        """Return the next decompressed bytes, at least one and at most `max_bytes`."""
        while True:
            packed = self._inflater.unconsumed_tail or self._read_next_compressed_bytes()
            block = self._inflater.decompress(packed, min(max_bytes, _READ_BYTES))
            if block:
                self._at += len(block)
                return block
            if not packed:
                raise EOFError(f"data end after {self._at} bytes")

    def _read_next_compressed_bytes(self) -> bytes:
        with self._path.open("rb") as file:
            file.seek(self._packed_at)
            packed = file.read(min(_READ_BYTES, self._end - self._packed_at))
        self._packed_at += len(packed)
        return packed


def open_sequential_array(
    shape: tuple[int, ...],
    dtype: np.dtype,
    read_bytes_into: Callable[[int, np.ndarray], None],
    *,
    fortran: bool = False,
) -> LazyArray:
    """Open an array whose bytes can only be read sequentially, such as compressed ones.

    Parameters
    ----------
    shape, dtype
        Of the array.
    read_bytes_into : function (first, into)
        Fills uint8 `into` with the bytes from `first` on, both within the array.
    fortran : bool
        Whether the first axis runs fastest.
    """
    slowest_axis = _slowest_axis(shape, fortran)
    row_bytes = math.prod(shape) // shape[slowest_axis] * dtype.itemsize
    cache: dict[tuple[int, int], np.ndarray] = {}

    def read_rows(first: int, last: int) -> np.ndarray:
        if (first, last) in cache:
            return cache[first, last]
        raw = np.empty((last - first) * row_bytes, np.uint8)
        read_bytes_into(first * row_bytes, raw)
        sizes = [*shape[:slowest_axis], last - first, *shape[slowest_axis + 1 :]]
        block = raw.view(dtype).reshape(sizes, order="F" if fortran else "C")
        cache.clear()
        # Frames along another axis all need the same rows, which the cache keeps.
        if raw.size <= CACHE_BYTES:
            cache[first, last] = block
        return block

    def read(part: ArrayPart) -> np.ndarray:
        block = read_rows(part[slowest_axis].start, part[slowest_axis].stop)
        return block[(*part[:slowest_axis], slice(None), *part[slowest_axis + 1 :])]

    return LazyArray(shape=shape, dtype=dtype, read=read, outer_axis=slowest_axis)


def _slowest_axis(shape: tuple[int, ...], is_fortran_order: bool) -> int:
    """Return the slowest axis longer than 1."""
    axes = range(len(shape) - 1, -1, -1) if is_fortran_order else range(len(shape))
    return next((axis for axis in axes if shape[axis] > 1), axes[0])


@contextmanager
def _convert_changed_file_errors(path: Path) -> Iterator[None]:
    """Convert errors of a file that changed while it was read to a `RecordingError`."""
    try:
        yield
    except (OSError, ValueError) as error:  # a mapping beyond the end of its file raises ValueError
        raise RecordingError(
            path,
            value=f"the file has changed since it was opened ({error})",
            expected="a file that does not change while it is read",
            fix="open it again after the writing program has finished",
        ) from None
