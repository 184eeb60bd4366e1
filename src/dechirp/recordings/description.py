"""JSON description of samples in native files: radar, units, scale, tables.

Every native container (HDF5, MATLAB, NumPy, SigMF) contains this text, the samples (frame, chirp,
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

from dechirp.config.dumping import to_yaml_data
from dechirp.core.dataset_arrays import dataset_from_arrays, dataset_to_arrays_and_description
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.core.units import SAMPLE_UNITS, current_units
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import IQ_ORDERS, Contents, Units
from dechirp.recordings.settings.base import Iq

VERSION = 1


@frozen_dataclass
class Description:
    """Description of the samples and tables in a native file."""

    radar: Radar
    units: Units
    scale: float | None = None
    """Step of the converter in these units, if samples are stored as its codes."""
    tables: Mapping[str, Any] = field(default_factory=dict)
    """Structure of each table, by name, from `core.dataset_arrays`."""
    device: str | None = None
    """Kind of the chip that recorded the samples, if known."""
    iq: Iq | None = None
    """Order of the I and Q parts in the original recording, if known."""

    @property
    def json_text(self) -> str:
        """JSON text, as `parse_description` reads it."""
        fields = {
            "dechirp_exchange": VERSION,
            "radar": to_yaml_data(self.radar, None),
            "units": self.units,
            "scale": self.scale,
            "device": self.device,
            "iq": self.iq,
            "tables": dict(self.tables),
        }
        return json.dumps(fields, ensure_ascii=True)

    def build_table(self, name: str, columns: Mapping[str, np.ndarray]) -> xr.Dataset:
        """Build a table from its columns.

        Raises `KeyError`, `TypeError` or `ValueError` if it is damaged.
        """
        return dataset_from_arrays(columns, self.tables[name])


def build_description_and_table_columns(
    radar: Radar, contents: Contents, scale: float | None, tables: Mapping[str, xr.Dataset]
) -> tuple[Description, dict[str, dict[str, np.ndarray]]]:
    """Return the description of a recording with these tables, and the columns of each table.

    Columns have the native byte order of this machine.
    """
    table_arrays = {
        name: dataset_to_arrays_and_description(table) for name, table in tables.items()
    }
    structures = {name: structure for name, (_, structure) in table_arrays.items()}
    description = Description(
        radar=radar,
        units=contents.units,
        scale=scale,
        tables=structures,
        device=contents.device,
        iq=contents.iq,
    )
    columns = {
        name: {column: _to_native_byte_order(values) for column, values in contents.items()}
        for name, (contents, _) in table_arrays.items()
    }
    return description, columns


def _to_native_byte_order(values: np.ndarray) -> np.ndarray:
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def is_native_description(text: str) -> bool:
    """Return True if a text is a native description, of any version."""
    try:
        parsed = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return isinstance(parsed, dict) and "dechirp_exchange" in parsed


def parse_description(path: Path, text: str, radar: Radar | None = None) -> Description:
    """Parse the description in a file; `radar`, if given, replaces its radar.

    Raises
    ------
    RecordingError
        If it is damaged, or of another version.
    """
    parsed = json.loads(text)
    version, units = parsed.get("dechirp_exchange"), current_units(parsed.get("units"))
    scale, tables = parsed.get("scale"), parsed.get("tables")
    device, iq = parsed.get("device"), parsed.get("iq")
    is_valid = isinstance(tables, dict) and isinstance(device, str | None)
    is_valid &= iq in (None, *IQ_ORDERS) and isinstance(scale, int | float | None)
    if version != VERSION or units not in SAMPLE_UNITS or not is_valid:
        raise RecordingError(
            path,
            value=f"description of version {version!r}, in units of {units!r}",
            expected=f"described in version {VERSION}, in {' or '.join(SAMPLE_UNITS)}, with its"
            " scale, tables and device",
            fix="read it with the version of dechirp that wrote it",
        )
    return Description(
        radar=radar or parse_radar(path, parsed.get("radar")),
        units=cast(Units, units),
        scale=_to_float_or_infinity(scale),
        tables=tables,
        device=device,
        iq=iq,
    )


def _to_float_or_infinity(number: float | None) -> float | None:
    """Convert a number to float64; an integer beyond its range becomes infinite."""
    try:
        return None if number is None else float(number)
    except OverflowError:
        return math.inf


def parse_radar(path: Path, radar_settings: Any) -> Radar:
    """Parse the radar of a native file; raise `RecordingError` if it is damaged.

    Parameters
    ----------
    path : path
        File that contains the radar, for messages.
    radar_settings : dict
        Settings of a radar as JSON has them.
    """
    from dechirp.config.loading import parse_settings  # takes 0.07 s

    try:
        text = json.dumps(radar_settings)
    except (TypeError, ValueError) as error:  # of Python code: files contain JSON
        raise InvalidSetting(
            "radar_settings",
            value=error,
            expected="settings of a radar as JSON has them: names, numbers, lists",
            fix="give a dictionary with the settings of a radar file",
        ) from None
    try:
        return parse_settings(text, Radar, file=f"{path}: radar")
    except DechirpError as error:
        raise RecordingError(
            path,
            value=f"a file with an unreadable radar ({error})",
            expected="the radar that recorded its samples",
            fix="give the radar: --radar FILE (radar=FILE in Python)",
        ) from None


def read_described_tables(
    path: Path, description: Description, read_column: Callable[[str, str], np.ndarray]
) -> dict[str, xr.Dataset]:
    """Read all tables; `read_column` returns the array of a table and a column.

    Raises
    ------
    RecordingError
        If one is missing or damaged.
    """
    tables = {}
    for name, structure in description.tables.items():
        try:
            arrays = {column: read_column(name, column) for column in structure["variables"]}
            tables[name] = description.build_table(name, arrays)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise RecordingError(
                path,
                value=f"a file with an unreadable table {name!r} ({error})",
                expected="all of its columns",
                fix="copy the file again from its source",
            ) from None
    return tables
