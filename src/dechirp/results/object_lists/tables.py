"""Object lists as tables: CSV and Parquet, a row for each object, through DuckDB.

Columns carry their units (`x_m`), the ratio is in dB (`snr_db`), and unknown values are empty.
Frames without objects have no row.
"""

from pathlib import Path

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
_DUCKDB_FORMATS = {
    ".csv": ("FORMAT csv, HEADER", "read_csv({}, header=true, delim=',', all_varchar=true)"),
    ".parquet": ("FORMAT parquet", "read_parquet({})"),
}
"""Options of DuckDB to write and read each suffix."""

SUFFIXES = tuple(_DUCKDB_FORMATS)


def write_object_table(objects: xr.Dataset, path: str | Path) -> None:
    """Write an object list as `.csv` or `.parquet`, atomically.

    Raises
    ------
    InvalidSetting
        If it is not an object list, or the path cannot be written.
    """
    import duckdb

    path = check_file_suffix(path, SUFFIXES)
    objects = check_object_list(objects)
    options, _ = _DUCKDB_FORMATS[path.suffix.lower()]
    shown_columns = {
        name: ("object", column.to_shown_unit(objects[name].values))
        for name, column in _DETECTED.items()
    }
    objects = objects.assign(shown_columns)
    rows = objects[list(COLUMNS)].to_dataframe()[list(COLUMNS)].rename(columns=_NAMES)
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
                f" TO {quote_sql_string(name)} ({options})"
            )
        except duckdb.IOException as error:
            raise OSError(None, _error_text_without_query(error)) from None


def read_object_table(path: str | Path) -> xr.Dataset:
    """Read an object list from `.csv` or `.parquet`, as `write_object_table` writes it.

    Raises
    ------
    RecordingError
        If it cannot be read, or has other columns.
    InvalidSetting
        If its values are not an object list.
    """
    import duckdb

    path = check_file_suffix(path, SUFFIXES)
    _, reader = _DUCKDB_FORMATS[path.suffix.lower()]
    if not path.is_file():
        raise _unreadable_table_error(path, "no file")
    with utf8_path_alias(path) as name, connect_duckdb_in_memory() as duck:
        table = reader.format(quote_sql_string(escape_glob_wildcards(name)))
        try:
            description = duck.execute(f"DESCRIBE SELECT * FROM {table}").fetchall()
            present = {str(row[0]).lower() for row in description}  # as DuckDB compares names
            if missing := [name for name in _NAMES.values() if name not in present]:
                raise _unreadable_table_error(path, f"without columns {', '.join(missing)}")
            rows = duck.execute(
                f"SELECT {_sql_select_columns(_READ_TYPES)} FROM {table}"
            ).fetchnumpy()
        except duckdb.Error as error:
            raise _unreadable_table_error(path, _error_text_without_query(error)) from None
    for name in ("frame", "time", "number", "status"):
        if np.ma.getmaskarray(rows[_NAMES[name]]).any():
            raise _unreadable_table_error(path, f"a row without {_NAMES[name]}")
    columns = {
        name: np.ma.filled(rows[_NAMES[name]], np.nan) if name in MEASURED else rows[_NAMES[name]]
        for name in COLUMNS
    }
    detected = {name: column.from_shown_unit(columns[name]) for name, column in _DETECTED.items()}
    return object_list_from_rows({**columns, **detected})


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
