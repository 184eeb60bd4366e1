"""What our files say of their samples, as one JSON text: radar, units, scale, tables.

Whatever the container (HDF5, MATLAB, NumPy, SigMF), it holds this text, the samples (frame, chirp,
rx, sample) and the columns of the tables.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr

from dechirp.config import files
from dechirp.config.texts import dump
from dechirp.config.tree import read_tree
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.plain import labelled, plain
from dechirp.core.values import value
from dechirp.formats.base import Units
from dechirp.radar.radar import Radar

VERSION = 1
UNITS = ("sqrt(W)", "full scale")


@value
class Description:
    """Of the samples in a file of ours, and of the tables that travel with them."""

    radar: Radar
    units: Units
    scale: float | None = None
    """Size of one step of the converter in these units, where samples are kept as its codes."""
    tables: Mapping[str, Any] = field(default_factory=dict)
    """Of each table, by name, what `core.plain` says of it."""

    @property
    def text(self) -> str:
        """JSON, as `of_text` reads it."""
        said = {
            "dechirp_exchange": VERSION,
            "radar": read_tree(dump(self.radar), "").plain,
            "units": self.units,
            "scale": self.scale,
            "tables": dict(self.tables),
        }
        return json.dumps(said, ensure_ascii=True)

    def dataset(self, name: str, arrays: Mapping[str, np.ndarray]) -> xr.Dataset:
        """A table of its columns; raises `KeyError`, `TypeError` or `ValueError` if damaged."""
        return labelled(arrays, self.tables[name])


def described(
    radar: Radar, units: Units, scale: float | None, tables: Mapping[str, xr.Dataset]
) -> tuple[Description, dict[str, dict[str, np.ndarray]]]:
    """Description of samples with tables, and the columns of each table."""
    both = {name: plain(table) for name, table in tables.items()}
    said = {name: about for name, (_, about) in both.items()}
    made = Description(radar=radar, units=units, scale=scale, tables=said)
    return made, {name: columns for name, (columns, _) in both.items()}


def is_ours(text: str) -> bool:
    """Whether a text is such a description, of whatever version."""
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(said, dict) and "dechirp_exchange" in said


def of_text(path: Path, text: str, radar: Radar | None = None) -> Description:
    """Description in a file; `radar`: one that the user gave instead.

    Raises
    ------
    RecordingError
        If it is damaged, or of another version.
    """
    said = json.loads(text)
    version, units = said.get("dechirp_exchange"), said.get("units")
    scale, tables = said.get("scale"), said.get("tables")
    is_whole = isinstance(tables, dict) and (scale is None or isinstance(scale, int | float))
    if version != VERSION or units not in UNITS or not is_whole:
        raise RecordingError(
            path,
            got=f"described in version {version!r}, in units of {units!r}",
            need=f"described in version {VERSION}, in {' or '.join(UNITS)}, with its tables",
            fix="Read it with the version of dechirp that wrote it.",
        )
    return Description(
        radar=radar or _radar(path, said.get("radar")),
        units=cast(Units, units),
        scale=None if scale is None else float(scale),
        tables=tables,
    )


def _radar(path: Path, said: Any) -> Radar:
    try:
        return files.parse(json.dumps(said), Radar, file=f"{path}: radar")
    except DechirpError as error:
        raise RecordingError(
            path,
            got=f"a file whose radar cannot be read ({error})",
            need="the radar that made its samples",
            fix="Give the radar: --radar FILE (radar=FILE in Python).",
        ) from None


def tables_of(
    path: Path, description: Description, columns: Callable[[str, str], np.ndarray]
) -> dict[str, xr.Dataset]:
    """All tables; `columns` gives the array of a table and a column.

    Raises
    ------
    RecordingError
        If one is not there, or damaged.
    """
    made = {}
    for name, about in description.tables.items():
        try:
            arrays = {column: columns(name, column) for column in about["variables"]}
            made[name] = description.dataset(name, arrays)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise RecordingError(
                path,
                got=f"with a table {name!r} that cannot be read ({error})",
                need="all of its columns, as they were written",
                fix="Copy the file again from its source.",
            ) from None
    return made
