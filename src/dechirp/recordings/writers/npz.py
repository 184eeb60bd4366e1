"""NumPy archives (`.npz`) for `np.load`: `np.load("x.npz")["cube"]`.

`cube` (frame, chirp, rx, sample), complex64 or float32, or int16 codes with a last axis `iq`
where they are complex; `dechirp`, the description, a text; `gap` (frame, chirp) uint8 if
chirps were lost; the columns of each table, as `truth.range`. Nothing is compressed, so
that readers can map frames into memory.
"""

import zipfile
from pathlib import Path
from typing import IO, ClassVar

import numpy as np

from dechirp.core.atomic_files import atomic_file
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.json_columns import TYPES
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.adc_samples import (
    iter_code_or_float_arrays,
    write_as_codes_else_floats,
)
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)


@frozen_dataclass
class Npz(Writer):
    """NumPy archives (`.npz`): samples, radar, lost chirps and tables."""

    suffixes: ClassVar[tuple[str, ...]] = (".npz",)
    summary: ClassVar[str] = "samples, radar, gaps, tables"

    def check_recording(self, recording: Recording) -> None:
        recording.check_has_samples()
        recording_description_and_columns(recording, None)
        check_column_types(TYPES, recording.tables)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:

        def write_with(scale: float | None) -> None:
            with atomic_file(out) as temporary, zipfile.ZipFile(temporary, "w") as archive:
                _write_cube(archive, recording, scale, progress)
                for name, array in _arrays_without_cube(recording, scale).items():
                    with _open_npy_member(archive, name) as member:
                        np.lib.format.write_array(member, array, allow_pickle=False)

        write_as_codes_else_floats(recording, write_with)
        return (out,)


def _open_npy_member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    # No time stamp: equal recordings give equal bytes.
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)


def _write_cube(
    archive: zipfile.ZipFile,
    recording: Recording,
    scale: float | None,
    progress: Progress | None,
) -> None:
    with _open_npy_member(archive, "cube") as member:
        for n_done, frame in enumerate(iter_code_or_float_arrays(recording, scale), start=1):
            if n_done == 1:
                header = np.lib.format.header_data_from_array_1_0(frame)
                header["shape"] = (recording.n_frames, *frame.shape)
                np.lib.format.write_array_header_1_0(member, header)
            member.write(np.ascontiguousarray(frame).reshape(-1).view(np.uint8).data)
            if progress is not None:
                progress(n_done, recording.n_frames)


def _arrays_without_cube(recording: Recording, scale: float | None) -> dict[str, np.ndarray]:
    """Return all arrays except the samples, by name."""
    contents = recording.contents
    description, tables = recording_description_and_columns(recording, scale)
    arrays = {"dechirp": np.array(description.json_text)}
    if contents.gaps is not None:
        arrays["gap"] = contents.gaps.astype(np.uint8)
    for name, columns in tables.items():
        arrays |= {f"{name}.{column}": values for column, values in columns.items()}
    return arrays
