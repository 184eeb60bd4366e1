"""MATLAB files up to version 7 ("MATLAB 5.0 MAT-file"): where the numbers of arrays lie.

A file is a header of 128 bytes and elements, one a variable, each as it is or compressed. An
element is a tag (type, bytes) and its data, padded to 8 bytes. That of an array holds
elements in turn: class and flags, dimensions, name, real part, imaginary part. Parts are kept
in the smallest type that holds their numbers, the first axis running fastest.

scipy.io reads a variable at once, and takes 48 bytes for a complex sample of 16: not for
recordings of many frames, nor for a compressed file that claims to be large.

MathWorks, MAT-File Format, level 5.
"""

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from dechirp.core.values import value
from dechirp.formats.arrays.on_disk import Forward, mapped, streamed
from dechirp.formats.arrays.stored import Part, Stored, parsing, too_large

NEED = "a MATLAB file of version 5 to 7.3"

_HEADER_BYTES = 128
_HEAD_BYTES = 4096  # of an element: those before its numbers fit, with the longest name
_MOST_ELEMENTS = 10_000

_MATRIX, _COMPRESSED = 14, 15
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_WITHOUT_SIZES = (0, 16, 17)  # functions, objects: their elements have another form
# By number of the class: what MATLAB calls double, single, int8 and so on.
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"} | {
    14: "i8",
    15: "u8",
}
# By number of the type: how the numbers are kept.
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}


@value
class Variable:
    """An array of numbers in the file."""

    path: Path
    order: str
    """`<` or `>`: which byte of a number comes first."""
    start: int
    """First byte of its element in the file, or of the compressed bytes of it."""
    packed_bytes: int | None
    """Size of those; None where it is not compressed."""
    shape: tuple[int, ...]
    numbers: np.dtype
    """What MATLAB takes each part for."""
    is_complex: bool
    first_part: int
    """Where in the element the tag of its real part is."""

    @property
    def dtype(self) -> np.dtype:
        """Of the array: complex integers are pairs."""
        if not self.is_complex:
            return self.numbers
        if self.numbers.kind == "f":
            return np.dtype(np.complex64 if self.numbers.itemsize == 4 else np.complex128)
        return np.dtype([("real", self.numbers), ("imag", self.numbers)])

    def stored(self) -> Stored:
        """Its numbers, to be read in parts."""
        with parsing(self.path, NEED):
            real, after = self._part(self.first_part)
            parts = [real, self._part(after)[0]] if self.is_complex else [real]

        def read(part: Part) -> np.ndarray:
            if not self.is_complex:
                return real.read(part).astype(self.numbers, copy=False)
            sizes = [along.stop - along.start for along in part]
            if self.numbers.kind != "f":
                pairs = np.empty(sizes, self.dtype)
                pairs["real"], pairs["imag"] = (one.read(part) for one in parts)
                return pairs
            # Samples become float32 in any case; in double they would take twice the memory.
            made = np.empty(sizes, np.complex64)
            with np.errstate(over="ignore"):
                made.real = parts[0].read(part)
                made.imag = parts[1].read(part)
            return made

        return Stored(shape=self.shape, dtype=self.dtype, read=read, outer=real.outer)

    def _part(self, at: int) -> tuple[Stored, int]:
        """One part, and where in the element the next tag is."""
        fill = self._bytes()
        tag = np.empty(8, np.uint8)
        fill(at, tag)
        kind, n_bytes, start, after = element(tag.tobytes(), 0, self.order)
        dtype = np.dtype(self.order + TYPES[kind])
        needed = math.prod(self.shape) * dtype.itemsize
        if n_bytes != needed:
            raise ValueError(f"{n_bytes} bytes for an array of {needed}")
        start, after = start + at, after + at
        if self.packed_bytes is None:
            place = self.start + start
            return mapped(self.path, dtype, self.shape, offset=place, fortran=True), after

        def fill_part(first: int, into: np.ndarray) -> None:
            fill(start + first, into)

        return streamed(self.shape, dtype, fill_part, fortran=True), after

    def _bytes(self) -> Callable[[int, np.ndarray], None]:
        """Read bytes of the element, counted from its own first one."""
        if self.packed_bytes is not None:
            return _unpacked(self.path, self.start, self.packed_bytes).fill

        def fill(first: int, into: np.ndarray) -> None:
            into[:] = np.fromfile(self.path, np.uint8, into.size, offset=self.start + first)

        return fill


@value
class Element:
    """A variable of any class in the file."""

    path: Path
    order: str
    """`<` or `>`: which byte of a number comes first."""
    start: int
    """First byte of it in the file, or of the compressed bytes of it."""
    n_bytes: int
    """In the file."""
    is_packed: bool
    head: bytes
    """Those before its numbers, unpacked."""

    @property
    def name(self) -> str:
        """Empty for what MATLAB keeps for itself."""
        return header(self.head, 0, self.order).name

    def content(self, most: int) -> bytes:
        """All of it, unpacked; raises `RecordingError` if that is more than so many bytes."""
        if self.is_packed:
            made = _unpacked(self.path, self.start, self.n_bytes).head(most + 1)
            n_bytes = len(made)
        else:
            n_bytes = self.n_bytes
        if n_bytes > most:
            what = f"a variable {self.name!r} of more than {most} bytes"
            raise too_large(self.path, what, file_bytes=self.path.stat().st_size)
        if self.is_packed:
            return made
        with self.path.open("rb") as file:
            file.seek(self.start)
            return file.read(n_bytes)


@value
class Header:
    """What an array says before its numbers."""

    kind: int
    """Number of its class."""
    is_complex: bool
    is_logical: bool
    shape: tuple[int, ...]
    name: str
    after: int
    """Where its first part is."""


def header(data: bytes, at: int, order: str) -> Header:
    """Header of the array whose element begins there; nameless where the class has another form.

    Raises
    ------
    ValueError, struct.error
        If it is damaged.
    """
    kind, _, at, _ = element(data, at, order)
    if kind != _MATRIX:
        raise ValueError(f"an element of type {kind}")
    _, _, flags_at, at = element(data, at, order)
    (flags,) = struct.unpack_from(f"{order}I", data, flags_at)
    if flags & 0xFF in _WITHOUT_SIZES:
        return Header(
            kind=flags & 0xFF, is_complex=False, is_logical=False, shape=(), name="", after=at
        )
    _, n_bytes, sizes_at, at = element(data, at, order)
    shape = struct.unpack_from(f"{order}{n_bytes // 4}i", data, sizes_at)
    _, n_bytes, name_at, at = element(data, at, order)
    return Header(
        kind=flags & 0xFF,
        is_complex=bool(flags & _COMPLEX),
        is_logical=bool(flags & _LOGICAL),
        shape=shape,
        name=data[name_at : name_at + n_bytes].decode("latin-1"),
        after=at,
    )


def elements(path: Path) -> Iterator[Element]:
    """Variables of a file, of any class, in their order.

    Raises
    ------
    RecordingError
        If the file is damaged.
    """
    size = path.stat().st_size
    with parsing(path, NEED), path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}[file.read(_HEADER_BYTES)[126:128]]
        at = _HEADER_BYTES
        for _ in range(_MOST_ELEMENTS):
            file.seek(at)
            tag = file.read(8)
            if not tag:
                break
            kind, n_bytes = struct.unpack(f"{order}II", tag)
            if at + 8 + n_bytes > size:
                raise EOFError(f"a variable of {n_bytes} bytes at byte {at} of {size}")
            if kind not in (_COMPRESSED, _MATRIX):
                raise ValueError(f"an element of type {kind} at byte {at}")
            is_packed = kind == _COMPRESSED
            if is_packed:
                start, n_held = at + 8, n_bytes
                head = _unpacked(path, start, n_held).head(_HEAD_BYTES)
            else:
                start, n_held = at, n_bytes + 8
                file.seek(at)
                head = file.read(_HEAD_BYTES)
            yield Element(
                path=path, order=order, start=start, n_bytes=n_held, is_packed=is_packed, head=head
            )
            at += 8 + n_bytes


def variables(path: Path) -> dict[str, Variable]:
    """Arrays of numbers in the file, by name; texts, structures and others are left out.

    Raises
    ------
    RecordingError
        If the file is damaged.
    """
    found: dict[str, Variable] = {}
    with parsing(path, NEED):
        for one in elements(path):
            found |= variable(one)
    return found


def variable(one: Element) -> dict[str, Variable]:
    """Array of numbers that an element is, by name; none if it is something else."""
    said = header(one.head, 0, one.order)
    numbers = CLASSES.get(said.kind)
    if numbers is None:
        return {}
    if not said.shape or min(said.shape) < 0 or said.after + 8 > len(one.head):
        raise ValueError(f"a variable {said.name!r} of sizes {said.shape}")
    made = Variable(
        path=one.path,
        order=one.order,
        start=one.start,
        packed_bytes=one.n_bytes if one.is_packed else None,
        shape=said.shape,
        numbers=np.dtype(numbers),
        is_complex=said.is_complex,
        first_part=said.after,
    )
    return {said.name: made} if said.name else {}  # what MATLAB keeps for itself has no name


def element(head: bytes, at: int, order: str) -> tuple[int, int, int, int]:
    """Type of an element, its size, where its data are, and where the next one is."""
    kind, n_bytes = struct.unpack_from(f"{order}II", head, at)
    if kind >> 16:  # up to 4 bytes lie within the tag itself
        return kind & 0xFFFF, kind >> 16, at + 4, at + 8
    return kind, n_bytes, at + 8, at + 8 + -(-n_bytes // 8) * 8


def _unpacked(path: Path, start: int, n_bytes: int) -> Forward:
    return Forward(path, start, n_bytes, need=NEED, wbits=zlib.MAX_WBITS)
