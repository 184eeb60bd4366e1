"""Columns of tables as lists of JSON, with their types and shapes, and back bit by bit.

JSON has no NaN and no infinity: those are null, "inf" and "-inf". Complex numbers are two in turn.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

NUMBERS = frozenset(
    ["bool", "float32", "float64", "complex64", "complex128"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)
"""What a column can be of, besides texts, in every container."""
TYPES = NUMBERS | {"float16", "str"}
"""What a column can be of in JSON."""


def listed(column: np.ndarray) -> dict[str, Any]:
    """A column, as JSON takes it: its type, one of `TYPES`, its shape and its values in a row."""
    flat = np.ascontiguousarray(column).reshape(-1)
    if column.dtype.kind in "UO":
        return {"dtype": "str", "shape": column.shape, "values": [str(text) for text in flat]}
    parts = flat.view(flat.real.dtype) if column.dtype.kind == "c" else flat
    values = parts.tolist()
    if parts.dtype.kind == "f" and not np.isfinite(parts).all():
        values = [_word(one) if not math.isfinite(one) else one for one in values]
    return {"dtype": column.dtype.name, "shape": column.shape, "values": values}


def unlisted(said: Mapping[str, Any]) -> np.ndarray:
    """The column again, of what `listed` gave.

    Raises
    ------
    KeyError, TypeError, ValueError, OverflowError
        If it is damaged.
    """
    name, shape, values = said["dtype"], tuple(said["shape"]), list(said["values"])
    if name not in TYPES:
        raise ValueError(f"a column of {name!r}")
    if name == "str":
        return np.array([str(one) for one in values], dtype=str).reshape(shape)
    dtype = np.dtype(name)
    if dtype.kind == "c":
        parts = np.array(values, dtype=np.zeros(0, dtype).real.dtype)
        return parts.view(dtype).reshape(shape)
    return np.array(values, dtype=dtype).reshape(shape)


def _word(one: float) -> str | None:
    return None if math.isnan(one) else str(one)
