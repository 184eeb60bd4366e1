"""Large tables in Parquet files, through DuckDB: piece by piece, whole or not at all.

Parquet says in itself what each column is, and is read by pandas, polars, R, MATLAB, Spark and
DuckDB alike.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, count
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from dechirp.core.database import database, literal, quoted, utf8_name
from dechirp.core.errors import RecordingError
from dechirp.store.whole import whole_file

Type = Literal["BIGINT", "DOUBLE", "BOOLEAN", "VARCHAR"]
"""Of a column, as SQL calls it."""


def write_parquet(
    path: Path,
    columns: Mapping[str, Type],
    pieces: Iterable[Mapping[str, np.ndarray]],
    *,
    about: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write a table, in place of what was there.

    Parameters
    ----------
    path : Path
        The file. It takes its name when all of it is written.
    columns : mapping
        Type of each column by its name, in order. DuckDB takes `Car` and `car` for the same
        name; the second of such is called `car_2`.
    pieces : iterable of mapping
        Rows, some at a time: for each column an array (n_rows,). NaN stays NaN; None in a
        column of texts is null.
    about : mapping
        Words that are kept in the file beside the table, by name.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    import duckdb

    words = ", ".join(f"{_name(name)}: {quoted(word)}" for name, word in about.items())
    more = f", KV_METADATA {{{words}}}" if words else ""
    with whole_file(path) as made, utf8_name(made) as name, database() as duck:
        both = zip(_distinct(columns), columns.values(), strict=True)
        typed = ", ".join(f"{_name(name)} {kind}" for name, kind in both)
        try:
            duck.execute(f"CREATE TABLE kept ({typed})")
            for piece in pieces:
                _append(duck, columns, piece)
            duck.execute(f"COPY kept TO {quoted(name)} (FORMAT parquet, COMPRESSION zstd{more})")
        except duckdb.IOException as error:
            raise OSError(None, " ".join(str(error).split())[:200]) from None


def read_parquet(path: Path) -> dict[str, np.ndarray]:
    """Columns of a table, each (n_rows,); texts are objects.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no Parquet.
    """
    import duckdb

    with utf8_name(path) as name, database() as duck:
        try:
            found = duck.execute(
                f"SELECT * FROM read_parquet({quoted(literal(name))})"
            ).fetchnumpy()
        except duckdb.Error as error:
            raise RecordingError(
                path,
                got=" ".join(str(error).split())[:200],
                need="a Parquet file",
                fix="Write it again, or give the file that is one.",
            ) from None
    return {name: _plain(values) for name, values in found.items()}


def _append(duck: Any, columns: Mapping[str, Type], piece: Mapping[str, np.ndarray]) -> None:
    # Names of its own: what DuckDB calls a column is not always what we do.
    duck.register("piece", {f"c{at}": piece[name] for at, name in enumerate(columns)})
    try:
        kinds = (
            # DuckDB takes NaN of NumPy for null; it is a number that there is not.
            f"coalesce(c{at}, 'NaN'::DOUBLE)" if kind == "DOUBLE" else f"c{at}::{kind}"
            for at, kind in enumerate(columns.values())
        )
        duck.execute(f"INSERT INTO kept SELECT {', '.join(kinds)} FROM piece")
    finally:
        duck.unregister("piece")


def _distinct(names: Iterable[str]) -> Iterator[str]:
    """Names that differ in more than case."""
    taken: set[str] = set()
    for name in names:
        tried = chain([name], (f"{name}_{number}" for number in count(2)))
        free = next(one for one in tried if one.lower() not in taken)
        taken.add(free.lower())
        yield free


def _plain(values: np.ndarray) -> np.ndarray:
    """Arrays without a mask; None where a text is null."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    plain = values.data.copy()
    if plain.dtype == object:
        plain[np.ma.getmaskarray(values)] = None
    return plain


def _name(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
