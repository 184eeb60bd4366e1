"""Columns of detections, as arrays; what is no table of detections is refused."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.errors import InvalidSetting


def columns(
    detections: xr.Dataset, needed: Sequence[str], others: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Columns of detections as floats, (n,) each; NaN for `others` that are not there.

    Raises
    ------
    InvalidSetting
        If it is no dataset over `detection`, one that is needed is missing, or one is no number.
    """
    must_be("detections", detections, xr.Dataset, fix="Give what `detect` returns.")
    missing = [name for name in needed if name not in detections]
    if missing or "detection" not in detections.dims:
        raise InvalidSetting(
            "detections",
            got=f"without {', '.join(missing) or 'the axis detection'}",
            need=f"over `detection`, with {', '.join(needed)}",
            fix="Give what `detect` returns.",
        )
    unknown = np.full(detections.sizes["detection"], np.nan)
    return {
        name: _floats(detections[name]) if name in detections else unknown
        for name in (*needed, *others)
    }


def must_hold(told: Mapping[str, np.ndarray], rules: Mapping[str, tuple[np.ndarray, str]]) -> None:
    """Raise `InvalidSetting` about the first column that is not right in every row.

    `rules`: of each column where it is right, (n,), and in words what it must be.
    """
    for name, (right, need) in rules.items():
        if not right.all():
            raise InvalidSetting(
                f"detections.{name}",
                got=f"{told[name][~right][0]} in {(~right).sum()} of {right.size}",
                need=need,
                fix="Leave these detections out.",
            )


def is_frame_number(numbers: np.ndarray) -> np.ndarray:
    """Where numbers are those of frames: whole, 0 or more."""
    return np.asarray((numbers >= 0) & (numbers == np.floor(numbers)))


def must_be(name: str, given: object, kind: type[Any], *, fix: str) -> None:
    """Raise `InvalidSetting` unless an argument is of a class."""
    if not isinstance(given, kind):
        raise InvalidSetting(
            name, got=f"a {type(given).__name__}", need=f"a {kind.__name__}", fix=fix
        )


def _floats(column: xr.DataArray) -> np.ndarray:
    if column.dims != ("detection",) or column.dtype.kind not in "iuf":
        raise InvalidSetting(
            f"detections.{column.name}",
            got=f"{column.dtype} over {', '.join(map(str, column.dims)) or 'nothing'}",
            need="a number for each detection",
            fix="Give what `detect` returns.",
        )
    return np.asarray(column.values, dtype=float)
