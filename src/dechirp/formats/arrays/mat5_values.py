"""Small values of MATLAB files (version 5 to 7): texts, arrays and structures, read at once."""

import math
import struct
from collections.abc import Iterator

import numpy as np

from dechirp.formats.arrays.mat5 import CLASSES, TYPES, Element, Header, element, header

Value = str | np.ndarray | dict[str, np.ndarray]
"""A text, an array with its axes as MATLAB shows them, or a structure of such arrays."""

_STRUCTURE, _TEXT = 2, 4
# By number of the type in which a text is kept.
_ALPHABETS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def value_of(one: Element, most: int) -> Value:
    """What a variable holds, in at most so many bytes.

    Raises
    ------
    RecordingError
        If it takes more.
    ValueError, KeyError, struct.error
        If it is damaged, or neither text, numbers, nor one structure of arrays.
    """
    data, order = one.content(most), one.order
    said = header(data, 0, order)
    if said.kind == _TEXT:
        return _text(data, said, order)
    if said.kind == _STRUCTURE:
        return dict(_fields(data, said, order, most))
    return _array(data, said, order, most)


def _text(data: bytes, said: Header, order: str) -> str:
    kind, n_bytes, at, _ = element(data, said.after, order)
    alphabet = _ALPHABETS[kind]
    sided = {"<": "-le", ">": "-be"}[order] if alphabet in ("utf-16", "utf-32") else ""
    return data[at : at + n_bytes].decode(alphabet + sided)


def _fields(data: bytes, said: Header, order: str, most: int) -> Iterator[tuple[str, np.ndarray]]:
    """Name and array of each field of a structure."""
    if math.prod(said.shape) != 1:
        raise ValueError(f"an array of {said.shape} structures")
    _, _, at, after = element(data, said.after, order)
    (width,) = struct.unpack_from(f"{order}I", data, at)
    _, n_bytes, at, after = element(data, after, order)
    for start in range(at, at + n_bytes, max(width, 1)):
        name = data[start : start + width].split(b"\0")[0].decode("latin-1")
        here, (_, _, _, after) = after, element(data, after, order)
        yield name, _array(data, header(data, here, order), order, most)


def _array(data: bytes, said: Header, order: str, most: int) -> np.ndarray:
    numbers = np.dtype(CLASSES[said.kind])
    # Numbers are kept in a smaller type where that holds them: an array may be larger.
    n_bytes = math.prod(said.shape) * numbers.itemsize
    if not 0 <= n_bytes <= most:
        raise ValueError(f"an array {said.name!r} of {n_bytes} bytes")
    real, after = _part(data, said, order, said.after)
    if said.is_complex:
        made = np.empty(said.shape, np.result_type(numbers, np.complex64))
        made.real, made.imag = real, _part(data, said, order, after)[0]
        return made
    return real.astype(bool if said.is_logical else numbers)


def _part(data: bytes, said: Header, order: str, at: int) -> tuple[np.ndarray, int]:
    kind, n_bytes, at, after = element(data, at, order)
    dtype = np.dtype(order + TYPES[kind])
    if n_bytes != math.prod(said.shape) * dtype.itemsize:
        raise ValueError(f"{n_bytes} bytes for {said.name!r} of {said.shape}")
    flat = np.frombuffer(data, dtype, n_bytes // dtype.itemsize, at)
    return flat.reshape(said.shape, order="F"), after
