"""NumPy archives (`.npz`): arrays in a ZIP file, of which one holds the samples.

Those of ours have an array `dechirp` too, the description of the others.
"""

import math
import struct
import zipfile
import zlib
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.on_disk import Forward, mapped, streamed
from dechirp.formats.arrays.stored import (
    ALLOWED_BYTES,
    Stored,
    chosen,
    must_be_plausible,
    parsing,
    too_large,
)
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.description import is_ours
from dechirp.formats.kept import LONGEST_TEXT, is_meant, kept
from dechirp.formats.npy import HEAD_BYTES, Header

_MAGIC = b"PK\x03\x04"
_NEED = "a NumPy archive (.npz)"
_LOCAL_HEADER_BYTES = 30  # of a member, before its name
_MOST_MEMBERS = 1000
_END_BYTES, _LONGEST_COMMENT = 22, 2**16
_LONGEST_LIST = 2**22  # bytes; as objects, the members in it take 8 times as much
_CUBE, _TEXT, _GAP = "cube", "dechirp", "gap"


@value
class Npz(Format):
    """NumPy archives (`.npz`): an array whose axes the user names, or a file of ours.

    Arrays of an archive are mapped where they lie; compressed ones are read in their order.

    So the frames of a compressed array should be along its first axis.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inside")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by an archive with an array in it."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                return Fit.NO
        try:
            with _archive(path) as archive:
                names = archive.namelist()
                text = _text(path, archive)
        except Exception:  # foreign bytes: `read` says what is wrong with them
            return Fit.CONTAINER
        if text is not None and is_ours(text):
            return Fit.OWN
        return Fit.CONTAINER if any(name.endswith(".npy") for name in names) else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        file_bytes = path.stat().st_size
        with parsing(path, _NEED), _archive(path) as archive:
            text = _text(path, archive)
            if text is not None and is_meant(text, told):
                return _own(path, archive, text, told)
            headers = _headers(path, archive)
            name = chosen(path, {key: (h.shape, h.dtype) for key, h in headers.items()}, told)
            info = archive.getinfo(f"{name}.npy")
            header = headers[name]
            stored = _stored(path, info, header)
        must_be_plausible(path, stored, file_bytes=file_bytes)
        return contents(path, stored, told, file_bytes=file_bytes)


def _archive(path: Path) -> zipfile.ZipFile:
    """Open an archive whose list of members, which is read at once, is not too long for one."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - _END_BYTES - _LONGEST_COMMENT, 0))
        end = file.read()
    at = end.rfind(b"PK\5\6")
    if at >= 0 and (n_bytes := int.from_bytes(end[at + 12 : at + 16], "little")) > _LONGEST_LIST:
        raise RecordingError(
            path,
            got=f"an archive whose list of members has {n_bytes} bytes",
            need=f"at most {_LONGEST_LIST}",
            fix="Save the samples as one array with an axis for the frames.",
        )
    return zipfile.ZipFile(path)


def _headers(path: Path, archive: zipfile.ZipFile) -> dict[str, Header]:
    """Headers of the arrays, by name without `.npy`."""
    infos = [info for info in archive.infolist() if info.filename.endswith(".npy")]
    if len(infos) > _MOST_MEMBERS:
        raise RecordingError(
            path,
            got=f"an archive of {len(infos)} arrays",
            need=f"of at most {_MOST_MEMBERS}",
            fix="Save the samples as one array with an axis for the frames.",
        )
    return {info.filename.removesuffix(".npy"): _header(path, archive, info) for info in infos}


def _header(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Header:
    with archive.open(info) as member:
        return Header.read(path, member.read(HEAD_BYTES))


def _array(path: Path, archive: zipfile.ZipFile, name: str, most_bytes: int) -> np.ndarray:
    """A small array, read at once; raises `KeyError` if there is none of that name."""
    info = archive.getinfo(f"{name}.npy")
    header = _header(path, archive, info)
    # NumPy makes room for what a header claims before it reads.
    claimed = header.size + math.prod(header.shape) * header.dtype.itemsize
    if info.file_size > most_bytes:
        raise too_large(path, f"{name} of {claimed} bytes", file_bytes=path.stat().st_size)
    if claimed != info.file_size:
        raise ValueError(f"{name} of {info.file_size} bytes, whose header says {claimed}")
    with archive.open(info) as member:
        return np.lib.format.read_array(member, allow_pickle=False)


def _text(path: Path, archive: zipfile.ZipFile) -> str | None:
    """Text of the array `dechirp`; None if there is no such text."""
    if f"{_TEXT}.npy" not in archive.namelist():
        return None
    array = _array(path, archive, _TEXT, 4 * LONGEST_TEXT)
    return str(array) if array.ndim == 0 and array.dtype.kind == "U" else None


def _own(path: Path, archive: zipfile.ZipFile, text: str, told: Told) -> Contents:
    """What a file of ours holds."""
    info = archive.getinfo(f"{_CUBE}.npy")
    stored = _stored(path, info, _header(path, archive, info))
    file_bytes = path.stat().st_size
    must_be_plausible(path, stored, file_bytes=file_bytes)
    most = 2 * file_bytes + ALLOWED_BYTES
    has_gaps = f"{_GAP}.npy" in archive.namelist()
    return kept(
        path,
        text,
        stored,
        told,
        columns=lambda table, column: _array(path, archive, f"{table}.{column}", most),
        gaps=_array(path, archive, _GAP, most) if has_gaps else None,
        file_bytes=file_bytes,
    )


def _stored(path: Path, info: zipfile.ZipInfo, header: Header) -> Stored:
    header.must_fill(path, info.file_size)
    with path.open("rb") as file:
        file.seek(info.header_offset)
        head = file.read(_LOCAL_HEADER_BYTES)
    n_name, n_extra = struct.unpack("<HH", head[26:30])
    start = info.header_offset + _LOCAL_HEADER_BYTES + n_name + n_extra
    if info.compress_type == zipfile.ZIP_STORED:
        start += header.size
        return mapped(path, header.dtype, header.shape, offset=start, fortran=header.fortran)
    if info.compress_type != zipfile.ZIP_DEFLATED:
        raise RecordingError(
            path,
            got=f"an archive with compression {info.compress_type}",
            need="without compression, or with that of numpy.savez_compressed (deflate)",
            fix="Save it again with numpy.",
        )
    member = Forward(path, start, info.compress_size, need=_NEED, wbits=-zlib.MAX_WBITS)

    def fill(first: int, into: np.ndarray) -> None:
        member.fill(header.size + first, into)

    return streamed(header.shape, header.dtype, fill, fortran=header.fortran)
