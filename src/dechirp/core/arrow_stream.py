"""Arrow stream of a table, by the C data interface, for libraries such as Polars and DuckDB.

A table is a structure (`+s`) with a child for each column: 64-bit integers (`l`), 64-bit floats
(`g`) or UTF-8 texts with 64-bit offsets (`U`), each with a bitmap of the cells that are present.

References
----------
Apache Arrow, The Arrow C data interface, and The Arrow PyCapsule interface, 2024.
"""

import ctypes
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dechirp.core.table_columns import TableColumn

_NULLABLE = 2
_CAPSULE_NAME = b"arrow_array_stream"


class _Schema(ctypes.Structure):
    pass


class _Array(ctypes.Structure):
    pass


class _Stream(ctypes.Structure):
    pass


_ReleaseSchema = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Schema))
_ReleaseArray = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Array))
_ReleaseStream = ctypes.CFUNCTYPE(None, ctypes.POINTER(_Stream))
_GetSchema = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(_Stream), ctypes.POINTER(_Schema))
_GetNext = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(_Stream), ctypes.POINTER(_Array))
_GetError = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.POINTER(_Stream))

_Schema._fields_ = [
    ("format", ctypes.c_char_p),
    ("name", ctypes.c_char_p),
    ("metadata", ctypes.c_char_p),
    ("flags", ctypes.c_int64),
    ("n_children", ctypes.c_int64),
    ("children", ctypes.POINTER(ctypes.POINTER(_Schema))),
    ("dictionary", ctypes.POINTER(_Schema)),
    ("release", _ReleaseSchema),
    ("private_data", ctypes.c_void_p),
]
_Array._fields_ = [
    ("length", ctypes.c_int64),
    ("null_count", ctypes.c_int64),
    ("offset", ctypes.c_int64),
    ("n_buffers", ctypes.c_int64),
    ("n_children", ctypes.c_int64),
    ("buffers", ctypes.POINTER(ctypes.c_void_p)),
    ("children", ctypes.POINTER(ctypes.POINTER(_Array))),
    ("dictionary", ctypes.POINTER(_Array)),
    ("release", _ReleaseArray),
    ("private_data", ctypes.c_void_p),
]
_Stream._fields_ = [
    ("get_schema", _GetSchema),
    ("get_next", _GetNext),
    ("get_last_error", _GetError),
    ("release", _ReleaseStream),
    ("private_data", ctypes.c_void_p),
]


def export_arrow_stream(columns: Mapping[str, TableColumn]) -> object:
    """Return a capsule with an Arrow stream of one batch."""
    kept = _keep(_StreamState(columns))
    stream = _Stream(_get_schema, _get_next, _get_last_error, _release_stream, kept)
    # A consumer moves the stream elsewhere and may release it before the capsule is destroyed.
    _capsule_streams[ctypes.addressof(stream)] = stream
    return ctypes.pythonapi.PyCapsule_New(ctypes.byref(stream), _CAPSULE_NAME, _destroy_capsule)


class _StreamState:
    """Table of a stream, and whether its batch is still to be sent."""

    def __init__(self, columns: Mapping[str, TableColumn]) -> None:
        self.columns = [_Column(name, column) for name, column in columns.items()]
        self.n_rows = len(next(iter(columns.values())).cells)
        self.is_sent = False


class _Column:
    """Column in the layout of Arrow: its format and its buffers."""

    def __init__(self, name: str, column: TableColumn) -> None:
        cells = column.cells
        is_present = np.array([cell is not None for cell in cells], dtype=bool)
        self.name, self.n_missing = name.encode(), int(np.sum(~is_present))
        values: list[np.ndarray]
        if column.cell_type is str:
            texts = [b"" if cell is None else str(cell).encode() for cell in cells]
            self.format = b"U"
            ends = np.cumsum([0, *map(len, texts)], dtype=np.int64)
            values = [ends, np.frombuffer(b"".join(texts), np.uint8)]
        elif column.cell_type is int:
            self.format = b"l"
            values = [np.array([0 if cell is None else cell for cell in cells], np.int64)]
        else:
            self.format = b"g"
            values = [np.array([np.nan if cell is None else cell for cell in cells], float)]
        self.buffers = [np.packbits(is_present, bitorder="little"), *values]


_kept: dict[int, Any] = {}
"""Objects behind structures that a consumer has not released, by their number."""
_capsule_streams: dict[int, _Stream] = {}
"""Memory of the streams of capsules, by its address."""
_numbers = itertools.count(1)


def _keep(*objects: Any) -> int:
    """Keep objects alive until a release of the returned number."""
    number = next(_numbers)
    _kept[number] = objects
    return number


def _release_structure(pointer: Any) -> None:
    """Release the children that the consumer has not moved elsewhere, then the structure."""
    structure = pointer.contents
    for index in range(structure.n_children):
        child = structure.children[index]
        if child.contents.release:
            child.contents.release(child)
    structure.release = type(structure.release)()  # null marks it as released
    _kept.pop(structure.private_data, None)


_release_schema = _ReleaseSchema(_release_structure)
_release_array = _ReleaseArray(_release_structure)


def _create_schema(name: bytes, format_: bytes, children: Sequence[_Schema]) -> _Schema:
    pointers = (ctypes.POINTER(_Schema) * len(children))(*map(ctypes.pointer, children))
    kept = _keep(name, format_, children, pointers)
    return _Schema(
        format_, name, None, _NULLABLE, len(children), pointers, None, _release_schema, kept
    )


def _create_array(
    n_rows: int, n_missing: int, buffers: Sequence[np.ndarray | None], children: Sequence[_Array]
) -> _Array:
    addresses = [None if buffer is None else buffer.ctypes.data for buffer in buffers]
    buffer_pointers = (ctypes.c_void_p * len(addresses))(*addresses)
    pointers = (ctypes.POINTER(_Array) * len(children))(*map(ctypes.pointer, children))
    kept = _keep(buffers, buffer_pointers, children, pointers)
    return _Array(
        *(n_rows, n_missing, 0, len(addresses), len(children)),
        *(buffer_pointers, pointers, None, _release_array, kept),
    )


def _move(structure: _Schema | _Array, out: Any) -> int:
    ctypes.memmove(out, ctypes.byref(structure), ctypes.sizeof(structure))
    return 0


@_GetSchema
def _get_schema(stream: Any, out: Any) -> int:
    (state,) = _kept[stream.contents.private_data]
    children = [_create_schema(column.name, column.format, []) for column in state.columns]
    return _move(_create_schema(b"", b"+s", children), out)


@_GetNext
def _get_next(stream: Any, out: Any) -> int:
    (state,) = _kept[stream.contents.private_data]
    if state.is_sent:
        out.contents.release = _ReleaseArray()  # the end of the stream
        return 0
    state.is_sent = True
    children = [
        _create_array(state.n_rows, column.n_missing, column.buffers, [])
        for column in state.columns
    ]
    return _move(_create_array(state.n_rows, 0, [None], children), out)


@_GetError
def _get_last_error(stream: Any) -> None:
    return None


@_ReleaseStream
def _release_stream(stream: Any) -> None:
    stream.contents.release = _ReleaseStream()
    _kept.pop(stream.contents.private_data, None)


# The capsule is passed as an address: a reference would revive it while it is destroyed.
@ctypes.CFUNCTYPE(None, ctypes.c_void_p)
def _destroy_capsule(capsule: int) -> None:
    address = ctypes.pythonapi.PyCapsule_GetPointer(capsule, _CAPSULE_NAME)
    stream = ctypes.cast(address, ctypes.POINTER(_Stream))
    if stream.contents.release:
        stream.contents.release(stream)
    del _capsule_streams[address]


ctypes.pythonapi.PyCapsule_New.restype = ctypes.py_object
ctypes.pythonapi.PyCapsule_New.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
ctypes.pythonapi.PyCapsule_GetPointer.restype = ctypes.c_void_p
ctypes.pythonapi.PyCapsule_GetPointer.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
