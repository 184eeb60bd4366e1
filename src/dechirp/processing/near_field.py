"""Near-field limit of an array: detections whose wavefronts are curved over it."""

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding
from dechirp.radar.radar import Radar


def far_field_range_m(radar: Radar) -> float:
    """Return the range from which waves are plane over the array: 2 D^2 / lambda.

    D is its largest extent. At that range the ends of the array are a sixteenth of a wavelength
    farther from the target than its middle, 22.5 degrees of phase
    (IEEE Std 145-2013, far-field region).
    """
    positions_m = radar.element_positions_m
    length_m = max(float(np.linalg.norm(positions_m - p_m, axis=1).max()) for p_m in positions_m)
    return 2 * length_m**2 / radar.frame.chirp.wavelength_m


def near_field_findings(radar: Radar, detections: xr.Dataset) -> list[Finding]:
    """Return a note if angles of detections in the near field were estimated.

    No note if the near field is within the first range cell, where targets are not expected.
    """
    limit_m = far_field_range_m(radar)
    if limit_m <= radar.frame.chirp.range_resolution_m:
        return []
    has_angle = np.isfinite(detections.azimuth.values) | np.isfinite(detections.elevation.values)
    nearest_m = np.min(detections.range.values[has_angle], initial=np.inf)
    if nearest_m >= limit_m:
        return []
    return [
        Finding(
            level="note",
            setting="chain.angle",
            value=f"a detection at {nearest_m:.3g} m, in the near field of the array",
            expected=f"{limit_m:.3g} m or more for a plane wave over all elements; angles of nearer"
            " targets are biased or blurred",
            fix="use fewer elements for near targets, or treat those angles with care",
        )
    ]
