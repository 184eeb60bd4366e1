"""HDF5 files: samples, axes, tables and the description in one file."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.writers.hdf5_base import Hdf5Writer


@frozen_dataclass
class Hdf5(Hdf5Writer):
    """HDF5: complex samples as in h5py, converter codes as they are."""

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")

    def to_stored(self, values: np.ndarray) -> np.ndarray:
        return values
