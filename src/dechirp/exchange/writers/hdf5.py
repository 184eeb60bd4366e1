"""HDF5: samples, axes, tables and the description in one file."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.exchange.writers.in_hdf5 import InHdf5


@value
class Hdf5(InHdf5):
    """HDF5: complex samples as h5py has them, codes of a converter as they are."""

    endings: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")

    def as_stored(self, values: np.ndarray) -> np.ndarray:
        """All as they are."""
        return values
