"""Detections, truth, clusters and tracks as rows of a table: in files and in notebooks."""

import math
from itertools import combinations_with_replacement
from typing import TypeAlias

import numpy as np
import xarray as xr

from dechirp.core.units import decibels

Cell: TypeAlias = str | int | float | None

COLUMNS = {
    "frame": "frame",
    "time_s": "time",
    "range_m": "range",
    "velocity_m_per_s": "velocity",
    "azimuth_deg": "azimuth",
    "elevation_deg": "elevation",
    "snr_db": "snr",
    "range_std_m": "range_std",
    "velocity_std_m_per_s": "velocity_std",
    "azimuth_std_deg": "azimuth_std",
    "elevation_std_deg": "elevation_std",
    "fold": "fold",
    "fold_confidence": "fold_confidence",
    "cluster": "cluster",
    "motion": "motion",
    "label": "label",
}
"""Variable of a dataset behind each column. Datasets hold SI, radians and ratios."""

_OF_CLUSTERS = {
    **{column: name for column, name in COLUMNS.items() if name not in {"cluster", "label"}},
    "range_extent_m": "range_extent",
    "velocity_extent_m_per_s": "velocity_extent",
    "azimuth_extent_deg": "azimuth_extent",
    "n_detections": "n_detections",
}

_STATE = {"x_m": "x", "y_m": "y", "vx_m_per_s": "vx", "vy_m_per_s": "vy"}
_OF_TRACKS = {"track": "track", "frame": "frame", "time_s": "time", "status": "status", **_STATE}
_PAIRS = tuple(combinations_with_replacement(_STATE.values(), 2))

_OF_EGO = {
    "frame": "frame",
    "time_s": "time",
    **{f"{name}_m_per_s": name for name in ("vx", "vy", "vx_std", "vy_std")},
    "n_static": "n_static",
}

_COLUMNS = {
    ("cluster",): _OF_CLUSTERS,
    ("frame",): _OF_EGO,
    ("frame", "target"): {**COLUMNS, "target": "target"},
}
"""Of datasets over these axes, where they have others than detections."""

_AXES = ("track", "frame", "target", "detection", "cluster")
"""Rows run along these, the last one fastest."""


def columns(dataset: xr.Dataset) -> dict[str, list[Cell]]:
    """Cells of each column, None where nothing was estimated; truth also has `target`.

    Of tracks those rows alone where they are, and the covariance as `covariance_x_vy` and so on,
    in SI units.
    """
    over = [name for name in _AXES if name in dataset.dims]
    if over == ["track", "frame"]:
        return _of_tracks(dataset)
    wanted = _COLUMNS.get(tuple(over), COLUMNS)
    rows = dataset.stack(row=over, create_index=False)
    n_rows = rows.sizes["row"]
    return {
        column: _cells(column, rows[name].values) if name in rows.variables else [None] * n_rows
        for column, name in wanted.items()
    }


def _of_tracks(tracks: xr.Dataset) -> dict[str, list[Cell]]:
    rows = tracks.stack(row=["track", "frame"], create_index=False).transpose("row", ...)
    there = rows.isel(row=np.flatnonzero(rows["status"].values != ""))
    covariance = there["covariance"]
    return {
        **{column: _cells(column, there[name].values) for column, name in _OF_TRACKS.items()},
        **{
            f"covariance_{a}_{b}": _cells("", covariance.sel(state=a, other_state=b).values)
            for a, b in _PAIRS
        },
    }


def records(dataset: xr.Dataset) -> list[dict[str, Cell]]:
    """One mapping from column to cell for each row."""
    table = columns(dataset)
    return [dict(zip(table, cells, strict=True)) for cells in zip(*table.values(), strict=True)]


def _cells(column: str, values: np.ndarray) -> list[Cell]:
    if column.endswith("_db"):
        with np.errstate(divide="ignore"):  # no signal at all is minus infinity
            values = decibels(values)
    elif column.endswith("_deg"):
        values = np.degrees(values)
    cells = [None if isinstance(c, float) and not math.isfinite(c) else c for c in values.tolist()]
    # Folds are whole numbers, kept as floats beside NaN where none is known.
    return [None if c is None else int(c) for c in cells] if column == "fold" else cells
