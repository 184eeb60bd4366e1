"""Arrow stream of tables, read by DuckDB and Polars, and types of tables."""

import gc

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from dechirp.core import arrow_stream
from dechirp.core.accessor import TableAccessor
from dechirp.core.arrow_stream import export_arrow_stream
from dechirp.core.detection_columns import detections_from_columns
from dechirp.core.table_columns import TableColumn

duckdb = pytest.importorskip("duckdb")
COLUMNS = {
    "range_m": TableColumn(float, [1.5, None, -0.25]),
    "ambiguity_number": TableColumn(int, [2, None, -(2**62)]),
    "label": TableColumn(str, ["car", None, "Fußgänger"]),
    "azimuth_deg": TableColumn(float, [None, None, None]),
    "cluster": TableColumn(int, [None, None, None]),
    "motion": TableColumn(str, [None, None, None]),
}
CELLS = {name: column.cells for name, column in COLUMNS.items()}


class Table:
    def __init__(self, columns):
        self.columns = columns

    def __arrow_c_stream__(self, requested_schema=None):
        return export_arrow_stream(self.columns)


def read_rows(rows_of_user):
    relation = duckdb.sql("select * from rows_of_user")  # a variable of this name
    return relation.columns, [str(kind) for kind in relation.types], relation.fetchall()


def test_cells_types_and_missing_values_arrive():
    names, types, rows = read_rows(Table(COLUMNS))
    assert names == list(COLUMNS)
    assert types == ["DOUBLE", "BIGINT", "VARCHAR", "DOUBLE", "BIGINT", "VARCHAR"]
    assert rows == list(zip(*CELLS.values(), strict=True))


def test_table_without_rows_keeps_its_columns_and_types():
    names, types, rows = read_rows(
        Table({name: TableColumn(column.cell_type, []) for name, column in COLUMNS.items()})
    )
    assert names == list(COLUMNS)
    assert types == read_rows(Table(COLUMNS))[1]
    assert rows == []


def test_nine_and_more_missing_values_fill_several_bytes():
    cells = [None if n % 3 else n for n in range(20)]
    assert read_rows(Table({"n": TableColumn(int, cells)}))[2] == [(cell,) for cell in cells]


def make_detections(n_rows=3, **others):
    columns = {"frame": np.arange(3), "time": np.arange(3.0), "range": np.array([5.0, 2, 9])}
    columns |= {"ambiguity_number": np.array([np.nan, 0, 1]), "moving": np.full(3, np.nan)}
    return detections_from_columns(columns | others).isel(detection=slice(n_rows))


def test_detections_have_the_rows_of_their_table():
    accessor = TableAccessor(make_detections())
    names, _, rows = read_rows(accessor)
    frame = accessor.table()
    assert names == list(frame.columns)
    assert [row[names.index("range_m")] for row in rows] == [5.0, 2.0, 9.0]


TYPES = {
    "frame": "Int64",
    "range_m": "Float64",
    "azimuth_deg": "Float64",
    "ambiguity_number": "Int64",
    "moving": "Int64",
    "cluster": "Int64",
    "motion": "String",
    "label": "String",
}


def test_types_of_columns_do_not_depend_on_the_rows():
    polars = pytest.importorskip("polars")
    full, empty = TableAccessor(make_detections()), TableAccessor(make_detections(0))
    assert read_rows(full)[1] == read_rows(empty)[1]
    for accessor in (full, empty):
        schema = polars.DataFrame(accessor).schema
        assert {name: str(schema[name]) for name in TYPES} == TYPES
    rows = polars.concat([polars.DataFrame(full), polars.DataFrame(empty)])
    assert rows["frame"].to_list() == [0, 1, 2]


def test_pandas_keeps_types_of_columns_with_missing_values():
    types = TableAccessor(make_detections()).table().dtypes.astype(str)
    assert types["frame"] == "int64"
    assert (types[["ambiguity_number", "moving", "cluster"]] == "Int64").all()
    assert types["range_m"] == types["azimuth_deg"] == "float64"
    assert types["motion"] == types["label"] == str(pd.Series([], dtype="str").dtype)


def test_frames_with_and_without_detections_join_with_the_types_of_either():
    texts = {"label": np.array(["car", "", "tree"]), "cluster": np.array([0, -1, 0])}
    full = TableAccessor(make_detections(**texts)).table()
    empty = TableAccessor(make_detections(0)).table()
    both = pd.concat([empty, full, empty])
    assert both.dtypes.equals(TableAccessor(make_detections(**texts)).table().dtypes)
    assert both.frame.tolist() == [0, 1, 2]
    assert both.label.tolist() == ["car", "", "tree"]


def test_tracks_without_rows_keep_their_types():
    tracks = xr.Dataset(
        {
            "status": (("track", "frame"), np.array([["confirmed", ""]])),
            **{name: (("track", "frame"), np.zeros((1, 2))) for name in ("x", "y", "vx", "vy")},
            "covariance": (
                ("track", "frame", "state", "other_state"),
                np.zeros((1, 2, 4, 4)),
            ),
        },
        coords={
            "track": [3],
            "frame": [0, 1],
            "time": ("frame", [0.0, 0.1]),
            "state": ["x", "y", "vx", "vy"],
            "other_state": ["x", "y", "vx", "vy"],
        },
    )
    full, empty = TableAccessor(tracks), TableAccessor(tracks.isel(track=[]))
    assert full.table().dtypes.equals(empty.table().dtypes)
    assert read_rows(full)[1] == read_rows(empty)[1]
    assert full.table().dtypes[["track", "frame"]].astype(str).tolist() == ["int64", "int64"]


def test_structures_are_released_read_or_not():
    gc.collect()
    n_kept = len(arrow_stream._kept), len(arrow_stream._capsule_streams)
    for _ in range(3):
        Table(COLUMNS).__arrow_c_stream__()
        read_rows(Table(COLUMNS))
    gc.collect()
    assert (len(arrow_stream._kept), len(arrow_stream._capsule_streams)) == n_kept


def test_polars_takes_the_columns_with_their_types():
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame(Table(COLUMNS))
    assert frame.to_dict(as_series=False) == CELLS
    types = ["Float64", "Int64", "String", "Float64", "Int64", "String"]
    assert [str(kind) for kind in frame.dtypes] == types
