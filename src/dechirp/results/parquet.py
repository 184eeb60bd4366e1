"""Large tables in Parquet files, written atomically and in pieces through DuckDB.

Parquet files contain their column types; pandas, polars, R, MATLAB, Spark and DuckDB read them.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, count
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from dechirp.core.atomic_files import atomic_file
from dechirp.core.duckdb_memory import (
    connect_duckdb_in_memory,
    escape_glob_wildcards,
    quote_sql_string,
    utf8_path_alias,
)
from dechirp.core.errors import RecordingError
from dechirp.core.optional_imports import import_from_extra

ColumnType = Literal["BIGINT", "DOUBLE", "BOOLEAN", "VARCHAR"]
"""SQL type of a column."""


def write_parquet(
    path: Path,
    columns: Mapping[str, ColumnType],
    pieces: Iterable[Mapping[str, np.ndarray]],
    *,
    metadata: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write a table atomically and replace an existing file.

    Parameters
    ----------
    path : Path
        The file. It gets its name when it is complete.
    columns : mapping
        Type of each column by its name, in order. DuckDB treats `Car` and `car` as the same
        name; the second becomes `car_2`.
    pieces : iterable of mapping
        Pieces of rows: for each column an array (n_rows,). NaN stays NaN; None in a text column
        becomes null.
    metadata : mapping
        Texts to store in the file next to the table, by name.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    duckdb = import_from_extra("parquet", "duckdb", setting="table")
    metadata_sql = ", ".join(
        f"{_quote_sql_identifier(name)}: {quote_sql_string(text)}"
        for name, text in metadata.items()
    )
    options = f", KV_METADATA {{{metadata_sql}}}" if metadata_sql else ""
    with (
        atomic_file(path) as temporary,
        utf8_path_alias(temporary) as name,
        connect_duckdb_in_memory() as duck,
    ):
        named_types = zip(distinct_column_names(columns), columns.values(), strict=True)
        typed = ", ".join(f"{_quote_sql_identifier(name)} {kind}" for name, kind in named_types)
        try:
            duck.execute(f"CREATE TABLE rows ({typed})")
            for piece in pieces:
                _insert_rows_with_duckdb(duck, columns, piece)
            duck.execute(
                f"COPY rows TO {quote_sql_string(name)} (FORMAT parquet, COMPRESSION zstd{options})"
            )
        except duckdb.IOException as error:
            raise OSError(None, " ".join(str(error).split())[:200]) from None


def read_parquet(path: Path) -> dict[str, np.ndarray]:
    """Read the columns of a table, each (n_rows,); texts are objects.

    Raises
    ------
    RecordingError
        If the file does not exist or is not Parquet.
    """
    duckdb = import_from_extra("parquet", "duckdb", setting="table")
    with utf8_path_alias(path) as name, connect_duckdb_in_memory() as duck:
        try:
            columns = duck.execute(
                f"SELECT * FROM read_parquet({quote_sql_string(escape_glob_wildcards(name))})"
            ).fetchnumpy()
        except duckdb.Error as error:
            raise RecordingError(
                path,
                value=" ".join(str(error).split())[:200],
                expected="a Parquet file",
                fix="write it again, or give the file that is one",
            ) from None
    return {name: _remove_mask(values) for name, values in columns.items()}


def _insert_rows_with_duckdb(
    duck: Any, columns: Mapping[str, ColumnType], piece: Mapping[str, np.ndarray]
) -> None:
    # Neutral names, since DuckDB may have renamed columns that differ only in case.
    duck.register("piece", {f"c{index}": piece[name] for index, name in enumerate(columns)})
    try:
        kinds = (
            # DuckDB reads a NumPy NaN as null.
            f"coalesce(c{index}, 'NaN'::DOUBLE)" if kind == "DOUBLE" else f"c{index}::{kind}"
            for index, kind in enumerate(columns.values())
        )
        duck.execute(f"INSERT INTO rows SELECT {', '.join(kinds)} FROM piece")
    finally:
        duck.unregister("piece")


def distinct_column_names(names: Iterable[str]) -> Iterator[str]:
    """Yield names that differ in more than case, with a number appended to repeated ones."""
    taken: set[str] = set()
    for name in names:
        candidates = chain([name], (f"{name}_{number}" for number in count(2)))
        distinct = next(candidate for candidate in candidates if candidate.lower() not in taken)
        taken.add(distinct.lower())
        yield distinct


def _remove_mask(values: np.ndarray) -> np.ndarray:
    """Return an array without its mask; null texts become None."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    plain = values.data.copy()
    if plain.dtype == object:
        plain[np.ma.getmaskarray(values)] = None
    return plain


def _quote_sql_identifier(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
