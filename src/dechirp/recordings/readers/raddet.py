"""RADDet data set, one frame a file.

A NumPy array (sample, chirp, rx, tx) = (256, 64, 4, 2). Written from the documentation of the data
set, not verified on a real file.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.readers.npy import Npy

_AXES = ("sample", "chirp", "rx", "tx")


@frozen_dataclass
class Raddet(Format):
    """RADDet data set, one frame a file.

    Raw samples only: the processed cubes of the data set contain no samples.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)
    must_be_named: ClassVar[bool] = True
    experimental: ClassVar[bool] = True

    def recognise(self, path: Path) -> MatchQuality:
        return min(Npy().recognise(path), MatchQuality.POSSIBLE)

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        return Npy().read(path, replace(hints, axes=_AXES))
