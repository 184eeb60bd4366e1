"""The description of a recording, where it can be put into words."""

from collections.abc import Collection, Mapping

import numpy as np
import xarray as xr

from dechirp.core.errors import DechirpError, Mistake
from dechirp.formats.description import Description, described
from dechirp.formats.recording import Recording

Columns = Mapping[str, Mapping[str, np.ndarray]]
"""Of each table, its columns by name."""


def said_of(
    recording: Recording,
    scale: float | None,
    tables: Mapping[str, xr.Dataset] | None = None,
) -> tuple[Description, Columns]:
    """Description of a recording, whose text can be made, and the columns of its tables.

    `tables`, where given, are described in place of its own.

    Raises
    ------
    DechirpError
        If attributes of a table are neither texts nor numbers nor lists of them, or names of
        columns or objects in them are no texts.
    """
    tables = recording.tables if tables is None else tables
    for name, table in tables.items():
        _must_be_of_texts(name, table)
    try:
        made = described(recording.radar, recording.contents, scale, tables)
        assert made[0].text
    except DechirpError:
        raise
    except (TypeError, ValueError) as error:
        raise _refused(
            f"with attributes or texts that JSON does not take ({error})",
            "with attributes that are texts, numbers or lists of them",
        ) from None
    return made


def _must_be_of_texts(name: str, table: xr.Dataset) -> None:
    """Raise `DechirpError` where something that has to be a text is none."""
    names = [name, *table.variables, *table.dims]
    objects = [one for one in table.variables.values() if one.dtype.kind == "O"]
    values = [value for one in objects for value in one.values.reshape(-1)]
    for one in (*names, *values):
        if not isinstance(one, str):
            raise _refused(
                f"with {one!r} in {name}, of type {type(one).__name__}",
                "with names that are texts, of columns of texts, flags or numbers",
            )
    cut = (
        *(one for one in names if "\0" in str(one)),
        *(one for one in values if one[-1:] == "\0"),
    )
    if cut:
        raise _refused(
            f"with the text {cut[0]!r} in {name}",
            "of texts that do not end in NUL, and names without one: files end or fill texts with"
            " it",
        )


def must_be_of(types: Collection[str], tables: Mapping[str, xr.Dataset]) -> None:
    """Raise `DechirpError` unless all columns of tables are texts, or of one of these types."""
    for name, table in tables.items():
        for column, variable in table.variables.items():
            if variable.dtype.kind not in "UO" and variable.dtype.name not in types:
                raise _refused(
                    f"with a column {column} of {variable.dtype} in {name}",
                    f"of texts, or of one of the types {', '.join(sorted(types))}",
                )


def _refused(got: str, need: str) -> DechirpError:
    return DechirpError(Mistake(setting="tables", got=got, need=need, fix="Convert it."))
