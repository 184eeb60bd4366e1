"""ColoRadar data set, one frame a file.

Raw int16 in the order (tx, rx, chirp, sample, I and Q). Written from the documentation of the data
set, not verified on a real file.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.bare_cube import BareCube
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints

_AXES = ("tx", "rx", "chirp", "sample", "iq")


@frozen_dataclass
class Coloradar(Format):
    """ColoRadar data set, one frame a file.

    Frames of the single chip (3 x 4 antennas) or of the cascade (12 x 16), depending on the radar.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)
    must_be_named: ClassVar[bool] = True
    experimental: ClassVar[bool] = True

    def recognise(self, path: Path) -> MatchQuality:
        return BareCube().recognise(path)

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        return BareCube().read(path, replace(hints, axes=_AXES))
