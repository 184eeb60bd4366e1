"""NumPy archives (`.npz`): arrays in a ZIP file, one of which holds the samples.

Native archives also contain an array `dechirp`, which describes the others.
"""

import math
import struct
import zipfile
import zlib
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS
from dechirp.recordings.arrays.lazy_array import (
    ALLOWED_BYTES,
    LazyArray,
    check_plausible_size,
    choose_array_name,
    convert_parser_errors,
    is_numeric,
    memory_exceeds_file_error,
)
from dechirp.recordings.arrays.lazy_files import (
    InflateStream,
    open_memory_mapped_array,
    open_sequential_array,
)
from dechirp.recordings.arrays.named_axes import interpret_array_as_recording
from dechirp.recordings.description import is_native_description
from dechirp.recordings.foreign_files import ZIP_HEADER_BYTES, read_first_member_name
from dechirp.recordings.native import (
    MAX_DESCRIPTION_CHARACTERS,
    is_native_without_array_hints,
    read_native_contents,
)
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.readers.npy import HEAD_BYTES, NpyHeader

MAGIC = b"PK\x03\x04"
_EXPECTED = "a NumPy archive (.npz)"
_MAX_MEMBERS = 1000
_END_BYTES, _MAX_COMMENT_BYTES = 22, 2**16
_MAX_LIST_BYTES = 2**22  # bytes; the members as Python objects take 8 times as much
_CUBE, _TEXT, _GAP = "cube", "dechirp", "gap"


@frozen_dataclass
class Npz(Format):
    """NumPy archives (`.npz`): an array whose axes the user names, or a native file.

    Uncompressed arrays are memory-mapped; compressed ones are read sequentially, so the frames of a
    compressed array should lie along its first axis.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq", "inner_name")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                return MatchQuality.NO
        try:
            with _open_archive(path) as archive:
                names = archive.namelist()
                text = _read_native_description(path, archive)
        except Exception:  # foreign bytes: `read` reports the damage of a NumPy archive
            is_numpy = path.suffix == ".npz" or read_first_member_name(path).endswith(".npy")
            return MatchQuality.CONTAINER if is_numpy else MatchQuality.NO
        if text is not None and is_native_description(text):
            return MatchQuality.SELF_DESCRIBING
        return (
            MatchQuality.CONTAINER
            if any(name.endswith(".npy") for name in names)
            else MatchQuality.NO
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        file_bytes = path.stat().st_size
        with convert_parser_errors(path, _EXPECTED), _open_archive(path) as archive:
            text = _read_native_description(path, archive)
            if text is not None and is_native_without_array_hints(text, hints):
                return _read_native_file(path, archive, text, hints)
            headers = _read_array_headers(path, archive)
            name = choose_array_name(
                path, {key: (h.shape, h.dtype) for key, h in headers.items()}, hints
            )
            info = archive.getinfo(f"{name}.npy")
            header = headers[name]
            samples = _open_lazy_member(path, info, header)
        check_plausible_size(path, samples, file_bytes=file_bytes)
        return interpret_array_as_recording(path, samples, hints, file_bytes=file_bytes)


def open_npz_arrays(path: Path) -> dict[str, LazyArray]:
    """Open the numeric arrays of an archive by name, without the texts of native files.

    Raises
    ------
    RecordingError
        If the archive is damaged.
    """
    with convert_parser_errors(path, _EXPECTED), _open_archive(path) as archive:
        return {
            name: _open_lazy_member(path, archive.getinfo(f"{name}.npy"), header)
            for name, header in _read_array_headers(path, archive).items()
            if is_numeric(header.dtype)
        }


def _open_archive(path: Path) -> zipfile.ZipFile:
    """Open an archive after checking that its member list is short enough to hold in memory."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - _END_BYTES - _MAX_COMMENT_BYTES, 0))
        tail = file.read()
    end_offset = tail.rfind(b"PK\5\6")
    if (
        end_offset >= 0
        and (n_bytes := int.from_bytes(tail[end_offset + 12 : end_offset + 16], "little"))
        > _MAX_LIST_BYTES
    ):
        raise RecordingError(
            path,
            value=f"an archive with a member list of {n_bytes} bytes",
            expected=f"at most {_MAX_LIST_BYTES}",
            fix="save the samples as one array with an axis for the frames",
        )
    return zipfile.ZipFile(path)


def _read_array_headers(path: Path, archive: zipfile.ZipFile) -> dict[str, NpyHeader]:
    """Read the headers of all arrays, by name without `.npy`."""
    infos = [info for info in archive.infolist() if info.filename.endswith(".npy")]
    if len(infos) > _MAX_MEMBERS:
        raise RecordingError(
            path,
            value=f"an archive of {len(infos)} arrays",
            expected=f"at most {_MAX_MEMBERS}",
            fix="save the samples as one array with an axis for the frames",
        )
    return {
        info.filename.removesuffix(".npy"): _read_array_header(path, archive, info)
        for info in infos
    }


def _read_array_header(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NpyHeader:
    """Read the header of one array."""
    with archive.open(info) as member:
        return NpyHeader.parse(path, member.read(HEAD_BYTES))


def _read_small_array(
    path: Path, archive: zipfile.ZipFile, name: str, max_bytes: int
) -> np.ndarray:
    """Read a small array at once; raise `KeyError` if there is none of that name."""
    info = archive.getinfo(f"{name}.npy")
    header = _read_array_header(path, archive, info)
    # NumPy allocates the size that a header claims before it reads.
    claimed_bytes = header.n_bytes + math.prod(header.shape) * header.dtype.itemsize
    if info.file_size > max_bytes:
        raise memory_exceeds_file_error(
            path, f"{name} of {claimed_bytes} bytes", file_bytes=path.stat().st_size
        )
    if claimed_bytes != info.file_size:
        raise ValueError(f"{name} of {info.file_size} bytes, whose header says {claimed_bytes}")
    with archive.open(info) as member:
        return np.lib.format.read_array(member, allow_pickle=False)


def _read_native_description(path: Path, archive: zipfile.ZipFile) -> str | None:
    """Return the text of the array `dechirp`; None if there is none."""
    if f"{_TEXT}.npy" not in archive.namelist():
        return None
    array = _read_small_array(path, archive, _TEXT, 4 * MAX_DESCRIPTION_CHARACTERS)
    return str(array) if array.ndim == 0 and array.dtype.kind == "U" else None


def _read_native_file(
    path: Path, archive: zipfile.ZipFile, description_text: str, hints: RecordingHints
) -> Contents:
    """Read a file written by dechirp."""
    info = archive.getinfo(f"{_CUBE}.npy")
    samples = _open_lazy_member(path, info, _read_array_header(path, archive, info))
    file_bytes = path.stat().st_size
    check_plausible_size(path, samples, file_bytes=file_bytes)
    max_bytes = 2 * file_bytes + ALLOWED_BYTES
    has_gaps = f"{_GAP}.npy" in archive.namelist()
    return read_native_contents(
        path,
        description_text,
        samples,
        hints,
        read_column=lambda table, column: _read_small_array(
            path, archive, f"{table}.{column}", max_bytes
        ),
        gaps=_read_small_array(path, archive, _GAP, max_bytes) if has_gaps else None,
        file_bytes=file_bytes,
    )


def _open_lazy_member(path: Path, info: zipfile.ZipInfo, header: NpyHeader) -> LazyArray:
    """Open an array of the archive: mapped if it is stored, sequential if it is deflated."""
    header.check_file_size(path, info.file_size)
    with path.open("rb") as file:
        file.seek(info.header_offset)
        head = file.read(ZIP_HEADER_BYTES)
    n_name, n_extra = struct.unpack("<HH", head[26:30])
    start = info.header_offset + ZIP_HEADER_BYTES + n_name + n_extra
    if info.compress_type == zipfile.ZIP_STORED:
        start += header.n_bytes
        return open_memory_mapped_array(
            path, header.dtype, header.shape, offset=start, fortran=header.is_fortran
        )
    if info.compress_type != zipfile.ZIP_DEFLATED:
        raise RecordingError(
            path,
            value=f"an archive with compression {info.compress_type}",
            expected="no compression, or that of numpy.savez_compressed (deflate)",
            fix="save it again with numpy",
        )
    member = InflateStream(
        path, start, info.compress_size, expected=_EXPECTED, wbits=-zlib.MAX_WBITS
    )

    def fill(first: int, into: np.ndarray) -> None:
        member.decompress_into(header.n_bytes + first, into)

    return open_sequential_array(header.shape, header.dtype, fill, fortran=header.is_fortran)
