"""NumPy arrays (`.npy`): samples whose axes and encoding the user names."""

import io
import math
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.lazy_array import LazyArray, check_numeric, format_shape
from dechirp.recordings.arrays.lazy_files import open_memory_mapped_array
from dechirp.recordings.arrays.named_axes import interpret_array_as_recording
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints

MAGIC = b"\x93NUMPY"
HEAD_BYTES = 2**17
"""Number of bytes that contains the longest header; NumPy accepts at most 10,000 characters."""


@frozen_dataclass
class Npy(Format):
    """NumPy arrays (`.npy`), whose axes the user names.

    Axes may come in any order; frame, chirp, tx and rx may be left out if their size is 1. Real
    numbers with an axis `iq` of size 2 are complex samples.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            return MatchQuality.CONTAINER if file.read(len(MAGIC)) == MAGIC else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        return interpret_array_as_recording(
            path, open_npy_array(path), hints, file_bytes=path.stat().st_size
        )


def open_npy_array(path: Path) -> LazyArray:
    """Open the array of an .npy file; nothing is read or allocated before use.

    Raises
    ------
    RecordingError
        If the header is damaged, the dtype is not numeric, or the file size contradicts the header.
    """
    with path.open("rb") as file:
        header = NpyHeader.parse(path, file.read(HEAD_BYTES))
    header.check_file_size(path, path.stat().st_size)
    return open_memory_mapped_array(
        path, header.dtype, header.shape, offset=header.n_bytes, fortran=header.is_fortran
    )


@frozen_dataclass
class NpyHeader:
    """Header of a .npy file."""

    dtype: np.dtype
    shape: tuple[int, ...]
    is_fortran: bool
    """Whether the first axis runs fastest."""
    n_bytes: int
    """Size of the header, before the numbers."""

    @staticmethod
    def parse(path: Path, head: bytes) -> "NpyHeader":
        """Parse the header at the start of `head`; raises `RecordingError`."""
        file = io.BytesIO(head)
        try:
            version = np.lib.format.read_magic(file)
            reader = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]
            shape, fortran, dtype = reader(file)
        except Exception as error:  # a foreign header: its parser may raise anything
            raise RecordingError(
                path,
                value=f"a damaged header ({type(error).__name__})",
                expected="a NumPy array (.npy)",
                fix="copy the file again from its source, or save it again with numpy.save",
            ) from None
        return NpyHeader(dtype=dtype, shape=shape, is_fortran=fortran, n_bytes=file.tell())

    def check_file_size(self, path: Path, n_bytes: int) -> None:
        """Raise `RecordingError` unless header and numbers take exactly `n_bytes` bytes."""
        check_numeric(path, self.dtype)
        # Python integers do not overflow for an absurd shape, and nothing is allocated for it.
        expected_bytes = self.n_bytes + math.prod(self.shape) * self.dtype.itemsize
        if not self.shape or min(self.shape) < 1 or expected_bytes != n_bytes:
            raise RecordingError(
                path,
                value=f"a file of {n_bytes} bytes",
                expected=f"{expected_bytes} bytes, for {self.dtype} of shape"
                f" {format_shape(self.shape)} as in its header",
                fix="copy the whole file again from its source"
                if expected_bytes > n_bytes
                else "save one array that is not empty",
            )
