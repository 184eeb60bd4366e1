"""NumPy arrays (`.npy`): samples whose axes and encoding the user names."""

import io
import math
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.on_disk import mapped
from dechirp.formats.arrays.stored import Stored, must_be_numeric, written
from dechirp.formats.base import Contents, Fit, Format, Told

MAGIC = b"\x93NUMPY"
HEAD_BYTES = 2**17
"""That hold the longest header: NumPy reads none of more than 10,000 characters."""


@value
class Npy(Format):
    """NumPy arrays (`.npy`), whose axes the user names.

    One array in a file.

    Axes may come in any order; frame, chirp, tx and rx may be left out where there is one. Real
    numbers with an axis `iq` of two are complex samples.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by the first bytes."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            return Fit.CONTAINER if file.read(len(MAGIC)) == MAGIC else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        return contents(path, array_in(path), told, file_bytes=path.stat().st_size)


def array_in(path: Path) -> Stored:
    """Array of an .npy file: nothing is read or allocated before it is used.

    Raises
    ------
    RecordingError
        If the header is damaged, the numbers are not plain numbers, or the size of the
        file is not what the header says.
    """
    with path.open("rb") as file:
        header = Header.read(path, file.read(HEAD_BYTES))
    header.must_fill(path, path.stat().st_size)
    return mapped(path, header.dtype, header.shape, offset=header.size, fortran=header.fortran)


@value
class Header:
    """What a .npy file says of itself."""

    dtype: np.dtype
    shape: tuple[int, ...]
    fortran: bool
    """Whether the first axis runs fastest."""
    size: int
    """Bytes of the header, before those of the numbers."""

    @staticmethod
    def read(path: Path, head: bytes) -> "Header":
        """Read the header at the beginning of some bytes; raises `RecordingError`."""
        file = io.BytesIO(head)
        try:
            version = np.lib.format.read_magic(file)
            reader = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]
            shape, fortran, dtype = reader(file)
        except Exception as error:  # the header is foreign text: its parser may raise anything
            raise RecordingError(
                path,
                got=f"a file whose header is damaged ({type(error).__name__})",
                need="a NumPy array (.npy)",
                fix="Copy the file again from its source, or save it again with numpy.save.",
            ) from None
        return Header(dtype=dtype, shape=shape, fortran=fortran, size=file.tell())

    def must_fill(self, path: Path, n_bytes: int) -> None:
        """Raise `RecordingError` unless header and numbers make so many bytes."""
        must_be_numeric(path, self.dtype)
        # Python integers: an absurd shape cannot overflow, and nothing is allocated for it.
        needed = self.size + math.prod(self.shape) * self.dtype.itemsize
        if not self.shape or min(self.shape) < 1 or needed != n_bytes:
            raise RecordingError(
                path,
                got=f"a file of {n_bytes} bytes",
                need=f"of {needed} bytes, for {self.dtype} of shape {written(self.shape)} as its"
                " header says",
                fix="Copy the whole file again from its source."
                if needed > n_bytes
                else "Save one array that is not empty.",
            )
