"""Where things lie on the maps of a moment, strongest first, and how many there are in words.

Columns are taken as variables: with labels each takes 40 us, twenty times a frame.
"""

from functools import lru_cache

import numpy as np

from dechirp.report.figures.ground import Seen
from dechirp.scene.folding import Place, folded, on_map
from dechirp.studio.moment import Moment


def strongest_first(moment: Moment) -> np.ndarray:
    """Order of the detections."""
    return np.argsort(-moment.detections.variables["snr"].values, kind="stable")


@lru_cache(maxsize=1)  # several views ask, one after the other: 0.1 ms
def found_on_map(moment: Moment) -> tuple[Place, np.ndarray]:
    """Detections, where their peaks lie, and their azimuths (rad), NaN where not told."""
    found = moment.detections.variables
    order = strongest_first(moment)
    place = Place(found["range"].values[order], found["velocity"].values[order])
    return on_map(place, moment.radar), found["azimuth"].values[order]


@lru_cache(maxsize=1)
def true_on_map(moment: Moment) -> tuple[Place, np.ndarray]:
    """Targets as a perfect detector sees them, folded, and their azimuths; none of a recording."""
    if moment.truth is None:
        return Place(np.empty(0), np.empty(0)), np.empty(0)
    truth = moment.truth.variables
    there = Place(truth["range"].values.ravel(), truth["velocity"].values.ravel())
    seen = on_map(folded(there, moment.radar), moment.radar)
    return seen, truth["azimuth"].values.ravel()


def with_directions(moment: Moment) -> Seen:
    """Detections that tell an azimuth, strongest first."""
    found = moment.detections.variables
    order = strongest_first(moment)
    told = order[np.isfinite(found["azimuth"].values[order])]
    return Seen(
        range_m=found["range"].values[told],
        azimuth_rad=found["azimuth"].values[told],
        elevation_rad=np.nan_to_num(found["elevation"].values[told]),
        range_std_m=found["range_std"].values[told],
        azimuth_std_rad=found["azimuth_std"].values[told],
        is_sure=np.isfinite(found["fold"].values[told]),
        field_of_view_rad=moment.chain.field_of_view.azimuth_rad,
    )


def ranges_alone(moment: Moment) -> np.ndarray:
    """Ranges of the detections that tell no azimuth, strongest first."""
    found = moment.detections.variables
    order = strongest_first(moment)
    return found["range"].values[order[np.isnan(found["azimuth"].values[order])]]
