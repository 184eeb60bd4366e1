"""Tables of range-Doppler maps, for a spreadsheet."""

import csv
import io
from typing import ClassVar

import numpy as np
import xarray as xr

from dechirp.core.values import value
from dechirp.core.words import power_db, power_unit
from dechirp.exchange.writers.of_maps import OfMaps
from dechirp.formats.base import Units


@value
class Csv(OfMaps):
    """Tables of the range-Doppler map in decibels, one for each frame."""

    endings: ClassVar[tuple[str, ...]] = (".csv",)
    keeps: ClassVar[str] = "a table of the map of each frame, in dB; not read back"

    def content(self, power: xr.DataArray, units: Units, _title: str) -> bytes:
        """See `table_of`."""
        return table_of(power, units).encode()


def table_of(power: xr.DataArray, units: str) -> str:
    """Rows of velocities, columns of ranges; the first cell says so, and in what the cells are.

    Levels have 0.01 dB, ranges and velocities six digits.
    """
    named = power.transpose("velocity", "range")
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    corner = f"power in {power_unit(units)}: velocity_m_per_s down and range_m across"
    writer.writerow([corner, *_texts(named.range.values)])
    levels = np.char.mod("%.2f", power_db(named.values, units))
    for velocity, row in zip(_texts(named.velocity.values), levels, strict=True):
        writer.writerow([velocity, *row])
    return stream.getvalue()


def _texts(numbers: np.ndarray) -> list[str]:
    return [f"{number:.6g}" for number in numbers]
