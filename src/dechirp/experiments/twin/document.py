"""Twin as plain values, for the terminal and for its page."""

from typing import Any

import numpy as np

from dechirp.config.dumping import to_json_data
from dechirp.core.units import is_absolute, to_decibels
from dechirp.experiments.twin.twin import Twin, TwinTolerance


def twin_comparison_as_dict(twin: Twin, tolerance: TwinTolerance) -> dict[str, Any]:
    """Convert everything about a twin except its maps to plain values; None for unknown ones.

    Levels are in the unit of the recording: dBFS, or dBm where it is calibrated. Differences are
    those of the twin from the recording.
    """
    units = twin.recording_units
    return {
        "name": twin.scenario.name,
        "frame": twin.frame_number,
        "seed": twin.scenario.seed,
        "unit": "dBm" if is_absolute(units) else "dBFS",
        "full_scale_dbm": None
        if is_absolute(units)
        else _ratio_to_decibels(twin.watts_per_unit * 1e3),
        "within": {"power_db": _ratio_to_decibels(tolerance.power), "bins": tolerance.cells},
        "passed": twin.is_twin_within_tolerance(tolerance),
        "differences": _peak_differences_as_dicts(twin, tolerance),
        "floor": _noise_floors_as_dict(twin),
        "findings": [to_json_data(finding) for finding in twin.findings],
    }


def _peak_differences_as_dicts(twin: Twin, tolerance: TwinTolerance) -> list[dict[str, Any]]:
    peaks = twin.differences
    columns = {
        "range_m": peaks.range.values,
        "velocity_m_per_s": peaks.velocity.values,
        "azimuth_deg": np.degrees(peaks.azimuth.values),
        "power_db": _power_in_recording_level_db(twin, peaks.power.values),
        "snr_db": to_decibels(peaks.snr.values),
        "power_difference_db": to_decibels(peaks.power_ratio.values),
        "power_std_db": to_decibels(1 + peaks.power_std.values),
        "range_difference_bins": peaks.range_cells.values,
        "velocity_difference_bins": peaks.velocity_cells.values,
        "std_bins": peaks.cells_std.values,
        "azimuth_difference_deg": np.degrees(peaks.azimuth_difference.values),
        "power_difference_clean_db": to_decibels(peaks.power_ratio_clean.values),
        "range_difference_clean_bins": peaks.range_cells_clean.values,
        "velocity_difference_clean_bins": peaks.velocity_cells_clean.values,
        "leakage": peaks.is_leakage.values,
        "searched": peaks.is_searched.values,
        "judged": twin.peaks_precise_enough_to_judge(tolerance),
        "within": twin.peaks_within_tolerance(tolerance),
        "within_clean": twin.noise_free_peaks_within_tolerance(tolerance),
    }
    return [
        dict(zip(columns, [_finite_or_none(cell) for cell in row], strict=True))
        for row in zip(*(column.tolist() for column in columns.values()), strict=True)
    ]


def _noise_floors_as_dict(twin: Twin) -> dict[str, Any]:
    noise = twin.noise
    columns = {
        "range_m": noise.range.values,
        "recorded_db": _power_in_recording_level_db(twin, noise.recorded_over_range.values),
        "twin_db": _power_in_recording_level_db(twin, noise.twin_over_range.values),
        "difference_db": _ratios_to_decibels_without_warnings(noise.ratio_over_range.values),
    }
    return {
        "recorded_db": _finite_or_none(
            float(_power_in_recording_level_db(twin, noise.recorded.values))
        ),
        "twin_db": _finite_or_none(float(_power_in_recording_level_db(twin, noise.twin.values))),
        "difference_db": _finite_or_none(
            float(_ratios_to_decibels_without_warnings(noise.ratio.values))
        ),
        "over_range": [
            dict(zip(columns, [_finite_or_none(cell) for cell in row], strict=True))
            for row in zip(*(column.tolist() for column in columns.values()), strict=True)
        ],
        "receivers_db": [
            _finite_or_none(cell)
            for cell in _ratios_to_decibels_without_warnings(noise.in_receiver.values).tolist()
        ],
    }


def _power_in_recording_level_db(twin: Twin, power_w: np.ndarray) -> np.ndarray:
    milli = 1e3 if is_absolute(twin.recording_units) else 1.0
    return _ratios_to_decibels_without_warnings(power_w / twin.watts_per_unit * milli)


def _ratios_to_decibels_without_warnings(ratios: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return to_decibels(ratios)


def _ratio_to_decibels(ratio: float) -> float:
    return float(to_decibels(ratio))


def _finite_or_none(number: Any) -> Any:
    return None if isinstance(number, float) and not np.isfinite(number) else number
