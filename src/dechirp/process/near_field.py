"""Targets so near that an array sees their waves bent."""

import numpy as np
import xarray as xr
from scipy.spatial.distance import pdist

from dechirp.core.findings import Finding
from dechirp.radar.radar import Radar


def far_from_m(radar: Radar) -> float:
    """Range from which a wave is flat over the array: 2 D^2 / lambda, D its largest length.

    There its ends lie a sixteenth of a wavelength behind the middle, 22.5 degrees of phase
    (IEEE Std 145-2013, far-field region).
    """
    length_m = float(np.max(pdist(radar.elements_m), initial=0.0))
    return 2 * length_m**2 / radar.frame.chirp.wavelength_m


def remark(radar: Radar, detections: xr.Dataset) -> list[Finding]:
    """A note, where angles were estimated of anything nearer than that.

    None where the near field is within the first range cell: that is no place for targets.
    """
    limit_m = far_from_m(radar)
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
            got=f"a detection at {nearest_m:.3g} m, in the near field of the array",
            need=f"{limit_m:.3g} m or more for a flat wave over all elements: angles of what is"
            " nearer are off, or blurred",
            fix="Use fewer elements for what is so near, or read those angles with care.",
        )
    ]
