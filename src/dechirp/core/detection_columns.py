"""Columns of detections: the one table that every reader and writer of detections uses.

A new column takes one row in `TABLE` and the line of `processing.frame.build_detection_columns`
that computes it: files, tables, reports, the studio, data sets and object lists follow the table.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.display import describe_class
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import EN_DASH, decimals_for_column, format_fixed
from dechirp.core.units import from_decibels, to_decibels

_SUFFIXES = {"m": "_m", "m/s": "_m_per_s", "s": "_s", "rad": "_rad", "deg": "_deg", "dB": "_db"}
_SYMBOLS = {"deg": "°"}


class DetectionColumn(NamedTuple):
    """Column of a table of detections. Datasets hold SI units, radians and power ratios."""

    name: str
    unit: str
    """SI unit; 1 for ratios, counts and probabilities."""
    long_name: str
    shown_unit: str = ""
    """Unit in files and tables where it differs: deg for rad, dB for power ratios."""
    heading: str = ""
    """Heading in tables for people, without the unit; the column is left out where empty."""
    decimals: int = 3
    """Decimals in tables for people, at most."""
    cluster: Literal["first", "mean", "sum", "strongest"] | None = None
    """Value of a cluster: of its first detection, the mean weighted by SNR, the sum, or of the
    strongest detection with a known value. None leaves the column out."""
    has_extent: bool = False
    """Whether clusters have a column with its largest less its smallest value."""
    is_integer: bool = False
    """Whether files write known values as integers."""
    is_flag: bool = False
    """Whether the values are 1 for yes and 0 for no."""
    in_object_lists: bool = False
    """Whether object lists of detections and clusters keep it."""

    @property
    def name_with_unit(self) -> str:
        """Name in files, with the unit: `range_m`, `azimuth_deg`, `snr_db`."""
        return self.name + _SUFFIXES.get(self.shown_unit or self.unit, "")

    @property
    def extent_name_with_unit(self) -> str:
        """Name of the extent in files: `range_extent_m`."""
        return f"{self.name}_extent{self.name_with_unit.removeprefix(self.name)}"

    @property
    def shown_unit_symbol(self) -> str:
        """Unit as tables for people show it."""
        unit = self.shown_unit or self.unit
        return _SYMBOLS.get(unit, "" if unit == "1" else unit)

    @property
    def heading_with_unit(self) -> str:
        """Heading with the unit: "Range (m)"."""
        heading = self.heading[:1].upper() + self.heading[1:]
        return f"{heading} ({self.shown_unit_symbol})" if self.shown_unit_symbol else heading

    @property
    def is_hidden_if_unknown(self) -> bool:
        """True if tables for people leave the column out where no detection has a value."""
        return self.shown_unit == "deg" or self.is_integer

    def to_shown_unit(self, values: np.ndarray) -> np.ndarray:
        """Convert values in SI units to the unit that files and tables show."""
        if self.shown_unit == "deg":
            return np.degrees(values)
        if self.shown_unit == "dB":
            with np.errstate(divide="ignore"):  # no signal at all is minus infinity
                return np.asarray(to_decibels(values))
        return values

    def format_shown_values(self, values: np.ndarray) -> list[str]:
        """Write values in the shown unit for people; a flag in words, a dash where unknown."""
        if self.is_flag:
            return [{1.0: "yes", 0.0: "no"}.get(value, EN_DASH) for value in values.tolist()]
        return [format_fixed(value, self.decimals) for value in values.tolist()]

    def from_shown_unit(self, values: np.ndarray) -> np.ndarray:
        """Convert values in the unit that files and tables show to SI units."""
        if self.shown_unit == "deg":
            return np.radians(values)
        return from_decibels(values) if self.shown_unit == "dB" else values


TABLE = (
    DetectionColumn("frame", "1", "number of the frame", cluster="first"),
    DetectionColumn("time", "s", "instant to which the estimates refer", cluster="first"),
    DetectionColumn(
        *("range", "m", "distance from the origin of the array"),
        heading="range",
        cluster="mean",
        has_extent=True,
    ),
    DetectionColumn(
        *("velocity", "m/s", "rate of change of range, aliased where ambiguity_number is unknown"),
        heading="velocity",
        cluster="mean",
        has_extent=True,
    ),
    DetectionColumn(
        *("azimuth", "rad", "angle to the left of boresight", "deg"),
        heading="azimuth",
        decimals=2,
        cluster="mean",
        has_extent=True,
    ),
    DetectionColumn(
        *("elevation", "rad", "angle above the horizontal", "deg"),
        heading="elevation",
        decimals=2,
        cluster="mean",
    ),
    DetectionColumn(
        *("snr", "1", "signal-to-noise ratio after integration over samples, chirps and channels"),
        shown_unit="dB",
        heading="SNR",
        decimals=1,
        cluster="sum",
        in_object_lists=True,
    ),
    DetectionColumn("range_std", "m", "standard error of range", decimals=4),
    DetectionColumn("velocity_std", "m/s", "standard error of velocity", decimals=4),
    DetectionColumn("azimuth_std", "rad", "standard error of azimuth", "deg", decimals=2),
    DetectionColumn("elevation_std", "rad", "standard error of elevation", "deg", decimals=2),
    DetectionColumn(
        *("ambiguity_number", "1", "number of unambiguous velocity spans added"),
        cluster="strongest",
        is_integer=True,
    ),
    DetectionColumn("ambiguity_confidence", "1", "probability of that ambiguity number"),
    DetectionColumn(
        *(
            "moving",
            "1",
            "1 if found without static echoes, 0 if slow and only with them, NaN if unknown",
        ),
        heading="moving",
        cluster="strongest",
        is_integer=True,
        is_flag=True,
    ),
)
"""Columns of detections in the order of their datasets. `x_std` is the standard error of `x`."""

BY_NAME: Mapping[str, DetectionColumn] = {column.name: column for column in TABLE}
UNITS: Mapping[str, str] = {column.name: column.unit for column in TABLE}
"""SI unit of each column."""
SHOWN_COLUMNS = tuple(column for column in TABLE if column.heading)
"""Columns of tables for people, each with its standard error where there is one."""


def shown_columns(detections: xr.Dataset) -> tuple[DetectionColumn, ...]:
    """Return the columns that a table of these detections shows to people.

    Angles and motion are left out where no detection has a value.
    """
    return tuple(
        column
        for column in SHOWN_COLUMNS
        if column.name in detections
        and not (column.is_hidden_if_unknown and np.isnan(detections[column.name].values).all())
    )


def decimals_of_estimates(
    detections: xr.Dataset, *, range_cell_m: float, velocity_cell_m_per_s: float, digits: int = 2
) -> dict[str, int]:
    """Return the decimals of each estimate and its standard error in tables for people, by name.

    They show two `digits` of the smallest error. Errors below a hundredth of a resolution cell do
    not matter: other echoes and the oscillator shift estimates by more. No array is calibrated to
    a hundredth of a degree. All digits are in files.
    """
    smallest = {"range": range_cell_m / 100, "velocity": velocity_cell_m_per_s / 100}
    return {
        column.name: decimals_for_column(
            std.to_shown_unit(detections[std.name].values),
            digits=digits,
            at_most=column.decimals if column.shown_unit == "deg" else 6,
            smallest=smallest.get(column.name, 0.0),
        )
        for column in SHOWN_COLUMNS
        if (std := standard_error_column(column)) is not None and std.name in detections
    }


def rows_to_show(
    detections: xr.Dataset,
    at_most: int,
    *,
    range_cell_m: float,
    velocity_cell_m_per_s: float,
    is_leakage: np.ndarray | None = None,
) -> np.ndarray:
    """Return the rows to show to people, strongest first.

    Where more than `at_most` are detected, only the strongest one of each place is shown, of all
    frames: a target at rest would fill the table. Static echoes are mostly the strongest of a
    recording: half of the rows are left for detections that move, if there are as many, those with
    a known ambiguity number first. Rows marked as leakage (n,) are left out.
    """
    order = np.argsort(-detections.snr.values, kind="stable")
    if is_leakage is not None:
        order = order[~is_leakage[order]]
    if order.size <= at_most:
        return order
    is_moving = np.zeros(order.size, bool)
    if "moving" in detections:
        is_moving = detections.moving.values[order] == 1
    cells = {"range": range_cell_m, "velocity": velocity_cell_m_per_s}
    movers, others = order[is_moving], order[~is_moving]
    if movers.size:
        is_ambiguous = np.isnan(detections.ambiguity_number.values[movers])
        movers = movers[np.argsort(is_ambiguous, kind="stable")]
    movers = _strongest_of_each_place(detections, movers, at_most, cells)
    others = _strongest_of_each_place(detections, others, at_most, cells)
    n_moving = min(movers.size, max(at_most // 2, at_most - others.size))
    shown = np.concatenate([movers[:n_moving], others[: at_most - n_moving]])
    return np.asarray(shown[np.argsort(-detections.snr.values[shown], kind="stable")])


def _strongest_of_each_place(
    detections: xr.Dataset, rows: np.ndarray, at_most: int, cells: Mapping[str, float]
) -> np.ndarray:
    """Return the first row of each place, in the order of the rows, at most so many.

    Rows of different frames have one place if they are within two cells of each other, and their
    directions, where known, within three standard errors of the difference.
    """
    frame = detections.frame.values if "frame" in detections else None
    first_rows: list[int] = []
    while rows.size and len(first_rows) < at_most:
        first, rows = rows[0], rows[1:]
        first_rows.append(first)
        is_same = np.ones(rows.size, bool) if frame is None else frame[rows] != frame[first]
        for name, cell in cells.items():
            values = detections[name].values
            is_same &= ~(abs(values[rows] - values[first]) > 2 * cell)  # unknown ones are equal
        for name in ("azimuth", "elevation"):
            if name in detections and f"{name}_std" in detections:
                values, std = detections[name].values, detections[f"{name}_std"].values
                difference = np.angle(np.exp(1j * (values[rows] - values[first])))
                is_same &= ~(abs(difference) > 3 * np.hypot(std[rows], std[first]))
        rows = rows[~is_same]
    return np.array(first_rows, int)


def standard_error_column(column: DetectionColumn) -> DetectionColumn | None:
    """Return the column with the standard error of another one, if there is one."""
    return BY_NAME.get(f"{column.name}_std")


def detections_from_columns(columns: Mapping[str, np.ndarray]) -> xr.Dataset:
    """Label columns by name as a dataset over `detection`, in the order of the table.

    Columns that the table does not have follow without units.
    """
    names = [name for name in UNITS if name in columns]
    names += [name for name in columns if name not in UNITS]
    return xr.Dataset(
        {
            name: ("detection", columns[name], {"units": UNITS[name]} if name in UNITS else {})
            for name in names
        }
    )


def detection_columns_as_floats(
    detections: xr.Dataset, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Return columns of detections as floats, (n,) each; NaN for missing optional ones.

    Raises
    ------
    InvalidSetting
        If it is no dataset over `detection`, a required column is missing, or one is not numeric.
    """
    check_type("detections", detections, xr.Dataset, fix="pass what `detect` returns")
    missing = [name for name in required if name not in detections]
    if missing or "detection" not in detections.dims:
        raise InvalidSetting(
            "detections",
            value=f"without {', '.join(missing) or 'the axis detection'}",
            expected=f"a dataset over `detection`, with {', '.join(required)}",
            fix="pass what `detect` returns",
        )
    unknown = np.full(detections.sizes["detection"], np.nan)
    return {
        name: _numeric_column_as_floats(detections[name]) if name in detections else unknown
        for name in (*required, *optional)
    }


def check_detection_rows(
    columns: Mapping[str, np.ndarray],
    valid_masks_and_expectations: Mapping[str, tuple[np.ndarray, str]],
) -> None:
    """Raise `InvalidSetting` about the first column with an invalid row.

    `valid_masks_and_expectations` maps a column to the mask of its valid rows, (n,), and a
    description of valid values.
    """
    for name, (is_valid, expected) in valid_masks_and_expectations.items():
        if not is_valid.all():
            n_invalid = (~is_valid).sum()
            raise InvalidSetting(
                f"detections.{name}",
                value=f"{columns[name][~is_valid][0]} in {n_invalid} of {is_valid.size}",
                expected=expected,
                fix="leave these detections out",
            )


def valid_frame_number_mask(numbers: np.ndarray) -> np.ndarray:
    """Return the mask of valid frame numbers: integers from 0."""
    return np.asarray((numbers >= 0) & (numbers == np.floor(numbers)))


def check_type(name: str, argument: object, expected: type[Any], *, fix: str) -> None:
    """Raise `InvalidSetting` unless an argument is an instance of a class."""
    if not isinstance(argument, expected):
        raise InvalidSetting(
            name,
            value=describe_class(type(argument)),
            expected=describe_class(expected),
            fix=fix,
        )


def _numeric_column_as_floats(column: xr.DataArray) -> np.ndarray:
    if column.dims != ("detection",) or column.dtype.kind not in "iuf":
        raise InvalidSetting(
            f"detections.{column.name}",
            value=f"{column.dtype} over {', '.join(map(str, column.dims)) or 'no axis'}",
            expected="a number for each detection",
            fix="pass what `detect` returns",
        )
    return np.asarray(column.values, dtype=float)


def zero_where_unknown(values: np.ndarray) -> np.ndarray:
    """Return values with 0 in place of NaN.

    `np.nan_to_num` takes 20 us more for a few values, as it looks for infinite ones, too: 0.3 ms of
    a frame.
    """
    return np.where(np.isnan(values), 0.0, values)
