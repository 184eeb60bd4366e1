"""MATLAB files (`.mat`): one array of a workspace holds the samples.

Axes are named in the order in which MATLAB shows them. Files of version 7.3 are HDF5, where
they lie in the opposite order and complex numbers are pairs.
"""

from pathlib import Path
from typing import ClassVar

from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.mat5 import variables
from dechirp.formats.arrays.stored import Stored, chosen, must_be_plausible, reversed_axes
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.hdf5 import dataset_in

_OLD, _NEW = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"


@value
class Matlab(Format):
    """MATLAB files: an array whose axes the user names.

    Files of version 5 to 7.3, which other programs write, too.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inside")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by the first bytes."""
        return Fit.CONTAINER if _head(path) in (_OLD, _NEW) else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        stored = _old(path, told) if _head(path) == _OLD else _new(path, told)
        file_bytes = path.stat().st_size
        must_be_plausible(path, stored, file_bytes=file_bytes)
        return contents(path, stored, told, file_bytes=file_bytes)


def _head(path: Path) -> bytes:
    if not path.is_file():
        return b""
    with path.open("rb") as file:
        return file.read(len(_OLD))


def _old(path: Path, told: Told) -> Stored:
    found = variables(path)
    name = chosen(path, {key: (one.shape, one.dtype) for key, one in found.items()}, told)
    return found[name].stored()


def _new(path: Path, told: Told) -> Stored:
    return reversed_axes(dataset_in(path, told, of_matlab=True))
