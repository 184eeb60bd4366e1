"""Detections, truth, clusters and tracks as rows of a table: in files and in notebooks."""

import math
from itertools import combinations_with_replacement
from typing import NamedTuple, TypeAlias

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import TABLE
from dechirp.core.units import to_decibels

Cell: TypeAlias = str | int | float | None


class TableColumn(NamedTuple):
    """Cells of a column, None for missing values, and the type of the others."""

    cell_type: type[str] | type[int] | type[float]
    cells: list[Cell]


COLUMNS = {
    **{column.name_with_unit: column.name for column in TABLE},
    "cluster": "cluster",
    "motion": "motion",
    "label": "label",
}
"""Variable of a dataset behind each column. Datasets hold SI, radians and ratios."""

_OF_CLUSTERS = {
    **{column: name for column, name in COLUMNS.items() if name not in {"cluster", "label"}},
    **{
        column.extent_name_with_unit: f"{column.name}_extent"
        for column in TABLE
        if column.has_extent
    },
    "n_detections": "n_detections",
}

_INTEGERS = frozenset(
    {column.name_with_unit for column in TABLE if column.is_integer} | {"cluster", "in_view"}
)
_TEXTS = frozenset({"motion", "label"})
"""Columns that hold texts, also in datasets without a variable for them."""

_STATE = {"x_m": "x", "y_m": "y", "vx_m_per_s": "vx", "vy_m_per_s": "vy"}
_OF_TRACKS = {"track": "track", "frame": "frame", "time_s": "time", "status": "status", **_STATE}
_OF_GROUPS = {
    "turn_rate_deg_per_s": "turn_rate",
    "length_m": "length",
    "width_m": "width",
    "n_points": "n_points",
}
_PAIRS = tuple(combinations_with_replacement(_STATE.values(), 2))

_OF_EGO = {
    "frame": "frame",
    "time_s": "time",
    **{f"{name}_m_per_s": name for name in ("vx", "vy", "vx_std", "vy_std")},
    "n_static": "n_static",
}

_OF_VERTICAL_EGO = {"vz_m_per_s": "vz", "vz_std_m_per_s": "vz_std"}

_OF_TRAFFIC = {
    "target": "target",
    "frame": "frame",
    "time_s": "time",
    "range_m": "range",
    "velocity_m_per_s": "velocity",
    "azimuth_deg": "azimuth",
    **_STATE,
    "centre_x_m": "centre_x",
    "centre_y_m": "centre_y",
    "heading_deg": "heading",
    "length_m": "length",
    "width_m": "width",
    "visible_share": "visible_share",
    "n_detections": "n_detections",
    "position_error_m": "position_error",
    "velocity_error_m_per_s": "velocity_error",
}

_OF_FUSED_TRAFFIC = {
    "target": "target",
    "frame": "frame",
    "time_s": "time",
    **_STATE,
    "centre_x_m": "centre_x",
    "centre_y_m": "centre_y",
    "heading_deg": "heading",
    "length_m": "length",
    "width_m": "width",
    "in_view": "in_view",
}
"""Objects over the ground, of several radars: 1 in view of any of them, otherwise 0."""

_COLUMNS = {
    ("cluster",): _OF_CLUSTERS,
    ("frame",): _OF_EGO,
    ("frame", "target"): {**COLUMNS, "target": "target"},
}
"""Of datasets over these axes, where they have others than detections."""

_AXES = ("track", "frame", "target", "detection", "cluster")
"""Rows run along these, the last one fastest."""


def dataset_to_columns(dataset: xr.Dataset) -> dict[str, list[Cell]]:
    """Return the cells of each column, None for missing estimates; truth also has `target`."""
    return {name: column.cells for name, column in dataset_to_typed_columns(dataset).items()}


def dataset_to_typed_columns(dataset: xr.Dataset) -> dict[str, TableColumn]:
    """Return the columns, with types that do not depend on the number of rows.

    Tracks have only the rows in which they exist, and their covariance in columns such as
    `covariance_x_vy`, in SI units; those of extended objects also turn rate, axes and points.
    """
    dims = [name for name in _AXES if name in dataset.dims]
    if dims == ["track", "frame"]:
        return _tracks_to_columns(dataset)
    wanted = _COLUMNS.get(tuple(dims), COLUMNS)
    for variable, columns in (("visible_share", _OF_TRAFFIC), ("in_view", _OF_FUSED_TRAFFIC)):
        if variable in dataset:
            wanted = columns
    if wanted is _OF_EGO and "vz" in dataset:
        wanted = {**_OF_EGO, **_OF_VERTICAL_EGO}
    rows = dataset.stack(row=dims, create_index=False)
    if wanted in (_OF_TRAFFIC, _OF_FUSED_TRAFFIC):  # objects, only in frames with a position
        rows = rows.isel(row=np.flatnonzero(np.isfinite(rows["x"].values)))
    n_rows = rows.sizes["row"]
    return {
        column: _convert_to_column_of_files(column, rows[name].values)
        if name in rows.variables
        else TableColumn(_type_of_absent_column(column), [None] * n_rows)
        for column, name in wanted.items()
    }


def _tracks_to_columns(tracks: xr.Dataset) -> dict[str, TableColumn]:
    rows = tracks.stack(row=["track", "frame"], create_index=False).transpose("row", ...)
    present = rows.isel(row=np.flatnonzero(rows["status"].values != ""))
    covariance = present["covariance"]
    return {
        **{
            column: _convert_to_column_of_files(column, present[name].values)
            for column, name in {**_OF_TRACKS, **_OF_GROUPS}.items()
            if name in present.variables
        },
        **{
            f"covariance_{a}_{b}": _convert_to_column_of_files(
                "", covariance.sel(state=a, other_state=b).values
            )
            for a, b in _PAIRS
        },
    }


def dataset_to_records(dataset: xr.Dataset) -> list[dict[str, Cell]]:
    """Return a mapping from column to cell for each row."""
    table = dataset_to_columns(dataset)
    return [dict(zip(table, cells, strict=True)) for cells in zip(*table.values(), strict=True)]


def _convert_to_column_of_files(column: str, values: np.ndarray) -> TableColumn:
    if column.endswith("_db"):
        with np.errstate(divide="ignore"):  # no signal at all is minus infinity
            values = to_decibels(values)
    elif column.endswith(("_deg", "_deg_per_s")):
        values = np.degrees(values)
    cells = [None if isinstance(c, float) and not math.isfinite(c) else c for c in values.tolist()]
    if values.dtype.kind in "iub" or column in _INTEGERS:
        # Integers are floats in datasets, beside NaN where none is known.
        return TableColumn(int, [None if c is None else int(c) for c in cells])
    return TableColumn(float if values.dtype.kind == "f" else str, cells)


def _type_of_absent_column(column: str) -> type[str] | type[int] | type[float]:
    if column in _TEXTS:
        return str
    return int if column in _INTEGERS else float
