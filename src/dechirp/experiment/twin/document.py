"""A twin in plain values: what the command prints, and what its page is made of."""

from typing import Any

import numpy as np

from dechirp.config.texts import plain
from dechirp.core.units import decibels
from dechirp.experiment.twin.twin import Twin, TwinBar


def document(made: Twin, bar: TwinBar) -> dict[str, Any]:
    """Everything about a twin but its maps; None for what is not told.

    Levels are in the unit of the recording: dBFS, or dBm where it is calibrated. Differences are
    those of the twin from the recording.
    """
    units = made.recording_units
    return {
        "name": made.scenario.name,
        "frame": made.frame_number,
        "seed": made.scenario.seed,
        "unit": "dBm" if units == "sqrt(W)" else "dBFS",
        "full_scale_dbm": None if units == "sqrt(W)" else _db(made.watts_per_unit * 1e3),
        "within": {"power_db": _db(bar.power), "bins": bar.cells},
        "passed": made.is_within(bar),
        "differences": _rows(made, bar),
        "floor": _floor(made),
        "findings": [plain(finding) for finding in made.findings],
    }


def _rows(made: Twin, bar: TwinBar) -> list[dict[str, Any]]:
    found = made.differences
    columns = {
        "range_m": found.range.values,
        "velocity_m_per_s": found.velocity.values,
        "azimuth_deg": np.degrees(found.azimuth.values),
        "power_db": _level(made, found.power.values),
        "snr_db": decibels(found.snr.values),
        "power_difference_db": decibels(found.power_ratio.values),
        "power_std_db": decibels(1 + found.power_std.values),
        "range_difference_bins": found.range_cells.values,
        "velocity_difference_bins": found.velocity_cells.values,
        "std_bins": found.cells_std.values,
        "azimuth_difference_deg": np.degrees(found.azimuth_difference.values),
        "power_difference_clean_db": decibels(found.power_ratio_clean.values),
        "range_difference_clean_bins": found.range_cells_clean.values,
        "velocity_difference_clean_bins": found.velocity_cells_clean.values,
        "leakage": found.leaks.values,
        "searched": found.searched.values,
        "judged": made.judged(bar),
        "within": made.within(bar),
        "within_clean": made.within_clean(bar),
    }
    return [
        dict(zip(columns, [_cell(one) for one in row], strict=True))
        for row in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def _floor(made: Twin) -> dict[str, Any]:
    found = made.floor
    over = {
        "range_m": found.range.values,
        "recorded_db": _level(made, found.recorded_over_range.values),
        "twin_db": _level(made, found.twin_over_range.values),
        "difference_db": _decibels(found.ratio_over_range.values),
    }
    return {
        "recorded_db": _cell(float(_level(made, found.recorded.values))),
        "twin_db": _cell(float(_level(made, found.twin.values))),
        "difference_db": _cell(float(_decibels(found.ratio.values))),
        "over_range": [
            dict(zip(over, [_cell(one) for one in row], strict=True))
            for row in zip(*(column.tolist() for column in over.values()), strict=True)
        ],
        "receivers_db": [_cell(one) for one in _decibels(found.in_receiver.values).tolist()],
    }


def _level(made: Twin, power_w: np.ndarray) -> np.ndarray:
    milli = 1e3 if made.recording_units == "sqrt(W)" else 1.0
    return _decibels(power_w / made.watts_per_unit * milli)


def _decibels(ratio: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return decibels(ratio)


def _db(ratio: float) -> float:
    return float(decibels(ratio))


def _cell(one: Any) -> Any:
    return None if isinstance(one, float) and not np.isfinite(one) else one
