"""RaDICaL (not verified on a real file).

An HDF5 file whose dataset `radar` is (frame, chirp, element, sample), as its documentation
says: 2 transmitters with 4 receivers each.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from dechirp.core.values import value
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.unverified import unverified
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.hdf5 import Hdf5

_AXES = ("frame", "chirp", "element", "sample")


@value
class Radical(Format):
    """RaDICaL data set, HDF5 (not verified on a real file).

    Transmitters that take turns, already sorted; pictures beside them are left out.
    """

    options: ClassVar[tuple[str, ...]] = ("encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)
    only_told: ClassVar[bool] = True

    def recognise(self, path: Path) -> Fit:
        """See `Hdf5`."""
        return min(Hdf5().recognise(path), Fit.POSSIBLE)

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        meant = replace(told, axes=_AXES, inside=told.inside or "radar")
        return unverified(Hdf5().read(path, meant), "RaDICaL")
