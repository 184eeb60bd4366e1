"""HDF5: samples, axes, tables and the description in one file."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.values import value
from dechirp.exchange.hdf5_file import must_fit, write_file
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.recording import Recording


@value
class Hdf5(Writer):
    """HDF5: complex samples as h5py has them, codes of a converter as they are."""

    endings: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")
    keeps: ClassVar[str] = "all: samples, radar, gaps, tables"

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        must_fit(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        return write_file(recording, out, progress, lambda values: values)
