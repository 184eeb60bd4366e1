"""Description of a recording, checked to be representable as JSON."""

from collections.abc import Collection, Mapping

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, Mistake
from dechirp.recordings.description import Description, build_description_and_table_columns
from dechirp.recordings.recording import Recording

Columns = Mapping[str, Mapping[str, np.ndarray]]
"""Columns of each table, by name."""


def recording_description_and_columns(
    recording: Recording,
    scale: float | None,
    tables: Mapping[str, xr.Dataset] | None = None,
) -> tuple[Description, Columns]:
    """Return the description of a recording, which has a JSON form, and its table columns.

    `tables`, if given, replace those of the recording.

    Raises
    ------
    DechirpError
        If attributes of a table are not texts, numbers or lists of them, or names of columns or
        their objects are not texts.
    """
    tables = recording.tables if tables is None else tables
    for name, table in tables.items():
        _check_names_and_texts_valid(name, table)
    try:
        description_and_columns = build_description_and_table_columns(
            recording.radar, recording.contents, scale, tables
        )
        assert description_and_columns[0].json_text
    except DechirpError:
        raise
    except (TypeError, ValueError) as error:
        raise _unwritable_table_error(
            f"attributes or texts without a JSON form ({error})",
            "attributes that are texts, numbers or lists of them",
        ) from None
    return description_and_columns


def _check_names_and_texts_valid(name: str, table: xr.Dataset) -> None:
    """Raise `DechirpError` if a name or object value of a table is not a valid text."""
    names = [name, *table.variables, *table.dims]
    object_columns = [item for item in table.variables.values() if item.dtype.kind == "O"]
    values = [value for item in object_columns for value in item.values.reshape(-1)]
    for item in (*names, *values):
        if not isinstance(item, str):
            raise _unwritable_table_error(
                f"{item!r} in {name}, of type {type(item).__name__}",
                "names that are texts, and columns of texts, flags or numbers",
            )
    truncated = (
        *(item for item in names if "\0" in str(item)),
        *(item for item in values if item[-1:] == "\0"),
    )
    if truncated:
        raise _unwritable_table_error(
            f"the text {truncated[0]!r} in {name}",
            "texts that do not end in NUL, and names without it, since it terminates texts",
        )


def check_column_types(types: Collection[str], tables: Mapping[str, xr.Dataset]) -> None:
    """Raise `DechirpError` unless all columns of tables are texts or of one of these types."""
    for name, table in tables.items():
        for column, variable in table.variables.items():
            if variable.dtype.kind not in "UO" and variable.dtype.name not in types:
                raise _unwritable_table_error(
                    f"a column {column} of {variable.dtype} in {name}",
                    f"columns of texts, or of one of the types {', '.join(sorted(types))}",
                )


def _unwritable_table_error(value: str, expected: str) -> DechirpError:
    return DechirpError(Mistake(setting="tables", value=value, expected=expected, fix="convert it"))
