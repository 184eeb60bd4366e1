"""Greatest-of CFAR: keeps its false-alarm rate at clutter edges.

V. G. Hansen and J. H. Sawyers, Detectability loss due to greatest-of selection in a
cell-averaging CFAR, IEEE Trans. AES 16(1), 1980.
"""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.processing.cfar.split_window import SplitWindowEstimator, split_halves
from dechirp.theory.cfar import greatest_of_factor


@frozen_dataclass
class GreatestOf(SplitWindowEstimator):
    """Larger mean of the two halves of the training cells."""

    select_mean: ClassVar[np.ufunc] = np.maximum
    halves_factor = staticmethod(greatest_of_factor)

    def low_subsets(self, offsets: np.ndarray) -> np.ndarray:
        """Return both halves as one set: a false alarm needs both low."""
        return np.any(split_halves(offsets), axis=0, keepdims=True)
