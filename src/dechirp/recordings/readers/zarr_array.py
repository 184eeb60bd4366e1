"""Zarr arrays of other programs, whose axes the user names."""

from pathlib import Path
from typing import ClassVar

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.named_axes import interpret_array
from dechirp.recordings.arrays.zarr_arrays import METADATA_NAMES, lazy_zarr_array
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints


@frozen_dataclass
class ZarrArray(Format):
    """Zarr arrays, whose axes the user names.

    Chunks that were never written become gaps.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        is_zarr = path.is_dir() and any((path / mark).is_file() for mark in METADATA_NAMES)
        return MatchQuality.CONTAINER if is_zarr else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        samples, file_bytes = lazy_zarr_array(path, hints)
        return interpret_array(path, samples, hints, file_bytes=file_bytes)
