"""What writers of HDF5 files share: all but how complex numbers lie in them."""

from abc import abstractmethod
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.exchange.hdf5_file import must_fit, write_file
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.recording import Recording


@value
class InHdf5(Writer):
    """Samples, axes, tables and the description in one HDF5 file."""

    keeps: ClassVar[str] = "all: samples, radar, gaps, tables"

    @abstractmethod
    def as_stored(self, values: np.ndarray) -> np.ndarray:
        """Complex numbers as the file has them; others as they are."""

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        must_fit(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        return write_file(recording, out, progress, self.as_stored)
