"""NumPy archives (`.npz`), that `np.load` opens: `np.load("x.npz")["cube"]`.

`cube` (frame, chirp, rx, sample), complex64 or float32, or int16 codes with a last axis `iq`
where they are complex; `dechirp`, the description, a text; `gap` (frame, chirp) uint8 where
chirps were lost; the columns of each table, as `truth.range`. Nothing is compressed, so that
frames are mapped where they lie.
"""

import zipfile
from pathlib import Path
from typing import IO, ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.exchange.coded import if_codes, numbers
from dechirp.exchange.said import must_be_of, said_of
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.arrays.json_columns import TYPES
from dechirp.formats.recording import Recording
from dechirp.store.whole import whole_file


@value
class Npz(Writer):
    """NumPy archives (`.npz`): samples, radar, lost chirps and tables."""

    endings: ClassVar[tuple[str, ...]] = (".npz",)
    keeps: ClassVar[str] = "samples, radar, gaps, tables"

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        recording.must_hold_samples()
        said_of(recording, None)
        must_be_of(TYPES, recording.tables)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""

        def write_with(scale: float | None) -> None:
            with whole_file(out) as made, zipfile.ZipFile(made, "w") as archive:
                _write_cube(archive, recording, scale, progress)
                for name, array in _others(recording, scale).items():
                    with _member(archive, name) as member:
                        np.lib.format.write_array(member, array, allow_pickle=False)

        if_codes(recording, write_with)
        return (out,)


def _member(archive: zipfile.ZipFile, name: str) -> IO[bytes]:
    # Without the time of writing: the same recording gives the same bytes.
    return archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True)


def _write_cube(
    archive: zipfile.ZipFile,
    recording: Recording,
    scale: float | None,
    progress: Progress | None,
) -> None:
    with _member(archive, "cube") as member:
        for done, frame in enumerate(numbers(recording, scale), start=1):
            if done == 1:
                said = np.lib.format.header_data_from_array_1_0(frame)
                said["shape"] = (recording.n_frames, *frame.shape)
                np.lib.format.write_array_header_1_0(member, said)
            member.write(np.ascontiguousarray(frame).reshape(-1).view(np.uint8).data)
            if progress is not None:
                progress(done, recording.n_frames)


def _others(recording: Recording, scale: float | None) -> dict[str, np.ndarray]:
    """All arrays but the samples, by name."""
    held = recording.contents
    description, tables = said_of(recording, scale)
    arrays = {"dechirp": np.array(description.text)}
    if held.gaps is not None:
        arrays["gap"] = held.gaps.astype(np.uint8)
    for name, columns in tables.items():
        arrays |= {f"{name}.{column}": values for column, values in columns.items()}
    return arrays
