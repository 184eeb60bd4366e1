"""ColoRadar, one frame a file (not verified on a real file).

Bare int16, (tx, rx, chirp, sample, I and Q), as its documentation says.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dechirp.core.values import value
from dechirp.formats.arrays.unverified import unverified
from dechirp.formats.bare_cube import BareCube
from dechirp.formats.base import Contents, Fit, Format, Told

_AXES = ("tx", "rx", "chirp", "sample", "iq")


@value
class Coloradar(Format):
    """ColoRadar data set, a frame a file (not verified on a real file).

    Of the single chip (3 x 4 antennas) or the cascade (12 x 16): the radar tells.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)
    only_told: ClassVar[bool] = True

    def recognise(self, path: Path) -> Fit:
        """See `BareCube`."""
        return BareCube().recognise(path)

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        return unverified(BareCube().read(path, replace(told, axes=_AXES)), "ColoRadar")
