"""netCDF-4: HDF5 that programs for labelled arrays open; complex samples have an axis `iq`."""

from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.exchange.writers.in_hdf5 import InHdf5


@value
class Netcdf(InHdf5):
    """netCDF-4: it has no complex numbers, so that their parts lie along an axis `iq`."""

    endings: ClassVar[tuple[str, ...]] = (".nc", ".nc4")

    def as_stored(self, values: np.ndarray) -> np.ndarray:
        """Complex numbers (...) as their real and imaginary parts (..., 2)."""
        if values.dtype.kind != "c":
            return values
        return np.ascontiguousarray(values).view(values.real.dtype).reshape(*values.shape, 2)
