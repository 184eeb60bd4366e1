"""HDF5 files (`.h5`, also netCDF 4): a dataset holds the samples, or one of ours says all."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.hdf5_datasets import NEED, dataset_in, named, opened, stored, text_of
from dechirp.formats.arrays.stored import ALLOWED_BYTES, parsing, too_large
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.description import is_ours
from dechirp.formats.kept import LONGEST_TEXT, is_meant, kept

_MAGIC = b"\x89HDF\r\n\x1a\n"
_STARTS = (0, 512, 1024, 2048)  # a block of the user's own may come first
_OURS, _CUBE, _GAP = "dechirp", "cube", "gap"


@value
class Hdf5(Format):
    """HDF5 and netCDF4: a dataset whose axes the user names.

    Any dataset of numbers, or of pairs called real and imag, re and im, r and i. What
    `dechirp convert` wrote needs nothing told, unless the user names another array of it.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inside")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by the signature, ours by its description; MATLAB 7.3 is its own format."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(_STARTS[-1] + len(_MAGIC))
        found = any(head.startswith(_MAGIC, start) for start in _STARTS)
        if not found or head.startswith(b"MATLAB 7.3"):
            return Fit.NO
        return Fit.OWN if _description(path) else Fit.CONTAINER

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        text = _description(path)
        if text is None or not is_meant(text, told):
            return contents(path, dataset_in(path, told), told, file_bytes=path.stat().st_size)
        with parsing(path, f"{NEED} as it was written"):
            return _own(path, text, told)


def _description(path: Path) -> str | None:
    """What a file of ours says of its samples; None if it is another's, or damaged."""
    try:
        with opened(path) as file:
            text = text_of(file, _OURS)
    except Exception:  # foreign bytes: `read` says what is wrong with them
        return None
    return text if text and len(text) <= LONGEST_TEXT and is_ours(text) else None


def _own(path: Path, text: str, told: Told) -> Contents:
    """A file that we wrote."""
    file = opened(path)
    beside = _Beside(path, file)
    return kept(
        path,
        text,
        stored(path, file, beside.dataset(_CUBE)),
        told,
        columns=beside.column,
        gaps=None if named(path, file, _GAP) is None else beside.whole(_GAP),
        file_bytes=path.stat().st_size,
    )


class _Beside:
    """What lies in a file beside its samples, read at once; all of it together has a bound."""

    def __init__(self, path: Path, file: Any) -> None:
        self.path, self.file = path, file
        self.file_bytes, self.held_bytes = path.stat().st_size, 0

    def dataset(self, name: str) -> Any:
        found = named(self.path, self.file, name)
        if found is None:
            raise KeyError(f"no dataset {name}")
        return found

    def whole(self, name: str) -> np.ndarray:
        dataset = self.dataset(name)
        if dataset.dtype.hasobject:  # of any length: a few bytes can stand for all of the file
            raise TypeError(f"{name} of {dataset.dtype}")
        self.held_bytes += dataset.nbytes
        if self.held_bytes > 2 * self.file_bytes + ALLOWED_BYTES:
            what = f"tables of {self.held_bytes} bytes"
            raise too_large(self.path, what, file_bytes=self.file_bytes)
        if dataset.shape and dataset.size:
            part = tuple(slice(0, size) for size in dataset.shape)
            return stored(self.path, self.file, dataset).read(part)
        return np.asarray(dataset[()])

    def column(self, table: str, name: str) -> np.ndarray:
        """One as `core.plain` had it: of texts, flags, or both parts of complex numbers."""
        values = self.whole(f"{table}/{name}")
        dataset = self.dataset(f"{table}/{name}")
        if values.dtype.kind == "S":
            rows = np.frombuffer(values.tobytes(), np.uint8)
            return rows.reshape(*values.shape, values.dtype.itemsize)
        if text_of(dataset, "parts") == "real imaginary":
            return np.ascontiguousarray(values).view(np.result_type(values.dtype, 1j))[..., 0]
        return values.astype(bool) if text_of(dataset, "dtype") == "bool" else values
