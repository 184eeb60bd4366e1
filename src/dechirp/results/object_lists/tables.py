"""Object lists as tables: CSV, and Parquet through DuckDB, a row for each object.

Columns carry their units (`x_m`), the ratio is in dB (`snr_db`), and unknown values are empty.
Frames without objects have no row.
"""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.atomic_files import atomic_output_file, check_file_suffix
from dechirp.core.detection_columns import TABLE
from dechirp.core.duckdb_memory import (
    connect_duckdb_in_memory,
    escape_glob_wildcards,
    quote_sql_string,
    utf8_path_alias,
)
from dechirp.core.errors import RecordingError
from dechirp.core.optional_imports import import_from_extra
from dechirp.results.object_lists.list_columns import (
    COLUMNS,
    MEASURED,
    check_object_list,
    object_list_from_rows,
)

_SUFFIX = {"m": "_m", "m/s": "_m_per_s", "s": "_s", "1": ""}
_DETECTED = {column.name: column for column in TABLE if column.in_object_lists}
_NAMES = {
    name: _DETECTED[name].name_with_unit if name in _DETECTED else f"{name}{_SUFFIX[units]}"
    for name, units in COLUMNS.items()
}
"""Column of the table for each of the list."""

_WRITE_TYPES = {"frame": "BIGINT", "number": "BIGINT", "status": "VARCHAR"}
_READ_TYPES = {"status": "VARCHAR"}  # so that half a frame is not rounded to a whole one

SUFFIXES = (".csv", ".parquet")


def write_object_table(objects: xr.Dataset, path: str | Path) -> None:
    """Write an object list as `.csv` or `.parquet`, atomically.

    Raises
    ------
    InvalidSetting
        If it is not an object list, the path cannot be written, or the extra `parquet` is missing
        for a `.parquet` file.
    """
    path = check_file_suffix(path, SUFFIXES)
    objects = check_object_list(objects)
    shown_columns = {
        name: ("object", column.to_shown_unit(objects[name].values))
        for name, column in _DETECTED.items()
    }
    objects = objects.assign(shown_columns)
    rows = objects[list(COLUMNS)].to_dataframe()[list(COLUMNS)].rename(columns=_NAMES)
    if path.suffix.lower() == ".parquet":
        _write_parquet_rows(rows, path)
        return
    with atomic_output_file(path) as temporary:
        rows.to_csv(temporary, index=False, lineterminator="\n")


def read_object_table(path: str | Path) -> xr.Dataset:
    """Read an object list from `.csv` or `.parquet`, as `write_object_table` writes it.

    Raises
    ------
    RecordingError
        If it cannot be read, or has other columns.
    InvalidSetting
        If its values are not an object list, or the extra `parquet` is missing for a `.parquet`
        file.
    """
    path = check_file_suffix(path, SUFFIXES)
    is_parquet = path.suffix.lower() == ".parquet"
    if not path.is_file():
        raise _unreadable_table_error(path, "no file")
    rows = _read_parquet_rows(path) if is_parquet else _read_csv_rows(path)
    for name in ("frame", "time", "number", "status"):
        if np.ma.getmaskarray(rows[_NAMES[name]]).any():
            raise _unreadable_table_error(path, f"a row without {_NAMES[name]}")
    columns = {
        name: np.ma.filled(rows[_NAMES[name]], np.nan) if name in MEASURED else rows[_NAMES[name]]
        for name in COLUMNS
    }
    detected = {name: column.from_shown_unit(columns[name]) for name, column in _DETECTED.items()}
    return object_list_from_rows({**columns, **detected})


def _read_csv_rows(path: Path) -> dict[str, np.ndarray]:
    """Read the columns of a CSV file, masked where a cell is empty."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = csv.reader(file, strict=True)
            header = [name.lower() for name in next(lines, [])]
            _check_columns_present(path, header)
            cells = [line for line in lines if line]
    except (csv.Error, UnicodeError, OSError) as error:
        raise _unreadable_table_error(path, str(error)[:200]) from None
    for number, line in enumerate(cells, 1):
        if len(line) != len(header):
            value = f"row {number} with {len(line)} cells for {len(header)} columns"
            raise _unreadable_table_error(path, value)
    texts = np.array(cells, dtype=object).reshape(len(cells), len(header))
    rows: dict[str, np.ndarray] = {}
    for name in COLUMNS:
        column = texts[:, header.index(_NAMES[name])]
        is_empty = column == ""
        values: np.ndarray = column
        if name not in _READ_TYPES:
            try:
                values = np.where(is_empty, "nan", column).astype(float)
            except ValueError as error:
                raise _unreadable_table_error(path, f"{_NAMES[name]}: {error}"[:200]) from None
        rows[_NAMES[name]] = np.ma.array(values, mask=is_empty)
    return rows


def _write_parquet_rows(rows: Any, path: Path) -> None:
    duckdb = import_from_extra("parquet", "duckdb")
    with (
        atomic_output_file(path) as temporary,
        utf8_path_alias(temporary) as name,
        connect_duckdb_in_memory() as duck,
    ):
        # Not every DuckDB version supports the type that pandas has for texts.
        duck.register("rows", rows.astype({"status": object}))
        try:
            duck.execute(
                f"COPY (SELECT {_sql_select_columns(_WRITE_TYPES)} FROM rows)"
                f" TO {quote_sql_string(name)} (FORMAT parquet)"
            )
        except duckdb.IOException as error:
            raise OSError(None, _error_text_without_query(error)) from None


def _read_parquet_rows(path: Path) -> dict[str, np.ndarray]:
    """Read the columns of a Parquet file, masked where a value is null."""
    duckdb = import_from_extra("parquet", "duckdb")
    with utf8_path_alias(path) as name, connect_duckdb_in_memory() as duck:
        table = f"read_parquet({quote_sql_string(escape_glob_wildcards(name))})"
        try:
            description = duck.execute(f"DESCRIBE SELECT * FROM {table}").fetchall()
            # DuckDB compares names without case.
            _check_columns_present(path, [str(row[0]).lower() for row in description])
            rows: dict[str, np.ndarray] = duck.execute(
                f"SELECT {_sql_select_columns(_READ_TYPES)} FROM {table}"
            ).fetchnumpy()
        except duckdb.Error as error:
            raise _unreadable_table_error(path, _error_text_without_query(error)) from None
    return rows


def _check_columns_present(path: Path, present: Sequence[str]) -> None:
    if missing := [name for name in _NAMES.values() if name not in present]:
        raise _unreadable_table_error(path, f"without columns {', '.join(missing)}")


def _sql_select_columns(types: dict[str, str]) -> str:
    """Return the SQL columns of a table, cast to the given types, else to double."""
    return ", ".join(
        f"CAST({_NAMES[name]} AS {types.get(name, 'DOUBLE')}) AS {_NAMES[name]}" for name in COLUMNS
    )


def _error_text_without_query(error: Exception) -> str:
    text, _, _ = str(error).partition("\nLINE ")  # followed by the query
    return " ".join(text.split())[:200]


def _unreadable_table_error(path: Path, value: str) -> RecordingError:
    return RecordingError(
        path,
        value=value,
        expected="a table of objects from write_table",
        fix="write it again, or give a valid file",
    )
