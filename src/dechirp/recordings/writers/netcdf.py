"""netCDF-4: HDF5 for labelled-array programs; complex samples have an axis `iq`."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.writers.hdf5 import Hdf5Writer


@frozen_dataclass
class Netcdf(Hdf5Writer):
    """netCDF-4, which has no complex numbers: their parts lie along an axis `iq`."""

    suffixes: ClassVar[tuple[str, ...]] = (".nc", ".nc4")

    def convert_complex_for_storage(self, values: np.ndarray) -> np.ndarray:
        """Convert complex numbers (...) to their real and imaginary parts (..., 2)."""
        if values.dtype.kind != "c":
            return values
        return np.ascontiguousarray(values).view(values.real.dtype).reshape(*values.shape, 2)
