"""Arrays in files, read in parts, so that none has to fit into memory."""

import itertools
import math
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import RecordingHints
from dechirp.recordings.settings_lookup import find_recording_settings

ArrayPart = tuple[slice, ...]
"""Part of an array: a slice with both ends for each axis."""

ALLOWED_BYTES = 200 * 2**20
"""Memory allowed for a file in addition to twice its size, whatever its metadata claim."""

_MAX_COMPRESSION = 1032
"""Largest ratio of decompressed to compressed size of the compressions in use (deflate)."""
_MAX_CHUNKS = 2**20

_COMPLEX_FIELDS = (("real", "imag"), ("re", "im"), ("r", "i"), ("i", "q"))


@frozen_dataclass
class LazyArray:
    """An array in a file."""

    shape: tuple[int, ...]
    dtype: np.dtype
    """Numbers, or pairs of them that `complex_field_names` recognises."""
    read: Callable[[ArrayPart], np.ndarray]
    """Function that reads a part."""
    outer_axis: int | None = None
    """Axis along which parts can be read separately, while other axes are always read whole; None
    if any part can be read separately.
    """
    chunk: tuple[int, ...] | None = None
    """Chunk shape, if the file stores the array in chunks."""
    absent_chunks: np.ndarray | None = None
    """(chunk, axis): index along each axis of every chunk that was never written; None if all
    were written.
    """


def complex_field_names(dtype: np.dtype) -> tuple[str, str] | None:
    """Return the field names of complex pairs, real part first; None for other types."""
    if dtype.names is None or len(dtype.names) != 2:
        return None
    names = {name.lower(): name for name in dtype.names}
    for first, second in _COMPLEX_FIELDS:
        if set(names) == {first, second}:
            kinds = {dtype[name] for name in dtype.names}
            return (names[first], names[second]) if len(kinds) == 1 else None
    return None


def is_numeric(dtype: np.dtype) -> bool:
    """Return whether samples can be made of an array of this type."""
    if complex_field_names(dtype):
        return dtype[0].kind in "iuf"
    return dtype.kind in "iufc"


def check_numeric(path: Path, dtype: np.dtype) -> None:
    """Raise `RecordingError` unless an array holds numbers."""
    if not is_numeric(dtype):
        raise RecordingError(
            path,
            value=f"an array of {'Python objects' if dtype.hasobject else dtype}",
            expected="an array of integers, floats or complex numbers",
            fix="save the samples as a numeric array; pickled objects are never loaded",
        )


def check_plausible_size(path: Path, array: LazyArray, *, file_bytes: int) -> None:
    """Raise `RecordingError` if an array is larger than its file can hold.

    Radar samples compress by a factor of ten at best.
    """
    claimed_bytes = math.prod(array.shape) * array.dtype.itemsize
    chunk_bytes = math.prod(array.chunk or ()) * array.dtype.itemsize
    if claimed_bytes > _MAX_COMPRESSION * file_bytes + ALLOWED_BYTES:
        description = (
            f"an array of {array.dtype} of shape {format_shape(array.shape)}: {claimed_bytes} bytes"
        )
    elif chunk_bytes > 2 * file_bytes + ALLOWED_BYTES:
        description = (
            f"an array in chunks of {format_shape(array.chunk or ())}: {chunk_bytes} bytes each"
        )
    else:
        return
    raise memory_exceeds_file_error(path, description, file_bytes=file_bytes)


def count_chunks(path: Path, array: LazyArray) -> int:
    """Return the number of chunks; raise `RecordingError` if there are too many to check each."""
    n_chunks = math.prod(_chunks_per_axis(array))
    if n_chunks > _MAX_CHUNKS:
        raise RecordingError(
            path,
            value=f"an array of shape {format_shape(array.shape)} in {n_chunks} chunks",
            expected=f"at most {_MAX_CHUNKS} chunks",
            fix="save it in larger chunks, such as a frame each",
        )
    return n_chunks


def unwritten_chunk_indices_or_none(
    array: LazyArray, is_present: Callable[[tuple[int, ...]], bool]
) -> np.ndarray | None:
    """Return `LazyArray.absent_chunks`, by a query for each chunk."""
    indices = itertools.product(*(range(count) for count in _chunks_per_axis(array)))
    absent_indices = [index for index in indices if not is_present(index)]
    return np.array(absent_indices, np.int32) if absent_indices else None


def _chunks_per_axis(array: LazyArray) -> list[int]:
    """Return the number of chunks along each axis."""
    pairs = zip(array.shape, array.chunk or array.shape, strict=True)
    return [-(-size // max(1, chunk)) for size, chunk in pairs]


def memory_exceeds_file_error(path: Path, description: str, *, file_bytes: int) -> RecordingError:
    """Return the error of data that would take more memory than its file allows."""
    return RecordingError(
        path,
        value=f"a file of {file_bytes} bytes with {description}",
        expected=f"at most twice the file and {ALLOWED_BYTES >> 20} MiB in memory at a time",
        fix="copy it again from its source, or save the samples uncompressed with frames along"
        " the first axis",
    )


@contextmanager
def convert_parser_errors(path: Path, expected: str) -> Iterator[None]:
    """Convert any exception of a foreign parser for damaged bytes to a `RecordingError`."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:  # foreign bytes may raise anything
        message = " ".join(str(error).split())[:200] or "damaged or incomplete"
        if isinstance(error, KeyError) and error.args:  # its text is the key alone
            key = error.args[0]
            name = key.decode(errors="replace") if isinstance(key, bytes) else key
            message = f"damaged, without the field {name}"
        raise RecordingError(
            path,
            value=f"not readable ({message})",
            expected=expected,
            fix="copy the file again from its source, or save it again",
        ) from None


def reverse_axes(array: LazyArray) -> LazyArray:
    """Return the array with reversed axes, as MATLAB orders those of HDF5."""

    def read(part: ArrayPart) -> np.ndarray:
        return array.read(part[::-1]).transpose()

    return LazyArray(
        shape=array.shape[::-1],
        dtype=array.dtype,
        read=read,
        outer_axis=None if array.outer_axis is None else len(array.shape) - 1 - array.outer_axis,
        chunk=None if array.chunk is None else array.chunk[::-1],
        absent_chunks=None if array.absent_chunks is None else array.absent_chunks[:, ::-1],
    )


def choose_array_name(
    path: Path, arrays: Mapping[str, tuple[tuple[int, ...], np.dtype]], hints: RecordingHints
) -> str:
    """Return the name of the array to read: the one named by the user, else the only possible cube.

    Parameters
    ----------
    path : Path
        The file.
    arrays : mapping of name to (shape, dtype)
        Arrays in the file.
    hints : RecordingHints
        `inner_name` names the array; the radar's settings distinguish cubes from other arrays.

    Raises
    ------
    RecordingError
        If the array is missing, or several are possible; the message lists them.
    """
    candidates = [
        name
        for name, (shape, dtype) in arrays.items()
        if is_numeric(dtype) and shape and min(shape) > 0
    ]
    if hints.inner_name is not None:
        fitting = [name for name in candidates if name == hints.inner_name.strip("/")]
    else:
        fitting = [name for name in candidates if len(arrays[name][0]) >= 2]
        # MATLAB also stores numbers, times and frequencies with two axes, one of them of length 1.
        fitting = [
            name for name in fitting if sum(size > 1 for size in arrays[name][0]) >= 2
        ] or fitting
        if len(fitting) > 1:
            with suppress(RecordingError):  # without settings, the message lists the arrays
                n_samples = find_recording_settings(path, hints).radar.frame.chirp.n_samples
                fitting = [name for name in fitting if n_samples in arrays[name][0]]
    if len(fitting) == 1:
        return fitting[0]
    descriptions = [
        f"{name} ({_format_type(dtype)} of {format_shape(shape)})"
        for name, (shape, dtype) in arrays.items()
    ]
    more = f" and {len(descriptions) - 12} more" if len(descriptions) > 12 else ""
    # The largest is rather the samples than a time or a constant.
    example = max(
        fitting or candidates, key=lambda name: math.prod(arrays[name][0]), default="cube"
    )
    raise RecordingError(
        path,
        value=f"a file with {', '.join(descriptions[:12]) or 'no array'}{more}",
        expected=f"a numeric array named {hints.inner_name}"
        if hints.inner_name
        else "a single array that can be a cube, or the name of the array",
        fix="append the name of the array to the file: dechirp run"
        f" {shlex.quote(str(path / example))}",
    )


def _format_type(dtype: np.dtype) -> str:
    """Format the type of an array; of complex pairs, the type of both parts."""
    return f"pairs of {dtype[0]}" if complex_field_names(dtype) else str(dtype)


def format_shape(shape: tuple[int, ...]) -> str:
    """Format a shape as text."""
    return " x ".join(str(size) for size in shape) or "()"
