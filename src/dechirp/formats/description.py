"""What our files say of their samples, as one JSON text: radar, units, scale, tables.

Whatever the container (HDF5, MATLAB, NumPy, SigMF), it holds this text, the samples (frame, chirp,
rx, sample) and the columns of the tables.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr

from dechirp.config import files
from dechirp.config.texts import as_text
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.core.plain import labelled, plain
from dechirp.core.values import value
from dechirp.formats.base import IQ_ORDERS, Contents, Units
from dechirp.formats.settings.base import Iq
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
    device: str | None = None
    """Kind of the chip that made the samples, where it is known."""
    iq: Iq | None = None
    """Which part of a complex sample came first where they were recorded, if that is known."""

    @property
    def text(self) -> str:
        """JSON, as `of_text` reads it."""
        said = {
            "dechirp_exchange": VERSION,
            "radar": as_text(self.radar, None),
            "units": self.units,
            "scale": self.scale,
            "device": self.device,
            "iq": self.iq,
            "tables": dict(self.tables),
        }
        return json.dumps(said, ensure_ascii=True)

    def dataset(self, name: str, arrays: Mapping[str, np.ndarray]) -> xr.Dataset:
        """A table of its columns; raises `KeyError`, `TypeError` or `ValueError` if damaged."""
        return labelled(arrays, self.tables[name])


def described(
    radar: Radar, held: Contents, scale: float | None, tables: Mapping[str, xr.Dataset]
) -> tuple[Description, dict[str, dict[str, np.ndarray]]]:
    """Description of what a recording holds, with these tables, and the columns of each.

    Columns are in the order of bytes of this machine, whatever that of the tables.
    """
    both = {name: plain(table) for name, table in tables.items()}
    said = {name: about for name, (_, about) in both.items()}
    made = Description(
        radar=radar,
        units=held.units,
        scale=scale,
        tables=said,
        device=held.device,
        iq=held.iq,
    )
    columns = {
        name: {column: _native(values) for column, values in held.items()}
        for name, (held, _) in both.items()
    }
    return made, columns


def _native(values: np.ndarray) -> np.ndarray:
    return values.astype(values.dtype.newbyteorder("="), copy=False)


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
    device, iq = said.get("device"), said.get("iq")
    is_whole = isinstance(tables, dict) and isinstance(device, str | None)
    is_whole &= iq in (None, *IQ_ORDERS) and isinstance(scale, int | float | None)
    if version != VERSION or units not in UNITS or not is_whole:
        raise RecordingError(
            path,
            got=f"described in version {version!r}, in units of {units!r}",
            need=f"described in version {VERSION}, in {' or '.join(UNITS)}, with its scale, tables"
            " and device",
            fix="Read it with the version of dechirp that wrote it.",
        )
    return Description(
        radar=radar or radar_of(path, said.get("radar")),
        units=cast(Units, units),
        scale=_number(scale),
        tables=tables,
        device=device,
        iq=iq,
    )


def _number(said: float | None) -> float | None:
    """A number as float64, infinite where it is a whole one beyond all of them."""
    try:
        return None if said is None else float(said)
    except OverflowError:
        return math.inf


def radar_of(path: Path, said: Any) -> Radar:
    """Radar that stands in a file of ours as in a settings file; `RecordingError` if damaged."""
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
