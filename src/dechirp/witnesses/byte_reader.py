"""Sequential reader of the binary files of witnesses."""

from pathlib import Path

import numpy as np


class ByteReader:
    """Reader of little-endian numbers from the beginning of a file to its end."""

    def __init__(self, path: Path) -> None:
        self._bytes = path.read_bytes()
        self._at = 0

    def read(self, dtype: str, *shape: int) -> np.ndarray:
        """Return the next numbers; raise `ValueError` if the file is too short."""
        count = int(np.prod(shape, dtype=int))
        numbers = np.frombuffer(self._bytes, dtype, count, self._at).reshape(shape)
        self._at += numbers.nbytes
        return numbers

    def read_one(self, dtype: str) -> int:
        """Return the next number."""
        return int(self.read(dtype, 1)[0])
