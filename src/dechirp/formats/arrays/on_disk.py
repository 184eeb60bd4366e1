"""Numbers on disk as arrays, of which a part at a time comes into memory."""

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.formats.arrays.stored import Part, Stored, parsing

_BLOCK_BYTES = 2**24
_READ_BYTES = 2**18
KEPT_BYTES = 2**26
"""Of a compressed array: up to so many stay in memory for the next frame."""


def mapped(
    path: Path,
    dtype: np.dtype,
    shape: tuple[int, ...],
    *,
    offset: int = 0,
    fortran: bool = False,
) -> Stored:
    """Array that lies in a file as it would in memory.

    The file is mapped anew for each part and block of it: pages of a mapping count as memory
    of the process until it is gone.
    """
    outer = _outer(shape, fortran)
    row_bytes = math.prod(shape) // shape[outer] * dtype.itemsize
    step = max(1, _BLOCK_BYTES // row_bytes)

    def read(part: Part) -> np.ndarray:
        made = np.empty([along.stop - along.start for along in part], dtype)
        start = part[outer].start
        for first in range(start, part[outer].stop, step):
            rows = slice(first, min(first + step, part[outer].stop))
            taken = (*part[:outer], rows, *part[outer + 1 :])
            into = [slice(None)] * len(shape)
            into[outer] = slice(rows.start - start, rows.stop - start)
            with _as_it_was(path):
                whole = np.memmap(
                    path, dtype, "r", offset=offset, shape=shape, order="F" if fortran else "C"
                )
                made[tuple(into)] = whole[taken]
        return made

    return Stored(shape=shape, dtype=dtype, read=read)


class Forward:
    """Compressed bytes of a file, which can only be read in their order.

    Going back begins anew. The file is open only while it is read.
    """

    def __init__(self, path: Path, start: int, n_bytes: int, *, need: str, wbits: int) -> None:
        self._path, self._need, self._wbits = path, need, wbits
        self._start, self._end = start, start + n_bytes
        self._begin()

    def _begin(self) -> None:
        self._inflater = zlib.decompressobj(self._wbits)
        self._packed_at = self._start
        self._at = 0

    def fill(self, first: int, into: np.ndarray) -> None:
        """Fill uint8 `into` with the bytes from `first` on, counted as they are unpacked."""
        with parsing(self._path, self._need):
            if first < self._at:
                self._begin()
            while self._at < first:
                self._next(first - self._at)
            filled = 0
            while filled < into.size:
                block = self._next(into.size - filled)
                into[filled : filled + len(block)] = np.frombuffer(block, np.uint8)
                filled += len(block)

    def head(self, n_bytes: int) -> bytes:
        """At most so many bytes from the first on."""
        blocks: list[bytes] = []
        with parsing(self._path, self._need), suppress(EOFError):
            self._begin()
            while self._at < n_bytes:
                blocks.append(self._next(n_bytes - self._at))
        return b"".join(blocks)

    def _next(self, n_bytes: int) -> bytes:
        """Some of the next bytes, at least one and at most so many."""
        while True:
            packed = self._inflater.unconsumed_tail or self._more()
            block = self._inflater.decompress(packed, min(n_bytes, _READ_BYTES))
            if block:
                self._at += len(block)
                return block
            if not packed:
                raise EOFError(f"its data end after {self._at} bytes")

    def _more(self) -> bytes:
        with self._path.open("rb") as file:
            file.seek(self._packed_at)
            packed = file.read(min(_READ_BYTES, self._end - self._packed_at))
        self._packed_at += len(packed)
        return packed


def streamed(
    shape: tuple[int, ...],
    dtype: np.dtype,
    fill: Callable[[int, np.ndarray], None],
    *,
    fortran: bool = False,
) -> Stored:
    """Array whose bytes can only be read in their order, such as compressed ones.

    Parameters
    ----------
    shape, dtype
        Of the array.
    fill : function (first, into)
        Fills uint8 `into` with the bytes from `first` on, both within the array.
    fortran : bool
        Whether the first axis runs fastest.
    """
    outer = _outer(shape, fortran)
    row_bytes = math.prod(shape) // shape[outer] * dtype.itemsize
    kept: dict[tuple[int, int], np.ndarray] = {}

    def rows(first: int, last: int) -> np.ndarray:
        if (first, last) in kept:
            return kept[first, last]
        raw = np.empty((last - first) * row_bytes, np.uint8)
        fill(first * row_bytes, raw)
        sizes = [*shape[:outer], last - first, *shape[outer + 1 :]]
        made = raw.view(dtype).reshape(sizes, order="F" if fortran else "C")
        kept.clear()
        # Frames along another axis all need the same rows: those are not read again for each.
        if raw.size <= KEPT_BYTES:
            kept[first, last] = made
        return made

    def read(part: Part) -> np.ndarray:
        block = rows(part[outer].start, part[outer].stop)
        return block[(*part[:outer], slice(None), *part[outer + 1 :])]

    return Stored(shape=shape, dtype=dtype, read=read, outer=outer)


def _outer(shape: tuple[int, ...], fortran: bool) -> int:
    """Axis that runs slowest, of those longer than 1."""
    axes = range(len(shape) - 1, -1, -1) if fortran else range(len(shape))
    return next((axis for axis in axes if shape[axis] > 1), axes[0])


@contextmanager
def _as_it_was(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # a mapping longer than its file is a ValueError
        raise RecordingError(
            path,
            got=f"no longer what it was when it was opened ({error})",
            need="a file that stays as it is while it is read",
            fix="Open it again, when nothing writes to it.",
        ) from None
