"""RaDICaL data set.

An HDF5 file whose dataset `radar` is (frame, chirp, element, sample), with 2 transmitters and 4
receivers. Written from the documentation of the data set, not verified on a real file.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.readers.hdf5 import Hdf5

_AXES = ("frame", "chirp", "element", "sample")


@frozen_dataclass
class Radical(Format):
    """RaDICaL data set (HDF5).

    Chirps of the time-multiplexed transmitters are already sorted; camera pictures are ignored.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)
    must_be_named: ClassVar[bool] = True
    experimental: ClassVar[bool] = True

    def recognise(self, path: Path) -> MatchQuality:
        return min(Hdf5().recognise(path), MatchQuality.POSSIBLE)

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        complete_hints = replace(hints, axes=_AXES, inner_name=hints.inner_name or "radar")
        return Hdf5().read(path, complete_hints)
