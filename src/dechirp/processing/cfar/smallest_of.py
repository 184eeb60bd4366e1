"""Smallest-of CFAR: detects a target that another one in one half would mask.

G. V. Trunk, Range resolution of targets using automatic detectors, IEEE Trans. AES 14(5), 1978.
"""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.split_window import SplitWindowEstimator, split_halves
from dechirp.theory.cfar import smallest_of_factor


@frozen_dataclass
class SmallestOf(SplitWindowEstimator):
    """Smaller mean of the two halves of the training cells."""

    select_mean: ClassVar[np.ufunc] = np.minimum
    halves_factor = staticmethod(smallest_of_factor)

    def low_subsets(self, offsets: np.ndarray) -> np.ndarray:
        """Return each half as a set: either causes false alarms if it is low."""
        return split_halves(offsets)
