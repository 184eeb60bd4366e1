"""The description of a recording, where it can be put into words."""

from collections.abc import Mapping

import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.formats.arrays.json_columns import TYPES
from dechirp.formats.description import Description, described
from dechirp.formats.recording import Recording

Columns = Mapping[str, Mapping[str, np.ndarray]]
"""Of each table, its columns by name."""


def said_of(recording: Recording, scale: float | None) -> tuple[Description, Columns]:
    """Description of a recording, whose text can be made, and the columns of its tables.

    Raises
    ------
    DechirpError
        If attributes of a table are neither texts nor numbers nor lists of them.
    """
    try:
        made = described(recording.radar, recording.contents, scale, recording.tables)
        assert made[0].text
    except DechirpError:
        raise
    except (TypeError, ValueError) as error:
        raise DechirpError(
            Mistake(
                setting="tables",
                got=f"with attributes or texts that JSON does not take ({error})",
                need="with attributes that are texts, numbers or lists of them",
                fix="Convert them.",
            )
        ) from None
    return made


def must_be_listed(recording: Recording) -> None:
    """Raise `DechirpError` unless the columns of all tables are of types that JSON can list."""
    for name, table in recording.tables.items():
        for column, variable in table.variables.items():
            if variable.dtype.kind not in "UO" and variable.dtype.name not in TYPES:
                raise DechirpError(
                    Mistake(
                        setting="tables",
                        got=f"with a column {column} of {variable.dtype} in {name}",
                        need="of texts, flags, or numbers whose parts have 64 bits at most",
                        fix="Convert it.",
                    )
                )
