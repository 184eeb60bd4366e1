"""Table columns as JSON lists with type and shape, restored bit by bit.

JSON has no NaN and no infinity: those become null, "inf" and "-inf". Complex numbers become two
consecutive numbers.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

NUMBERS = frozenset(
    ["bool", "float32", "float64", "complex64", "complex128"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)
"""Numeric types of a column in every container."""
TYPES = NUMBERS | {"float16", "str"}
"""Types of a column in JSON."""


def column_to_json(column: np.ndarray) -> dict[str, Any]:
    """Convert a column to a JSON object: type (one of `TYPES`), shape, and flattened values."""
    flat = np.ascontiguousarray(column).reshape(-1)
    if column.dtype.kind in "UO":
        return {"dtype": "str", "shape": column.shape, "values": [str(text) for text in flat]}
    parts = flat.view(flat.real.dtype) if column.dtype.kind == "c" else flat
    values = parts.tolist()
    if parts.dtype.kind == "f" and not np.isfinite(parts).all():
        values = [
            _non_finite_to_null_or_text(number) if not math.isfinite(number) else number
            for number in values
        ]
    return {"dtype": column.dtype.name, "shape": column.shape, "values": values}


def column_from_json(json_column: Mapping[str, Any]) -> np.ndarray:
    """Restore the column that `column_to_json` converted.

    Raises
    ------
    KeyError, TypeError, ValueError, OverflowError
        If it is damaged.
    """
    name, shape, values = (
        json_column["dtype"],
        tuple(json_column["shape"]),
        list(json_column["values"]),
    )
    if name not in TYPES:
        raise ValueError(f"a column of {name!r}")
    if name == "str":
        return np.array([str(text) for text in values], dtype=str).reshape(shape)
    dtype = np.dtype(name)
    if dtype.kind == "c":
        parts = np.array(values, dtype=np.zeros(0, dtype).real.dtype)
        return parts.view(dtype).reshape(shape)
    return np.array(values, dtype=dtype).reshape(shape)


def _non_finite_to_null_or_text(number: float) -> str | None:
    """Return the JSON value of a non-finite number."""
    return None if math.isnan(number) else str(number)
