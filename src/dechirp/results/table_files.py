"""Large tables as Parquet files, or as CSV files without the extra `parquet`."""

import csv
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

import numpy as np

from dechirp.core.atomic_files import atomic_file
from dechirp.results.parquet import ColumnType, distinct_column_names, write_parquet

TABLE_SUFFIXES = (".parquet", ".csv")

_CSV_DTYPES: Mapping[ColumnType, type] = {
    "BIGINT": int,
    "DOUBLE": float,
    "BOOLEAN": bool,
    "VARCHAR": object,
}


def available_table_suffix() -> str:
    """Return `.parquet`, or `.csv` where the extra `parquet` is not installed."""
    return ".parquet" if find_spec("duckdb") else ".csv"


def write_table(
    path: Path,
    columns: Mapping[str, ColumnType],
    pieces: Iterable[Mapping[str, np.ndarray]],
    *,
    metadata: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write a table as its suffix says, with the arguments of `write_parquet`.

    A CSV file has the same header and rows, shortest decimal numbers that read back equal, empty
    cells for NaN and null, and no metadata.

    Raises
    ------
    DechirpError
        If it cannot be written, or the disk is full.
    """
    if path.suffix == ".parquet":
        write_parquet(path, columns, pieces, metadata=metadata)
        return
    import pandas as pd  # type: ignore[import-untyped]

    with atomic_file(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerow(distinct_column_names(columns))
        for piece in pieces:
            rows = pd.DataFrame(
                {name: piece[name].astype(_CSV_DTYPES[kind]) for name, kind in columns.items()}
            )
            rows.to_csv(file, index=False, header=False, lineterminator="\n")
