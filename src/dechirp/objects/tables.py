"""Object lists as tables: CSV and Parquet, a row for each object, through DuckDB.

Columns carry their units (`x_m`), the ratio is in dB (`snr_db`), and what is not told is empty.
Frames without objects have no row.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.database import database, literal, quoted, utf8_name
from dechirp.core.errors import RecordingError
from dechirp.core.units import decibels, from_decibels
from dechirp.objects.rows import COLUMNS, MEASURED, must_be_objects, of_rows
from dechirp.objects.whole import named, whole_file

_SUFFIX = {"m": "_m", "m/s": "_m_per_s", "s": "_s", "1": ""}
_NAMES = {
    name: "snr_db" if name == "snr" else f"{name}{_SUFFIX[units]}"
    for name, units in COLUMNS.items()
}
"""Column of the table for each of the list."""

_WRITTEN = {"frame": "BIGINT", "number": "BIGINT", "status": "VARCHAR"}
_READ = {"status": "VARCHAR"}  # so that half a frame is not rounded to a whole one
_WAYS = {
    ".csv": ("FORMAT csv, HEADER", "read_csv({}, header=true, delim=',', all_varchar=true)"),
    ".parquet": ("FORMAT parquet", "read_parquet({})"),
}
"""How DuckDB writes and reads each suffix."""

SUFFIXES = tuple(_WAYS)


def write_table(objects: xr.Dataset, path: str | Path) -> None:
    """Write an object list as `.csv` or `.parquet`, whole or not at all.

    Raises
    ------
    InvalidSetting
        If it is no object list, or the path cannot be written.
    """
    import duckdb

    path = named(path, SUFFIXES)
    objects = must_be_objects(objects)
    how, _ = _WAYS[path.suffix.lower()]
    with np.errstate(divide="ignore"):  # no signal at all is minus infinity
        objects = objects.assign(snr=decibels(objects["snr"]))
    rows = objects[list(COLUMNS)].to_dataframe()[list(COLUMNS)].rename(columns=_NAMES)
    with whole_file(path) as made, utf8_name(made) as name, database() as duck:
        # Not every DuckDB knows the type that pandas has for texts.
        duck.register("rows", rows.astype({"status": object}))
        try:
            duck.execute(f"COPY (SELECT {_columns(_WRITTEN)} FROM rows) TO {quoted(name)} ({how})")
        except duckdb.IOException as error:
            raise OSError(None, _line(error)) from None


def read_table(path: str | Path) -> xr.Dataset:
    """Read an object list from `.csv` or `.parquet`, as `write_table` writes it.

    Raises
    ------
    RecordingError
        If it cannot be read, or has other columns.
    InvalidSetting
        If the values in it are no object list.
    """
    import duckdb

    path = named(path, SUFFIXES)
    _, reader = _WAYS[path.suffix.lower()]
    if not path.is_file():
        raise _unreadable(path, "no file")
    with utf8_name(path) as name, database() as duck:
        table = reader.format(quoted(literal(name)))
        try:
            described = duck.execute(f"DESCRIBE SELECT * FROM {table}").fetchall()
            given = {str(row[0]).lower() for row in described}  # as DuckDB compares names
            if lacks := [name for name in _NAMES.values() if name not in given]:
                raise _unreadable(path, f"without columns {', '.join(lacks)}")
            rows = duck.execute(f"SELECT {_columns(_READ)} FROM {table}").fetchnumpy()
        except duckdb.Error as error:
            raise _unreadable(path, _line(error)) from None
    for name in ("frame", "time", "number", "status"):
        if np.ma.getmaskarray(rows[_NAMES[name]]).any():
            raise _unreadable(path, f"a row without {_NAMES[name]}")
    columns = {
        name: np.ma.filled(rows[_NAMES[name]], np.nan) if name in MEASURED else rows[_NAMES[name]]
        for name in COLUMNS
    }
    return of_rows({**columns, "snr": from_decibels(columns["snr"])})


def _columns(types: dict[str, str]) -> str:
    """Columns as a table has them, of given types, else double."""
    return ", ".join(
        f"CAST({_NAMES[name]} AS {types.get(name, 'DOUBLE')}) AS {_NAMES[name]}" for name in COLUMNS
    )


def _line(error: Exception) -> str:
    text, _, _ = str(error).partition("\nLINE ")  # after which it tells our query
    return " ".join(text.split())[:200]


def _unreadable(path: Path, got: str) -> RecordingError:
    return RecordingError(
        path,
        got=got,
        need="a table of objects as write_table writes it",
        fix="Write it again, or give the file that is one.",
    )
