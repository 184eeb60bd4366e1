"""Arrow stream of tables, read by DuckDB."""

import gc

import numpy as np
import pytest

from dechirp.core import arrow_stream
from dechirp.core.accessor import TableAccessor
from dechirp.core.arrow_stream import export_arrow_stream
from dechirp.core.detection_columns import detections_from_columns

duckdb = pytest.importorskip("duckdb")
COLUMNS = {
    "range_m": [1.5, None, -0.25],
    "ambiguity_number": [2, None, -(2**62)],
    "label": ["car", None, "Fußgänger"],
    "azimuth_deg": [None, None, None],
}


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
    assert types == ["DOUBLE", "BIGINT", "VARCHAR", "DOUBLE"]
    assert rows == list(zip(*COLUMNS.values(), strict=True))


def test_table_without_rows_keeps_its_columns():
    assert read_rows(Table({"range_m": [], "label": []}))[::2] == (["range_m", "label"], [])


def test_nine_and_more_missing_values_fill_several_bytes():
    cells = [None if n % 3 else n for n in range(20)]
    assert read_rows(Table({"n": cells}))[2] == [(cell,) for cell in cells]


def test_detections_have_the_rows_of_their_table():
    columns = {"frame": np.arange(3), "time": np.arange(3.0), "range": np.array([5.0, 2, 9])}
    detections = detections_from_columns(columns)
    accessor = TableAccessor(detections)
    names, _, rows = read_rows(accessor)
    frame = accessor.table()
    assert names == list(frame.columns)
    assert [row[names.index("range_m")] for row in rows] == [5.0, 2.0, 9.0]


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
    assert frame.to_dict(as_series=False) == COLUMNS
    assert [str(kind) for kind in frame.dtypes] == ["Float64", "Int64", "String", "Float64"]
    assert polars.DataFrame(Table({"range_m": []})).shape == (0, 1)
