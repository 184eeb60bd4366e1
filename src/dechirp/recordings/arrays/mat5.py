"""MATLAB files up to version 7 ("MATLAB 5.0 MAT-file"): positions of the numbers of arrays.

A file is a header of 128 bytes and elements, one a variable, each plain or compressed. An element
is a tag (type, bytes) and its data, padded to 8 bytes. The element of an array contains further
elements: class and flags, dimensions, name, real part, imaginary part. Parts are stored in the
smallest type that holds their numbers, the first axis running fastest.

scipy.io reads a variable at once and takes 48 bytes for a complex sample of 16, too much for
recordings of many frames, or for a compressed file that claims to be large.

MathWorks, MAT-File Format, level 5.
"""

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from dechirp.core.text import join_names
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import (
    ArrayPart,
    LazyArray,
    convert_parser_errors,
    memory_exceeds_file_error,
)
from dechirp.recordings.arrays.lazy_files import (
    InflateStream,
    open_memory_mapped_array,
    open_sequential_array,
)

EXPECTED = "a MATLAB file of version 5 to 7.3"

_HEADER_BYTES = 128
_HEAD_BYTES = 4096  # contain all of an element but its numbers, with the longest name
_MAX_ELEMENTS = 10_000

_MATRIX, _COMPRESSED = 14, 15
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_STRUCTURE = 2
_CLASS_NAMES = {1: "cell array", _STRUCTURE: "structure", 3: "object", 4: "text", 5: "sparse array"}
_WITHOUT_SIZES = (0, 16, 17)  # functions and objects, whose elements have another structure
# NumPy types of the classes double, single, int8 and so on, by class number.
CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"} | {
    14: "i8",
    15: "u8",
}
# NumPy types of stored numbers, by type number.
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}


@frozen_dataclass
class Variable:
    """An array of numbers in the file."""

    path: Path
    byte_order: str
    """`<` (little-endian) or `>` (big-endian)."""
    start: int
    """First byte of its element in the file, or of the compressed bytes of it."""
    compressed_bytes: int | None
    """Size of the compressed bytes; None if it is not compressed."""
    shape: tuple[int, ...]
    number_dtype: np.dtype
    """Type of each part in MATLAB."""
    is_complex: bool
    first_part: int
    """Offset of the tag of the real part within the element."""

    @property
    def dtype(self) -> np.dtype:
        """NumPy type of the array; complex integers are pairs."""
        if not self.is_complex:
            return self.number_dtype
        if self.number_dtype.kind == "f":
            return np.dtype(np.complex64 if self.number_dtype.itemsize == 4 else np.complex128)
        return np.dtype([("real", self.number_dtype), ("imag", self.number_dtype)])

    def to_lazy_array(self) -> LazyArray:
        """Return the variable as an array that is read in parts."""
        with convert_parser_errors(self.path, EXPECTED):
            real, imaginary_offset = self._open_real_or_imaginary_part(self.first_part)
            parts = (
                [real, self._open_real_or_imaginary_part(imaginary_offset)[0]]
                if self.is_complex
                else [real]
            )

        def read(part: ArrayPart) -> np.ndarray:
            if not self.is_complex:
                return real.read(part).astype(self.number_dtype, copy=False)
            sizes = [axis_slice.stop - axis_slice.start for axis_slice in part]
            if self.number_dtype.kind != "f":
                pairs = np.empty(sizes, self.dtype, order="F")
                pairs["real"], pairs["imag"] = (array.read(part) for array in parts)
                return pairs
            # Samples become float32 anyway; in double precision they would take twice the memory.
            samples = np.empty(sizes, np.complex64, order="F")
            with np.errstate(over="ignore"):
                samples.real = parts[0].read(part)
                samples.imag = parts[1].read(part)
            return samples

        return LazyArray(shape=self.shape, dtype=self.dtype, read=read, outer_axis=real.outer_axis)

    def _open_real_or_imaginary_part(self, offset: int) -> tuple[LazyArray, int]:
        """Open the real or imaginary part; return it with the offset of the next tag."""
        fill = self._make_byte_reader()
        tag = np.empty(8, np.uint8)
        fill(offset, tag)
        kind, n_bytes, start, next_offset = parse_element_tag(tag.tobytes(), 0, self.byte_order)
        dtype = np.dtype(self.byte_order + TYPES[kind])
        expected_bytes = math.prod(self.shape) * dtype.itemsize
        if n_bytes != expected_bytes:
            raise ValueError(f"{n_bytes} bytes for an array of {expected_bytes}")
        start, next_offset = start + offset, next_offset + offset
        if self.compressed_bytes is None:
            file_offset = self.start + start
            return open_memory_mapped_array(
                self.path, dtype, self.shape, offset=file_offset, fortran=True
            ), next_offset

        def fill_part(first: int, into: np.ndarray) -> None:
            fill(start + first, into)

        return open_sequential_array(self.shape, dtype, fill_part, fortran=True), next_offset

    def _make_byte_reader(self) -> Callable[[int, np.ndarray], None]:
        """Return a function that reads bytes of the element, counted from its first byte."""
        if self.compressed_bytes is not None:
            return _open_inflate_stream(
                self.path, self.start, self.compressed_bytes
            ).decompress_into

        def fill(first: int, into: np.ndarray) -> None:
            into[:] = np.fromfile(self.path, np.uint8, into.size, offset=self.start + first)

        return fill


@frozen_dataclass
class Element:
    """A variable of any class in the file."""

    path: Path
    byte_order: str
    """`<` (little-endian) or `>` (big-endian)."""
    start: int
    """First byte in the file of the element, or of its compressed bytes."""
    n_bytes: int
    """Size in the file."""
    is_compressed: bool
    head: bytes
    """First bytes, decompressed, which contain all but the numbers."""

    @property
    def name(self) -> str:
        """Name of the variable; empty for MATLAB's internal ones."""
        return parse_array_header(self.head, 0, self.byte_order).name

    def read_all_decompressed(self, max_bytes: int) -> bytes:
        """Return the whole element, decompressed; raise `RecordingError` beyond `max_bytes`."""
        if self.is_compressed:
            content = _open_inflate_stream(self.path, self.start, self.n_bytes).read_first_bytes(
                max_bytes + 1
            )
            n_bytes = len(content)
        else:
            n_bytes = self.n_bytes
        if n_bytes > max_bytes:
            description = f"a variable {self.name!r} of more than {max_bytes} bytes"
            raise memory_exceeds_file_error(
                self.path, description, file_bytes=self.path.stat().st_size
            )
        if self.is_compressed:
            return content
        with self.path.open("rb") as file:
            file.seek(self.start)
            return file.read(n_bytes)


@frozen_dataclass
class ArrayHeader:
    """Header of an array, before its numbers."""

    class_code: int
    """Number of its MATLAB class."""
    is_complex: bool
    is_logical: bool
    shape: tuple[int, ...]
    name: str
    data_offset: int
    """Offset of its first part."""


def parse_array_header(data: bytes, offset: int, byte_order: str) -> ArrayHeader:
    """Parse the header of the array at an offset; nameless for classes without dimensions.

    Raises
    ------
    ValueError, struct.error
        If it is damaged.
    """
    kind, _, offset, _ = parse_element_tag(data, offset, byte_order)
    if kind != _MATRIX:
        raise ValueError(f"an element of type {kind}")
    _, _, flags_at, offset = parse_element_tag(data, offset, byte_order)
    (flags,) = struct.unpack_from(f"{byte_order}I", data, flags_at)
    if flags & 0xFF in _WITHOUT_SIZES:
        return ArrayHeader(
            class_code=flags & 0xFF,
            is_complex=False,
            is_logical=False,
            shape=(),
            name="",
            data_offset=offset,
        )
    _, n_bytes, sizes_at, offset = parse_element_tag(data, offset, byte_order)
    shape = struct.unpack_from(f"{byte_order}{n_bytes // 4}i", data, sizes_at)
    _, n_bytes, name_at, offset = parse_element_tag(data, offset, byte_order)
    return ArrayHeader(
        class_code=flags & 0xFF,
        is_complex=bool(flags & _COMPLEX),
        is_logical=bool(flags & _LOGICAL),
        shape=shape,
        name=data[name_at : name_at + n_bytes].decode("latin-1"),
        data_offset=offset,
    )


def iter_elements(path: Path) -> Iterator[Element]:
    """Yield the variables of a file, of any class, in their order.

    Raises
    ------
    RecordingError
        If the file is damaged.
    """
    size = path.stat().st_size
    with convert_parser_errors(path, EXPECTED), path.open("rb") as file:
        byte_order = {b"IM": "<", b"MI": ">"}[file.read(_HEADER_BYTES)[126:128]]
        offset = _HEADER_BYTES
        for _ in range(_MAX_ELEMENTS):
            file.seek(offset)
            tag = file.read(8)
            if not tag:
                break
            kind, n_bytes = struct.unpack(f"{byte_order}II", tag)
            if offset + 8 + n_bytes > size:
                raise EOFError(f"a variable of {n_bytes} bytes at byte {offset} of {size}")
            if kind not in (_COMPRESSED, _MATRIX):
                raise ValueError(f"an element of type {kind} at byte {offset}")
            is_compressed = kind == _COMPRESSED
            if is_compressed:
                start, stored_bytes = offset + 8, n_bytes
                head = _open_inflate_stream(path, start, stored_bytes).read_first_bytes(_HEAD_BYTES)
            else:
                start, stored_bytes = offset, n_bytes + 8
                file.seek(offset)
                head = file.read(_HEAD_BYTES)
            yield Element(
                path=path,
                byte_order=byte_order,
                start=start,
                n_bytes=stored_bytes,
                is_compressed=is_compressed,
                head=head,
            )
            offset += 8 + n_bytes


def find_numeric_variables(path: Path) -> dict[str, Variable]:
    """Return the numeric arrays in the file by name, without texts, structures and others.

    Raises
    ------
    RecordingError
        If the file is damaged.
    """
    variables: dict[str, Variable] = {}
    with convert_parser_errors(path, EXPECTED):
        for element in iter_elements(path):
            variables |= parse_numeric_variable_by_name(element)
    return variables


def parse_numeric_variable_by_name(element: Element) -> dict[str, Variable]:
    """Return the numeric array of an element, by name; empty for other classes."""
    header = parse_array_header(element.head, 0, element.byte_order)
    numbers = CLASSES.get(header.class_code)
    if numbers is None:
        return {}
    if not header.shape or min(header.shape) < 0 or header.data_offset + 8 > len(element.head):
        raise ValueError(f"a variable {header.name!r} of sizes {header.shape}")
    variable = Variable(
        path=element.path,
        byte_order=element.byte_order,
        start=element.start,
        compressed_bytes=element.n_bytes if element.is_compressed else None,
        shape=header.shape,
        number_dtype=np.dtype(numbers),
        is_complex=header.is_complex,
        first_part=header.data_offset,
    )
    # MATLAB's internal variables have no name.
    return {header.name: variable} if header.name else {}


def describe_variable(element: Element) -> str:
    """Describe a variable of any class: name, class and sizes, and the fields of a structure."""
    header = parse_array_header(element.head, 0, element.byte_order)
    if not header.name:
        return ""
    sizes = " x ".join(map(str, header.shape))
    text = f"{header.name} ({_CLASS_NAMES.get(header.class_code, 'array')} of {sizes}"
    fields: list[str] = []
    if header.class_code == _STRUCTURE:
        fields = parse_structure_field_names(element.head, header, element.byte_order)[0]
    return f"{text}{' with the fields ' if fields else ''}{join_names(fields)})"


def parse_structure_field_names(
    data: bytes, header: ArrayHeader, byte_order: str
) -> tuple[list[str], int]:
    """Return the names of the fields of a structure, and the offset of the first field."""
    _, _, offset, next_offset = parse_element_tag(data, header.data_offset, byte_order)
    (width,) = struct.unpack_from(f"{byte_order}I", data, offset)
    _, n_bytes, offset, next_offset = parse_element_tag(data, next_offset, byte_order)
    names = [
        data[start : start + width].split(b"\0")[0].decode("latin-1")
        for start in range(offset, min(offset + n_bytes, len(data)), max(width, 1))
    ]
    return names, next_offset


def parse_element_tag(head: bytes, offset: int, byte_order: str) -> tuple[int, int, int, int]:
    """Return type and size of an element, the offset of its data, and that of the next element."""
    kind, n_bytes = struct.unpack_from(f"{byte_order}II", head, offset)
    if kind >> 16:  # a small element: up to 4 bytes lie within the tag
        return kind & 0xFFFF, kind >> 16, offset + 4, offset + 8
    return kind, n_bytes, offset + 8, offset + 8 + -(-n_bytes // 8) * 8


def _open_inflate_stream(path: Path, start: int, n_bytes: int) -> InflateStream:
    """Open a reader of compressed bytes in the file."""
    return InflateStream(path, start, n_bytes, expected=EXPECTED, wbits=zlib.MAX_WBITS)
