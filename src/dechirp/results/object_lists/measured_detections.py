"""Detections from the objects of a radar that sends no samples, for the ego motion and trackers."""

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.detection_columns import UNITS
from dechirp.results.object_lists.list_columns import check_object_list

__all__ = ["objects_to_detections"]


@check_argument_types
def objects_to_detections(
    objects: xr.Dataset,
    *,
    range_std_m: float,
    velocity_std_m_per_s: float,
    lateral_std_m: float,
) -> xr.Dataset:
    """Convert an object list to detections: range, radial velocity and azimuth of each object.

    Lists of vendors contain no standard errors, so these are arguments.

    Parameters
    ----------
    objects : Dataset
        As `read_can_log` returns it. Objects without a position are left out.
    range_std_m, velocity_std_m_per_s : float
        Standard errors of all ranges and radial velocities.
    lateral_std_m : float
        Standard error across the line of sight; that of an azimuth is it over the range.

    Returns
    -------
    Dataset over `detection`
        With the columns that `ego_motion` requires, and the `number` of the object.

    Raises
    ------
    InvalidSetting
        If it is not an object list, or a standard error is not positive.
    """
    for name, number in (
        ("range_std_m", range_std_m),
        ("velocity_std_m_per_s", velocity_std_m_per_s),
        ("lateral_std_m", lateral_std_m),
    ):
        check_number(name, number, above=0.0)
    objects = check_object_list(objects)
    x, y, vx, vy = (objects[name].values for name in ("x", "y", "vx", "vy"))
    z = np.nan_to_num(objects["z"].values)
    ground_m = np.hypot(x, y)
    range_m = np.hypot(ground_m, z)
    is_known = range_m > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = {
            "frame": objects["frame"].values,
            "time": objects["time"].values,
            "range": range_m,
            # The vertical velocity is unknown; that of radial lists lies in the line of sight.
            "velocity": (vx * x + vy * y) * range_m / ground_m**2,
            "azimuth": np.arctan2(y, x),
            "elevation": np.where(np.isnan(objects["z"].values), np.nan, np.arctan2(z, ground_m)),
            "range_std": np.full(len(x), range_std_m),
            "velocity_std": np.full(len(x), velocity_std_m_per_s),
            "azimuth_std": lateral_std_m / range_m,
            "number": objects["number"].values,
        }
    units = {**UNITS, "number": "1"}
    return xr.Dataset(
        {
            name: ("detection", column[is_known], {"units": units[name.removesuffix("_std")]})
            for name, column in columns.items()
        }
    )
