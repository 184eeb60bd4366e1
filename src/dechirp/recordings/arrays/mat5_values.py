"""Small values of MATLAB files (version 5 to 7): texts, arrays and structures, read at once."""

import math
from collections.abc import Iterator

import numpy as np

from dechirp.recordings.arrays.mat5 import (
    CLASSES,
    TYPES,
    ArrayHeader,
    Element,
    parse_array_header,
    parse_element_tag,
    parse_structure_field_names,
)

Value = str | np.ndarray | dict[str, np.ndarray]
"""A text, an array with its axes as MATLAB shows them, or a structure of such arrays."""

_STRUCTURE, _TEXT = 2, 4
# Text encodings, by type number.
_TEXT_CODECS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}


def read_variable_value(element: Element, max_bytes: int) -> Value:
    """Read the value of a variable, of at most `max_bytes`.

    Raises
    ------
    RecordingError
        If it is larger.
    ValueError, KeyError, struct.error
        If it is damaged, or neither text, numbers, nor one structure of arrays.
    """
    data, order = element.read_all_decompressed(max_bytes), element.byte_order
    header = parse_array_header(data, 0, order)
    if header.class_code == _TEXT:
        return _parse_character_array(data, header, order)
    if header.class_code == _STRUCTURE:
        return dict(_iter_structure_fields(data, header, order, max_bytes))
    return _parse_numeric_array(data, header, order, max_bytes)


def _parse_character_array(data: bytes, header: ArrayHeader, byte_order: str) -> str:
    """Decode a text."""
    kind, n_bytes, offset, _ = parse_element_tag(data, header.data_offset, byte_order)
    codec = _TEXT_CODECS[kind]
    endian_suffix = {"<": "-le", ">": "-be"}[byte_order] if codec in ("utf-16", "utf-32") else ""
    return data[offset : offset + n_bytes].decode(codec + endian_suffix)


def _iter_structure_fields(
    data: bytes, header: ArrayHeader, byte_order: str, max_bytes: int
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and array of each field of a structure."""
    if math.prod(header.shape) != 1:
        raise ValueError(f"an array of {header.shape} structures")
    names, next_offset = parse_structure_field_names(data, header, byte_order)
    for name in names:
        field_offset, (_, _, _, next_offset) = (
            next_offset,
            parse_element_tag(data, next_offset, byte_order),
        )
        yield (
            name,
            _parse_numeric_array(
                data, parse_array_header(data, field_offset, byte_order), byte_order, max_bytes
            ),
        )


def _parse_numeric_array(
    data: bytes, header: ArrayHeader, byte_order: str, max_bytes: int
) -> np.ndarray:
    """Parse an array of numbers."""
    numbers = np.dtype(CLASSES[header.class_code])
    # Stored numbers may have a smaller type, so the array may be larger than the file.
    n_bytes = math.prod(header.shape) * numbers.itemsize
    if not 0 <= n_bytes <= max_bytes:
        raise ValueError(f"an array {header.name!r} of {n_bytes} bytes")
    real, imaginary_offset = _parse_real_or_imaginary_part(
        data, header, byte_order, header.data_offset
    )
    if header.is_complex:
        values = np.empty(header.shape, np.result_type(numbers, np.complex64))
        values.real, values.imag = (
            real,
            _parse_real_or_imaginary_part(data, header, byte_order, imaginary_offset)[0],
        )
        return values
    return real.astype(bool if header.is_logical else numbers)


def _parse_real_or_imaginary_part(
    data: bytes, header: ArrayHeader, byte_order: str, offset: int
) -> tuple[np.ndarray, int]:
    """Parse the real or imaginary part; return it with the offset of the next part."""
    kind, n_bytes, offset, next_offset = parse_element_tag(data, offset, byte_order)
    dtype = np.dtype(byte_order + TYPES[kind])
    if n_bytes != math.prod(header.shape) * dtype.itemsize:
        raise ValueError(f"{n_bytes} bytes for {header.name!r} of {header.shape}")
    flat = np.frombuffer(data, dtype, n_bytes // dtype.itemsize, offset)
    return flat.reshape(header.shape, order="F"), next_offset
