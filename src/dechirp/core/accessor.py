"""Accessors `array.dechirp` of xarray: tables, plots, and maps in the units that people read."""

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.arrow_stream import export_arrow_stream
from dechirp.core.detection_columns import SHOWN_COLUMNS
from dechirp.core.display import (
    Table,
    format_count_with_noun,
    render_display_html,
    truncated_display_table,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.table_columns import (
    Cell,
    TableColumn,
    dataset_to_columns,
    dataset_to_typed_columns,
)
from dechirp.core.text import (
    EN_DASH,
    format_number,
    format_quantity,
    power_level_unit,
    power_to_dbm_or_dbfs,
)
from dechirp.core.units import current_units, is_absolute

if TYPE_CHECKING:
    import pandas as pd  # type: ignore[import-untyped]

# A variable that marks the dataset, by the dimension that its rows run along.
_REQUIRED_VARIABLES = {
    "detection": "range",
    "cluster": "range",
    "track": "status",
    "target": "range",
}
_REQUIRED_VARIABLES |= {"frame": "vx"}  # last, since truth and tracks have frames as well
# Units of the samples by the units of the map, which holds their squares.
_SAMPLE_UNITS = {"W": "W**0.5", "1": "1"}
_SUMMARY_UNITS = {
    column.name: None if column.unit == "1" else column.unit.replace("/", "_per_")
    for column in SHOWN_COLUMNS
}


@xr.register_dataset_accessor("dechirp")  # type: ignore[no-untyped-call]
class TableAccessor:
    """Accessor of detections, clusters, tracks, ego motion and truth: metres, degrees, decibels."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def table(self) -> "pd.DataFrame":
        """Return a row each, with the columns of the CSV file: `range_m`, `azimuth_deg`, ...

        A DataFrame of pandas, whose types do not depend on the rows: texts, floats and integers,
        which are of the nullable type `Int64` where values are missing. Polars and DuckDB take
        the accessor itself, as an Arrow stream: `polars.DataFrame(detections.dechirp)`;
        `rows = detections.dechirp`, then `duckdb.sql("FROM rows")`.
        """
        import pandas as pd

        self._row_dimension()
        return pd.DataFrame(
            {
                name: pd.Series(column.cells, dtype=_pandas_type(column))
                for name, column in dataset_to_typed_columns(self._dataset).items()
            }
        )

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        """Return the table as an Arrow stream: `polars.DataFrame(detections.dechirp)`."""
        self._row_dimension()
        return export_arrow_stream(dataset_to_typed_columns(self._dataset))

    @check_argument_types
    def plot(self, ax: Any = None) -> Any:
        """Draw the rows from above, as the report does, and return the axes.

        Detections without an azimuth are drawn as ranges over time. Without `ax`, an `Axes` of
        matplotlib, the current ones of pyplot are used.
        """
        return load_plots().plot_table(self._dataset, ax, dim=self._row_dimension())

    def __repr__(self) -> str:
        try:
            return self._describe_row_count_and_ranges(self._row_dimension())
        except InvalidSetting as error:
            return str(error)

    def _repr_html_(self) -> str | None:
        try:
            text = self._describe_row_count_and_ranges(self._row_dimension())
        except InvalidSetting:
            return None
        return render_display_html("", text, [first_rows_display_table(self._dataset)])

    def _row_dimension(self) -> str:
        """Return the dimension of the rows, or raise `InvalidSetting` for any other dataset.

        It is no check of the constructor: `hasattr(dataset, "dechirp")` has an answer.
        """
        dataset = self._dataset
        dim = next((name for name in _REQUIRED_VARIABLES if name in dataset.dims), None)
        if dim is None or _REQUIRED_VARIABLES[dim] not in dataset:
            variables = ", ".join(map(str, dataset.data_vars)) or "nothing"
            dims = ", ".join(map(str, dataset.dims)) or "no axis"
            raise _invalid_array_error(
                f"a dataset of {variables} over {dims}",
                "detections, clusters, tracks, ego motion or truth",
                "pass a result of dc.detect or a similar function; select one row with "
                "isel(detection=[0])",
            )
        return dim

    def _describe_row_count_and_ranges(self, dim: str) -> str:
        dataset = self._dataset
        parts = [format_count_with_noun(dataset.sizes[dim], dim)]
        for name, unit in _SUMMARY_UNITS.items():
            values = dataset[name].values if name in dataset else np.empty(0)
            finite = values[np.isfinite(values)]
            if finite.size:
                low, high = (
                    format_quantity(float(end), unit, 3) for end in (finite.min(), finite.max())
                )
                parts.append(f"{name} {low}" + (f" to {high}" if high != low else ""))
        return ", ".join(parts)


@xr.register_dataarray_accessor("dechirp")  # type: ignore[no-untyped-call]
class PowerMapAccessor:
    """Accessor of power maps: decibels and degrees; of samples: a plot."""

    def __init__(self, power: xr.DataArray) -> None:
        self._power = power

    def __repr__(self) -> str:
        try:
            units = self._sample_units()
        except InvalidSetting as error:
            return str(error)
        level, unit = power_to_dbm_or_dbfs(self._power.values, units), power_level_unit(units)
        cells = " x ".join(f"{size} {name}" for name, size in self._power.sizes.items())
        if not level.size:
            return f"no cells: {cells}"
        return f"{cells}, {format_number(level.min(), 3)} to {format_number(level.max(), 3)} {unit}"

    @check_argument_types
    def plot(self, ax: Any = None, *, detections: xr.Dataset | None = None) -> Any:
        """Draw the map, spectrogram, spectrum or samples as the report does, and return the axes.

        Samples are drawn over the time of one chirp, the real part of complex ones: the first
        chirp of the first frame at the first receiver, unless others were selected with `isel`.

        Parameters
        ----------
        ax : Axes, optional
            Axes of matplotlib, whose space the colour bar shares; by default the current ones of
            pyplot.
        detections : Dataset over `detection`, optional
            Detections to mark.
        """
        if "sample" in self._power.dims:
            return load_plots().plot_samples(self._power, ax, detections=detections)
        units = self._sample_units()
        return load_plots().plot_power(self._power, ax, units=units, detections=detections)

    def db(self) -> xr.DataArray:
        """Return the map in dBm or dBFS, with the angles along its axes in degrees."""
        power, units = self._power, self._sample_units()
        level = power.copy(data=power_to_dbm_or_dbfs(power.values, units))
        # Libraries for units know dB, and no dBFS.
        level_units, name = (
            ("dBm", "power") if is_absolute(units) else ("dB", "power over full scale")
        )
        level = level.assign_attrs(units=level_units, long_name=name)
        in_degrees = {
            name: axis.copy(data=np.degrees(axis.values)).assign_attrs(units="deg")
            for name, axis in level.coords.items()
            if axis.attrs.get("units") == "rad"
        }
        return level.assign_coords(in_degrees)

    def _sample_units(self) -> str:
        """Return the units of the samples, or raise `InvalidSetting` if the array is no map.

        It is no check of the constructor: `hasattr(cube, "dechirp")` has an answer.
        """
        power = self._power
        units = _SAMPLE_UNITS.get(current_units(power.attrs.get("units")))
        if units is None or power.dtype.kind not in "fiu":
            raise _invalid_array_error(
                f"an array of {power.dtype} in {power.attrs.get('units', 'no unit')}",
                "a power map in W or full scale squared",
                "pass a result of dc.power_map or a similar function",
            )
        return units


def _pandas_type(column: TableColumn) -> str:
    if column.cell_type is int:
        return "Int64" if None in column.cells else "int64"
    return "str" if column.cell_type is str else "float64"


def load_plots() -> Any:
    """Load the drawing functions: found by name, because the layers of this module draw nothing."""
    return importlib.import_module("dechirp.report.plots")


def first_rows_display_table(dataset: xr.Dataset, title: str = "") -> Table:
    """Return the first rows, without empty columns."""
    columns = {
        name: cells
        for name, cells in dataset_to_columns(dataset).items()
        if any(cell is not None for cell in cells)
    }
    n_rows = len(next(iter(columns.values()), ()))
    rows = (
        [_format_cell_or_dash(cell) for cell in row] for row in zip(*columns.values(), strict=True)
    )
    return truncated_display_table(title, rows, n_rows, list(columns))


def _format_cell_or_dash(cell: Cell) -> str:
    if isinstance(cell, float):
        return format_number(cell, 5)
    return EN_DASH if cell is None else str(cell)


def _invalid_array_error(value: str, expected: str, fix: str) -> InvalidSetting:
    return InvalidSetting("array.dechirp", value=value, expected=expected, fix=fix)
