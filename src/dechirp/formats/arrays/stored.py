"""Arrays as they lie in files: read in parts, so that none has to fit into memory."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.base import Told
from dechirp.formats.settings_for import settings_for

Part = tuple[slice, ...]
"""Which part of an array is meant: a slice with both ends for each axis."""

ALLOWED_BYTES = 200 * 2**20
"""On top of twice the file: what may be held of a file, whatever it says of itself."""

_MOST_COMPRESSED = 1032
"""Bytes that one byte can stand for after the strongest compression in use (deflate)."""
_MOST_CHUNKS = 2**20

_PAIRS = (("real", "imag"), ("re", "im"), ("r", "i"), ("i", "q"))


@value
class Stored:
    """An array in a file."""

    shape: tuple[int, ...]
    dtype: np.dtype
    """Numbers, or pairs of them that `pair` knows."""
    read: Callable[[Part], np.ndarray]
    """A part of it, read now."""
    outer: int | None = None
    """The axis along which parts can be read alone, where others are always read whole; None:
    any part can be read alone."""
    chunk: tuple[int, ...] | None = None
    """Sizes of what is read at a time, where the file is cut into pieces."""
    absent: np.ndarray | None = None
    """(chunk, axis): of each chunk that was never written, its place among those along the
    axis. None: all were."""


def pair(dtype: np.dtype) -> tuple[str, str] | None:
    """Names of the two fields of complex numbers kept as a pair, the real part's first."""
    if dtype.names is None or len(dtype.names) != 2:
        return None
    names = {name.lower(): name for name in dtype.names}
    for first, second in _PAIRS:
        if set(names) == {first, second}:
            kinds = {dtype[name] for name in dtype.names}
            return (names[first], names[second]) if len(kinds) == 1 else None
    return None


def is_numeric(dtype: np.dtype) -> bool:
    """Whether samples can be made of the numbers of an array."""
    if pair(dtype):
        return dtype[0].kind in "iuf"
    return dtype.kind in "iufc"


def must_be_numeric(path: Path, dtype: np.dtype) -> None:
    """Raise `RecordingError` unless an array holds numbers."""
    if not is_numeric(dtype):
        raise RecordingError(
            path,
            got=f"an array of {'Python objects' if dtype.hasobject else dtype}",
            need="an array of integers, floats or complex numbers",
            fix="Save the samples themselves, as an array; pickled objects are never opened.",
        )


def must_be_plausible(path: Path, stored: Stored, *, file_bytes: int) -> None:
    """Raise `RecordingError` if an array is larger than its file can hold.

    Compression makes what a radar recorded ten times smaller at best.
    """
    claimed = math.prod(stored.shape) * stored.dtype.itemsize
    piece = math.prod(stored.chunk or ()) * stored.dtype.itemsize
    if claimed > _MOST_COMPRESSED * file_bytes + ALLOWED_BYTES:
        what = f"an array of {stored.dtype} of shape {written(stored.shape)}: {claimed} bytes"
    elif piece > 2 * file_bytes + ALLOWED_BYTES:
        what = f"an array in pieces of {written(stored.chunk or ())}: {piece} bytes each"
    else:
        return
    raise too_large(path, what, file_bytes=file_bytes)


def must_be_countable(path: Path, stored: Stored) -> int:
    """Number of chunks; raises `RecordingError` if there are too many to look for each."""
    n_chunks = math.prod(_grid(stored))
    if n_chunks > _MOST_CHUNKS:
        raise RecordingError(
            path,
            got=f"an array of shape {written(stored.shape)} in {n_chunks} pieces",
            need=f"at most {_MOST_CHUNKS} pieces",
            fix="Save it in larger pieces, such as a frame each.",
        )
    return n_chunks


def absent_chunks(stored: Stored, is_there: Callable[[tuple[int, ...]], bool]) -> np.ndarray | None:
    """`Stored.absent`, by a look for each chunk."""
    places = itertools.product(*(range(count) for count in _grid(stored)))
    absent = [place for place in places if not is_there(place)]
    return np.array(absent, np.int32) if absent else None


def _grid(stored: Stored) -> list[int]:
    """Number of chunks along each axis."""
    pairs = zip(stored.shape, stored.chunk or stored.shape, strict=True)
    return [-(-size // max(1, chunk)) for size, chunk in pairs]


def too_large(path: Path, what: str, *, file_bytes: int) -> RecordingError:
    """Error of something that would take more memory than its file can be worth."""
    return RecordingError(
        path,
        got=f"a file of {file_bytes} bytes with {what}",
        need=f"at most twice the file and {ALLOWED_BYTES >> 20} MiB in memory at a time",
        fix="Copy it again from its source, or save the samples without compression and with"
        " their frames along the first axis.",
    )


@contextmanager
def parsing(path: Path, need: str) -> Iterator[None]:
    """Turn whatever a foreign parser raises of damaged bytes into a `RecordingError`."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:  # its bytes are anybody's: it may raise anything
        said = " ".join(str(error).split())
        raise RecordingError(
            path,
            got=f"not readable ({type(error).__name__}{': ' + said[:200] if said else ''})",
            need=need,
            fix="Copy the file again from its source, or save it again.",
        ) from None


def reversed_axes(stored: Stored) -> Stored:
    """The same array with its axes in the opposite order, as MATLAB counts those of HDF5."""

    def read(part: Part) -> np.ndarray:
        return stored.read(part[::-1]).transpose()

    return Stored(
        shape=stored.shape[::-1],
        dtype=stored.dtype,
        read=read,
        outer=None if stored.outer is None else len(stored.shape) - 1 - stored.outer,
        chunk=None if stored.chunk is None else stored.chunk[::-1],
        absent=None if stored.absent is None else stored.absent[:, ::-1],
    )


def chosen(path: Path, arrays: Mapping[str, tuple[tuple[int, ...], np.dtype]], told: Told) -> str:
    """Name of the array that is meant: the one that was told, else the only possible cube.

    Parameters
    ----------
    path : Path
        The file.
    arrays : mapping of name to (shape, dtype)
        What it holds.
    told : Told
        `inside` names the array; the radar's settings tell cubes from other arrays.

    Raises
    ------
    RecordingError
        If it is not there, or several could be meant; it lists them.
    """
    possible = [
        name
        for name, (shape, dtype) in arrays.items()
        if is_numeric(dtype) and shape and min(shape) > 0
    ]
    if told.inside is not None:
        fitting = [name for name in possible if name == told.inside.strip("/")]
    else:
        fitting = [name for name in possible if len(arrays[name][0]) >= 2]
        if len(fitting) > 1:
            n_samples = settings_for(path, told).radar.frame.chirp.n_samples
            fitting = [name for name in fitting if n_samples in arrays[name][0]]
    if len(fitting) == 1:
        return fitting[0]
    listed = [f"{name} ({dtype} of {written(shape)})" for name, (shape, dtype) in arrays.items()]
    more = f" and {len(listed) - 12} more" if len(listed) > 12 else ""
    example = next(iter(possible), "cube")
    raise RecordingError(
        path,
        got=f"a file with {', '.join(listed[:12]) or 'no array'}{more}",
        need=f"one with numbers in an array named {told.inside}"
        if told.inside
        else "one with a single array that can be a cube, or whose array is named",
        fix=f"Name the array behind the file: {path.name}/{example}.",
    )


def written(shape: tuple[int, ...]) -> str:
    """Words for a shape."""
    return " x ".join(str(size) for size in shape) or "()"
