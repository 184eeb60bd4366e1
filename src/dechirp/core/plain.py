"""Labelled tables as named arrays and one description, for files that hold no more than that."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr


def plain(dataset: xr.Dataset) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays of a dataset by name, and what JSON can say of them: dimensions and attributes.

    Texts become UTF-8 bytes of one length, (..., n) uint8; booleans and numbers stay as they are.
    """
    arrays: dict[str, np.ndarray] = {}
    said: dict[str, Any] = {"attrs": _said(dataset.attrs), "variables": {}}
    for key, variable in dataset.variables.items():
        name = str(key)
        values = np.asarray(variable.values)
        is_text = values.dtype.kind in "UO"
        arrays[name] = _bytes(values) if is_text else values
        said["variables"][name] = {
            "dims": [str(dim) for dim in variable.dims],
            "attrs": _said(variable.attrs),
            "is_text": is_text,
            "is_coordinate": key in dataset.coords,
        }
    return arrays, said


def labelled(arrays: Mapping[str, np.ndarray], said: Mapping[str, Any]) -> xr.Dataset:
    """The dataset again, of what `plain` gave.

    Raises
    ------
    KeyError, TypeError, ValueError
        If they do not belong together.
    """
    variables: dict[str, xr.Variable] = {}
    coordinates: dict[str, xr.Variable] = {}
    for name, of in said["variables"].items():
        values = np.asarray(arrays[name])
        values = _texts(values) if of["is_text"] else values
        made = xr.Variable(tuple(of["dims"]), values, dict(of["attrs"]))
        (coordinates if of["is_coordinate"] else variables)[name] = made
    return xr.Dataset(variables, coordinates, dict(said["attrs"]))


def _said(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """Attributes with plain Python numbers, which JSON takes."""
    return {
        str(name): value.item() if isinstance(value, np.generic) else value
        for name, value in attributes.items()
    }


def _bytes(texts: np.ndarray) -> np.ndarray:
    encoded = [str(text).encode() for text in texts.ravel()]
    width = max(map(len, encoded), default=0)
    rows = b"".join(one.ljust(width, b"\0") for one in encoded)
    return np.frombuffer(rows, np.uint8).reshape(*texts.shape, width).copy()


def _texts(encoded: np.ndarray) -> np.ndarray:
    *shape, width = encoded.shape
    rows = np.ascontiguousarray(encoded, np.uint8).reshape(int(np.prod(shape)), width)
    texts = [row.tobytes().rstrip(b"\0").decode() for row in rows]
    return np.array(texts, dtype=str).reshape(shape)
