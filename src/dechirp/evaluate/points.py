"""Sets of points, and how far they are apart."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from dechirp.core.checks import numbers
from dechirp.core.errors import InvalidSetting


def distances_m(found_m: ArrayLike, truth_m: ArrayLike) -> np.ndarray:
    """Between each of (n, d) and each of (m, d): (n, m); either may be empty.

    Raises
    ------
    InvalidSetting
        If a position is not finite, or the sets have other axes.
    """
    found = numbers("found_m", found_m)
    truth = numbers("truth_m", truth_m)
    if found.size == 0 or truth.size == 0:
        return np.zeros((len(found), len(truth)))
    if found.ndim != 2 or truth.ndim != 2 or found.shape[1] != truth.shape[1]:
        raise InvalidSetting(
            "found_m",
            got=f"of shape {found.shape}, beside a truth of shape {truth.shape}",
            need="a row for each point, with as many coordinates as the truth",
            fix="Give both as [[x, y], ...].",
        )
    return np.asarray(cdist(found, truth))
