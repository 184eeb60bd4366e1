"""netCDF-4: HDF5 that programs for labelled arrays open; complex samples have an axis `iq`."""

from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.exchange.hdf5_file import must_fit, write_file
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.recording import Recording


@value
class Netcdf(Writer):
    """netCDF-4: it has no complex numbers, so that their parts lie along an axis `iq`."""

    endings: ClassVar[tuple[str, ...]] = (".nc", ".nc4")
    keeps: ClassVar[str] = "all: samples, radar, gaps, tables"

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        must_fit(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        return write_file(recording, out, progress, _parts)


def _parts(values: np.ndarray) -> np.ndarray:
    """Complex numbers (...) as their real and imaginary parts (..., 2); others as they are."""
    if values.dtype.kind != "c":
        return values
    return np.ascontiguousarray(values).view(values.real.dtype).reshape(*values.shape, 2)
