"""Conversion of datasets to named arrays with a JSON description, and back."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr


def dataset_to_arrays_and_description(
    dataset: xr.Dataset,
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the arrays of a dataset by name, and their dimensions and attributes for JSON.

    Texts become UTF-8 bytes of equal length, (..., n) uint8; booleans and numbers are unchanged.
    """
    arrays: dict[str, np.ndarray] = {}
    description: dict[str, Any] = {"attrs": _to_json_attributes(dataset.attrs), "variables": {}}
    for key, variable in dataset.variables.items():
        name = str(key)
        values = np.asarray(variable.values)
        is_text = values.dtype.kind in "UO"
        arrays[name] = _texts_to_utf8_rows(values) if is_text else values
        description["variables"][name] = {
            "dims": [str(dim) for dim in variable.dims],
            "attrs": _to_json_attributes(variable.attrs),
            "is_text": is_text,
            "is_coordinate": key in dataset.coords,
        }
    return arrays, description


def dataset_from_arrays(
    arrays: Mapping[str, np.ndarray], description: Mapping[str, Any]
) -> xr.Dataset:
    """Rebuild the dataset from the result of `dataset_to_arrays_and_description`.

    Raises
    ------
    KeyError, TypeError, ValueError
        If arrays and description do not match.
    """
    variables: dict[str, xr.Variable] = {}
    coordinates: dict[str, xr.Variable] = {}
    for name, entry in description["variables"].items():
        values = np.asarray(arrays[name])
        values = _utf8_rows_to_texts(values) if entry["is_text"] else values
        variable = xr.Variable(tuple(entry["dims"]), values, dict(entry["attrs"]))
        (coordinates if entry["is_coordinate"] else variables)[name] = variable
    return xr.Dataset(variables, coordinates, dict(description["attrs"]))


def _to_json_attributes(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Convert NumPy numbers to Python numbers, which JSON accepts."""
    return {
        str(name): value.item() if isinstance(value, np.generic) else value
        for name, value in attributes.items()
    }


def _texts_to_utf8_rows(texts: np.ndarray) -> np.ndarray:
    encoded = [str(text).encode() for text in texts.ravel()]
    width = max(map(len, encoded), default=0)
    rows = b"".join(text.ljust(width, b"\0") for text in encoded)
    return np.frombuffer(rows, np.uint8).reshape(*texts.shape, width).copy()


def _utf8_rows_to_texts(encoded: np.ndarray) -> np.ndarray:
    *shape, width = encoded.shape
    rows = np.ascontiguousarray(encoded, np.uint8).reshape(int(np.prod(shape)), width)
    texts = [row.tobytes().rstrip(b"\0").decode() for row in rows]
    return np.array(texts, dtype=str).reshape(shape)
