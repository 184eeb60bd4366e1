"""HDF5 files: samples, axes, tables and the description in one file."""

from abc import abstractmethod
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.hdf5_file import check_recording_fits_hdf5, write_hdf5_file


@frozen_dataclass
class Hdf5Writer(Writer):
    """Samples, axes, tables and the description in one HDF5 file."""

    summary: ClassVar[str] = "all: samples, radar, gaps, tables"

    @abstractmethod
    def convert_complex_for_storage(self, values: np.ndarray) -> np.ndarray:
        """Convert complex numbers to their stored form; others are unchanged."""

    def check_recording(self, recording: Recording) -> None:
        check_recording_fits_hdf5(recording)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        return write_hdf5_file(recording, out, progress, self.convert_complex_for_storage)


@frozen_dataclass
class Hdf5(Hdf5Writer):
    """HDF5: complex samples as in h5py, converter codes as they are."""

    suffixes: ClassVar[tuple[str, ...]] = (".h5", ".hdf5")

    def convert_complex_for_storage(self, values: np.ndarray) -> np.ndarray:
        return values
