"""Greatest of two halves: keeps its rate of false alarms where clutter begins.

V. G. Hansen and J. H. Sawyers, Detectability loss due to greatest-of selection in a
cell-averaging CFAR, IEEE Trans. AES 16(1), 1980.
"""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.process.cfar.halves import OfHalves, halves
from dechirp.theory.cfar import greatest_of_factor


@value
class GreatestOf(OfHalves):
    """The larger mean of the two halves of the training cells."""

    chosen: ClassVar[np.ufunc] = np.maximum
    law = staticmethod(greatest_of_factor)

    def low(self, offsets: np.ndarray) -> np.ndarray:
        """Both halves bring alarms when they are low together."""
        return np.any(halves(offsets), axis=0, keepdims=True)
