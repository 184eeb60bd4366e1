"""Vital signs from all frames of a run."""

import xarray as xr

from dechirp.experiments.run import Result
from dechirp.processing.slow_time import range_traces
from dechirp.processing.vital_signs import VitalSigns, measure_vital_signs


def measure_run_vital_signs(result: Result, settings: VitalSigns | None = None) -> xr.Dataset:
    """Measure breathing and heart rate from the kept frames of a run, one frame in memory.

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
    return measure_vital_signs(xr.concat(traces, "time"), settings)
