"""What detections and maps say of themselves as `array.dechirp`, once the package has made any."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from dechirp.core.columns import Cell, columns
from dechirp.core.displayed import Table, cut, html, several
from dechirp.core.errors import InvalidSetting
from dechirp.core.words import NONE, in_unit, number, power_db, power_unit

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]

# What rows are of, and what each of them has.
_KINDS = {"detection": "range", "cluster": "range", "track": "status", "target": "range"}
_KINDS |= {"frame": "vx"}  # the last: truth and tracks run over frames as well
# Units of the samples whose squares a map holds.
_ROOTS = {"W": "sqrt(W)", "full scale squared": "full scale"}
_SPANS = {"range": "m", "velocity": "m_per_s", "azimuth": "rad", "elevation": "rad", "snr": None}


@xr.register_dataset_accessor("dechirp")  # type: ignore[no-untyped-call]
class Found:
    """What was found, or truth, as people read it: metres, degrees and decibels."""

    def __init__(self, found: xr.Dataset) -> None:
        over = next((one for one in _KINDS if one in found.dims), None)
        if over is None or _KINDS[over] not in found:
            held = ", ".join(map(str, found.data_vars)) or "nothing"
            raise _not(
                f"a dataset of {held} over {', '.join(map(str, found.dims)) or 'no axis'}",
                "detections, clusters, tracks, own motion or truth",
                "Take what dc.detect and the like give; one of them as isel(detection=[0]).",
            )
        self._found, self._over = found, over

    def table(self) -> "pd.DataFrame":
        """A row for each, with the columns of the CSV file: `range_m`, `azimuth_deg`, `snr_db`."""
        import pandas as pd

        return pd.DataFrame(columns(self._found))

    def __repr__(self) -> str:
        return self._line()

    def _repr_html_(self) -> str:
        return html("", self._line(), [rows(self._found)])

    def _line(self) -> str:
        found = self._found
        parts = [several(found.sizes[self._over], self._over)]
        for name, unit in _SPANS.items():
            values = found[name].values if name in found else np.empty(0)
            known = values[np.isfinite(values)]
            if known.size:
                low, high = (in_unit(float(end), unit, 3) for end in (known.min(), known.max()))
                parts.append(f"{name} {low}" + (f" to {high}" if high != low else ""))
        return ", ".join(parts)


@xr.register_dataarray_accessor("dechirp")  # type: ignore[no-untyped-call]
class Power:
    """A map of powers as people read it."""

    def __init__(self, power: xr.DataArray) -> None:
        units = _ROOTS.get(str(power.attrs.get("units")))
        if units is None or power.dtype.kind not in "fiu":
            raise _not(
                f"an array of {power.dtype} in {power.attrs.get('units', 'no unit')}",
                "a map of powers, in W or full scale squared",
                "Take what dc.power_map and the like give.",
            )
        self._power, self._units = power, units

    def __repr__(self) -> str:
        level, unit = power_db(self._power.values, self._units), power_unit(self._units)
        cells = " x ".join(f"{size} {name}" for name, size in self._power.sizes.items())
        if not level.size:
            return f"no cells: {cells}"
        return f"{cells}, {number(level.min(), 3)} to {number(level.max(), 3)} {unit}"

    def db(self) -> xr.DataArray:
        """The map in dBm, or in dB over full scale; angles along its axes in degrees."""
        power = self._power
        level = power.copy(data=power_db(power.values, self._units))
        level = level.assign_attrs(units=power_unit(self._units), long_name="power")
        in_degrees = {
            name: axis.copy(data=np.degrees(axis.values)).assign_attrs(units="deg")
            for name, axis in level.coords.items()
            if axis.attrs.get("units") == "rad"
        }
        return level.assign_coords(in_degrees)


def rows(found: xr.Dataset, title: str = "") -> Table:
    """The first rows, without the columns in which nothing is told."""
    told = {
        name: cells
        for name, cells in columns(found).items()
        if any(cell is not None for cell in cells)
    }
    n_rows = len(next(iter(told.values()), ()))
    shown = ([_text(cell) for cell in row] for row in zip(*told.values(), strict=True))
    return cut(title, shown, n_rows, list(told))


def _text(cell: Cell) -> str:
    if isinstance(cell, float):
        return number(cell, 5)
    return NONE if cell is None else str(cell)


def _not(got: str, need: str, fix: str) -> InvalidSetting:
    return InvalidSetting("array.dechirp", got=got, need=need, fix=fix)
