"""Vital signs from all frames of a run."""

from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.core.text import format_fixed
from dechirp.experiments.run import VITAL_SIGNS_SETTING, Result
from dechirp.processing.slow_time import range_traces
from dechirp.processing.vital_signs import VitalSigns, chest_displacement, measure_vital_signs

VITAL_SIGN_HEADINGS = ("time (s)", "range (m)", "breathing (1/min)", "heart (1/min)")


def add_vital_signs(result: Result, settings: VitalSigns | None = None) -> Result:
    """Return a result with breathing and heart rate, from its kept frames, one in memory.

    Raises
    ------
    InvalidSetting
        If the frames are too few or too slow, or no range row lies in the interval.
    """
    settings = VitalSigns() if settings is None else settings
    traces = []
    for number, cube in enumerate(result.frames(), start=result.first_frame):
        starts_s = {"frame": [result.radar.frame.frame_start_s(number)]}
        timed = cube if "frame" in cube.coords else cube.assign_coords(starts_s)
        traces.append(range_traces(timed, result.radar.for_frame(number), settings.range_m))
    trace = xr.concat(traces, "time", combine_attrs="override")
    return replace(
        result,
        vital_signs=measure_vital_signs(trace, settings),
        displacement=chest_displacement(trace, settings),
        findings=tuple(f for f in result.findings if f.setting != VITAL_SIGNS_SETTING),
    )


def vital_sign_rows(vital: xr.Dataset) -> list[tuple[str, ...]]:
    """Return the texts of a table with the rates of each window, with their intervals."""
    return [
        (
            format_fixed(float(window["time"]), 1),
            format_fixed(float(window["range"]) if "range" in window else np.nan, 2),
            *(_format_rate(window, sign) for sign in ("breathing", "heart")),
        )
        for window in (vital.isel(window=index) for index in range(vital.sizes["window"]))
    ]


def _format_rate(window: xr.Dataset, sign: str) -> str:
    rate, low, high = (60 * float(window[f"{sign}_rate{end}"]) for end in ("", "_low", "_high"))
    if not np.isfinite(rate):
        return "not measurable"
    return f"{format_fixed(rate, 1)} ({format_fixed(low, 1)} to {format_fixed(high, 1)})"
