"""RADDet, one frame a file (not verified on a real file).

A NumPy array (sample, chirp, rx, tx) = (256, 64, 4, 2), as its documentation says.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dechirp.core.values import value
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.unverified import unverified
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.npy import Npy

_AXES = ("sample", "chirp", "rx", "tx")


@value
class Raddet(Format):
    """RADDet data set, a frame a file (not verified on a real file).

    Raw samples; its processed cubes have lost what is read here.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)
    only_told: ClassVar[bool] = True

    def recognise(self, path: Path) -> Fit:
        """See `Npy`."""
        return min(Npy().recognise(path), Fit.POSSIBLE)

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        return unverified(Npy().read(path, replace(told, axes=_AXES)), "RADDet")
