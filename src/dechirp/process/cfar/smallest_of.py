"""Smallest of two halves: keeps a target that another one, in one half, would mask.

G. V. Trunk, Range resolution of targets using automatic detectors, IEEE Trans. AES 14(5), 1978.
"""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.process.cfar.halves import OfHalves, halves
from dechirp.theory.cfar import smallest_of_factor


@value
class SmallestOf(OfHalves):
    """The smaller mean of the two halves of the training cells."""

    chosen: ClassVar[np.ufunc] = np.minimum
    law = staticmethod(smallest_of_factor)

    def low(self, offsets: np.ndarray) -> np.ndarray:
        """Either half brings alarms when it alone is low."""
        return halves(offsets)
