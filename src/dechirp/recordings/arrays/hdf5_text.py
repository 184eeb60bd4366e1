"""Variable-length texts of HDF5 files, read without the library.

In a damaged heap of such texts, HDF5 (2.0) searches for ever. A text is stored as its length, the
address of a heap and the number of an object in it; each object has a header with its size. See The
HDF Group, HDF5 File Format Specification Version 3.0, III.E "Global Heap".
"""

import struct
from typing import Any, BinaryIO

_POINTER = struct.Struct("<IQI")  # length of the text, address of the heap, number of the object
_HEAP = struct.Struct("<4sB3xQ")  # signature, version, size with this header
_OBJECT = struct.Struct("<HHIQ")  # number, references, reserved, size without this header
_ALIGNMENT = 8


def read_scalar_text(stream: BinaryIO, dataset: Any, *, max_bytes: int) -> bytes:
    """Return the text of a scalar dataset, of fixed or variable length.

    Parameters
    ----------
    stream : binary file
        The whole HDF5 file.
    dataset : h5py.Dataset
    max_bytes : int
        Longest text.

    Raises
    ------
    ValueError
        If the dataset is no text, or the file is damaged there.
    """
    import h5py

    information = h5py.check_string_dtype(dataset.dtype)
    if dataset.shape != () or information is None:
        raise ValueError(f"{dataset.name} is no text")
    if information.length is not None:
        if information.length > max_bytes:
            raise ValueError(f"{dataset.name} has {information.length} bytes")
        return bytes(dataset[()])
    offset = dataset.id.get_offset()
    if offset is None:
        raise ValueError(f"{dataset.name} is not stored in one piece")
    length, address, number = _POINTER.unpack(_read_at(stream, offset, _POINTER.size))
    if length > max_bytes:
        raise ValueError(f"{dataset.name} has {length} bytes")
    return _read_heap_object(stream, address, number)[:length]


def _read_heap_object(stream: BinaryIO, address: int, number: int) -> bytes:
    signature, version, size = _HEAP.unpack(_read_at(stream, address, _HEAP.size))
    if (signature, version) != (b"GCOL", 1):
        raise ValueError("no heap of texts at its address")
    position, end = address + _HEAP.size, address + size
    while position + _OBJECT.size <= end:
        index, _, _, n_bytes = _OBJECT.unpack(_read_at(stream, position, _OBJECT.size))
        position += _OBJECT.size
        if index == 0 or position + n_bytes > end:  # free space is last
            break
        if index == number:
            return _read_at(stream, position, n_bytes)
        position += -(-n_bytes // _ALIGNMENT) * _ALIGNMENT
    raise ValueError("the heap of texts lacks an object")


def _read_at(stream: BinaryIO, position: int, n_bytes: int) -> bytes:
    end = stream.seek(0, 2)
    if position + n_bytes > end:
        raise ValueError("a text beyond the end of the file")
    stream.seek(position)
    return stream.read(n_bytes)
