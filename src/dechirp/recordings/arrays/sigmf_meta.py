"""Metadata of a SigMF recording: type, layout and position of its numbers.

They are in a file (`.sigmf-meta`), or with the numbers in an uncompressed archive (`.sigmf`).
`docs/decisions.md` states why the package sigmf is not used. The tests read and write with it.

SigMF, Signal Metadata Format specification, version 1.2.6.
"""

import json
import re
import tarfile
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import convert_parser_errors
from dechirp.recordings.readers.base import check_stays_in_folder
from dechirp.recordings.settings.json_text import (
    format_json_excerpt,
    is_float_sized_number,
    is_integer,
)

META, DATA, ARCHIVE = ".sigmf-meta", ".sigmf-data", ".sigmf"
EXTENSION, VERSION = "radar", "1.0.0"
"""Ours: docs/sigmf-radar.md."""
_SERIES = "1."  # compatible versions
MAX_BYTES = 2**24
"""Maximum size: parsed, the text takes 20 times as much, plus 100 bytes per object and list."""
_MAX_BRACKETS = 2**18
_MAX_MEMBERS = 1000  # of an archive; its recording has two or three
_MAX_CHANNELS = 4096  # more than any radar has; each would get an assumed position
_TAR_OFFSET, _TAR = 257, b"ustar"
_DATATYPE = re.compile(r"([cr])([fiu])(8|16|32|64)(?:_(le|be))?")


@frozen_dataclass
class SigmfMetadata:
    """Contents of a metadata file."""

    path: Path
    """The metadata file, or the archive."""
    data: Path
    """The file with the numbers."""
    data_offset: int
    """Position of the first number in this file, bytes."""
    data_bytes: int
    dtype: np.dtype
    """Type of one number."""
    is_complex: bool
    """Whether two numbers make a sample."""
    n_channels: int
    sample_rate_hz: float | None
    sha512: str | None
    global_fields: dict[str, Any]
    """Its object `global`."""
    captures: list[dict[str, Any]]
    annotations: list[dict[str, Any]]
    findings: tuple[Finding, ...]

    @property
    def has_dechirp_radar(self) -> bool:
        """True if it contains the radar, as dechirp writes it."""
        return f"{EXTENSION}:radar" in self.global_fields


def meta_and_data_paths(path: Path) -> tuple[Path, Path]:
    """Return metadata and data file of a recording, given either, or their common stem."""
    stem = path.name
    for ending in (META, DATA):
        stem = stem.removesuffix(ending)
    return path.with_name(stem + META), path.with_name(stem + DATA)


def parse_metadata(path: Path) -> dict[str, Any]:
    """Parse the metadata of a metadata file or an archive to their JSON object.

    Raises
    ------
    RecordingError
        If they are damaged or too long.
    """
    if path.name.endswith(ARCHIVE):
        return _parse_json(path, _read_archive(path)[0])
    with path.open("rb") as file:
        return _parse_json(path, file.read(MAX_BYTES + 1))


def is_tar_archive(path: Path) -> bool:
    """Return whether a file is a tar archive."""
    with path.open("rb") as file:
        return file.read(_TAR_OFFSET + len(_TAR))[_TAR_OFFSET:] == _TAR


def _read_archive(path: Path) -> tuple[bytes, tarfile.TarInfo]:
    """Return metadata and data member of the recording in an archive.

    Raises
    ------
    RecordingError
        If it is damaged, or has no recording or several.
    """
    expected = f"an uncompressed tar archive of one recording, a {META} and its {DATA}"
    with convert_parser_errors(path, expected), tarfile.open(path, "r:") as archive:
        members: dict[str, tarfile.TarInfo] = {}
        for number, member in enumerate(archive):
            if number == _MAX_MEMBERS:
                raise _metadata_error(path, f"more than {number} members", expected)
            if member.isreg() and member.name.endswith((META, DATA)):
                members[member.name] = member
        metas = [name for name in members if name.endswith(META)]
        if len(metas) != 1:
            names = ", ".join(map(_format_member_name, metas[:3]))
            raise _metadata_error(
                path,
                f"{len(metas)} recordings{f' ({names})' if names else ''}",
                expected,
                fix=f"unpack it (tar -xf {path.name}) and open one {META}",
            )
        data = members.get(metas[0].removesuffix(META) + DATA)
        if data is None or data.issparse():
            raise _metadata_error(
                path, f"{_format_member_name(metas[0])} without its {DATA}", expected
            )
        if data.offset_data + data.size > path.stat().st_size:
            raise _metadata_error(
                path, f"truncated within {_format_member_name(data.name)}", expected
            )
        content = archive.extractfile(members[metas[0]])
        assert content is not None
        return content.read(MAX_BYTES + 1), data


def _format_member_name(name: str) -> str:
    return format_json_excerpt(PurePosixPath(name).name)


def _parse_json(path: Path, content: bytes) -> dict[str, Any]:
    """Parse metadata within their limits."""
    if len(content) > MAX_BYTES:
        raise _metadata_error(path, f"more than {MAX_BYTES} bytes", f"at most {MAX_BYTES} bytes")
    if content.count(b"{") + content.count(b"[") > _MAX_BRACKETS:
        raise _metadata_error(path, "too many objects and lists", f"at most {_MAX_BRACKETS}")
    try:
        tree = json.loads(content)
    except RecursionError:
        raise _metadata_error(path, "nested too deeply", "the JSON of SigMF") from None
    except ValueError as error:
        raise _metadata_error(path, f"not JSON ({error})", "the JSON of SigMF") from None
    global_fields = tree.get("global") if isinstance(tree, dict) else None
    if not isinstance(global_fields, dict) or "core:datatype" not in global_fields:
        raise _metadata_error(path, "no global or no core:datatype", "the metadata of SigMF")
    return tree


def read_metadata(path: Path) -> SigmfMetadata:
    """Read the metadata of a recording, given either of its files or an archive.

    Raises
    ------
    RecordingError
        If it is damaged, or needs an unsupported feature.
    """
    if path.name.endswith(ARCHIVE):
        content, member = _read_archive(path)
        tree = _parse_json(path, content)
        meta, data, data_name = path, path, PurePosixPath(member.name).name
        data_offset, data_bytes = member.offset_data, member.size
    else:
        meta, data = meta_and_data_paths(path)
        partner = data if path == meta else meta
        if not partner.is_file():
            raise _metadata_error(
                path, f"no {partner.name} next to it", f"a pair of {META} and {DATA}"
            )
        check_stays_in_folder(path.parent, partner)
        tree = parse_metadata(meta)
        data_name, data_offset, data_bytes = data.name, 0, data.stat().st_size
    global_fields: dict[str, Any] = tree["global"]
    _check_conforming_dataset(meta, data_name, global_fields)
    dtype, is_complex = _parse_dtype_and_is_complex(meta, global_fields["core:datatype"])
    n_channels, rate_hz = (
        global_fields.get("core:num_channels", 1),
        global_fields.get("core:sample_rate"),
    )
    if not is_integer(n_channels) or not 1 <= n_channels <= _MAX_CHANNELS:
        description = f"core:num_channels {format_json_excerpt(n_channels)}"
        raise _metadata_error(meta, description, f"a count of at most {_MAX_CHANNELS}")
    if rate_hz is not None and not (is_float_sized_number(rate_hz) and rate_hz > 0):
        raise _metadata_error(
            meta, f"core:sample_rate {format_json_excerpt(rate_hz)}", "samples per second"
        )
    sha512 = global_fields.get("core:sha512")
    captures = _read_segment_list(meta, tree, "captures")
    if any(capture.get("core:header_bytes") for capture in captures):
        raise _non_conforming_dataset_error(meta, "core:header_bytes")
    return SigmfMetadata(
        path=meta,
        data=data,
        data_offset=data_offset,
        data_bytes=data_bytes,
        dtype=dtype,
        is_complex=is_complex,
        n_channels=n_channels,
        sample_rate_hz=None if rate_hz is None else float(rate_hz),
        sha512=sha512.lower() if isinstance(sha512, str) else None,
        global_fields=global_fields,
        captures=captures,
        annotations=_read_segment_list(meta, tree, "annotations"),
        findings=_check_extensions_and_note_ignored(meta, global_fields),
    )


def _read_segment_list(path: Path, tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Return the segments of captures or annotations, each with an integer `core:sample_start`."""
    segments = tree.get(name, [])
    is_valid = isinstance(segments, list) and all(
        isinstance(segment, dict) and is_integer(segment.get("core:sample_start"))
        for segment in segments
    )
    if not is_valid:
        raise _metadata_error(
            path, f"{name} is not a list of segments", "a core:sample_start in each"
        )
    return segments


def _check_conforming_dataset(meta: Path, data_name: str, global_fields: dict[str, Any]) -> None:
    """Raise `RecordingError` unless the numbers are one block in the data file."""
    if global_fields.get("core:dataset", data_name) != data_name:
        raise _non_conforming_dataset_error(meta, "core:dataset")
    for name in ("core:trailing_bytes", "core:metadata_only"):
        if global_fields.get(name):
            raise _non_conforming_dataset_error(meta, name)


def _non_conforming_dataset_error(meta: Path, field: str) -> RecordingError:
    """Return the error of a non-conforming data set."""
    return _metadata_error(
        meta,
        f"{field}: numbers in another file, or with other data around them",
        f"only the numbers, in the {DATA} of the same name",
        fix="convert it to a conforming SigMF recording",
    )


def _parse_dtype_and_is_complex(path: Path, datatype: Any) -> tuple[np.dtype, bool]:
    """Return the type of a number, and whether two make a sample."""
    parts = _DATATYPE.fullmatch(datatype) if isinstance(datatype, str) else None
    if parts is not None:
        shape, kind, bits, order = parts.groups()
        if (bits == "8") == (order is None) and kind + bits not in ("f8", "f16", "i64", "u64"):
            code = f"{'>' if order == 'be' else '<'}{kind}{int(bits) // 8}"
            return np.dtype(code), shape == "c"
    raise _metadata_error(
        path,
        f"core:datatype {format_json_excerpt(datatype)}",
        "one of SigMF: c or r, then f32, f64, i8, i16, i32, u8, u16 or u32, then _le or _be where"
        " numbers have several bytes",
    )


def _check_extensions_and_note_ignored(
    path: Path, global_fields: dict[str, Any]
) -> tuple[Finding, ...]:
    """Return a note about ignored extensions.

    Raises
    ------
    RecordingError
        If an unknown extension is required.
    """
    extensions = global_fields.get("core:extensions", [])
    is_valid = isinstance(extensions, list) and all(
        isinstance(extension, dict) and isinstance(extension.get("name"), str)
        for extension in extensions
    )
    if not is_valid:
        raise _metadata_error(path, "core:extensions is not a list of names", "the JSON of SigMF")
    ignored_names = []
    for extension in extensions:
        name, version = extension["name"], extension.get("version")
        if name == EXTENSION and f"{EXTENSION}:radar" in global_fields:
            if not str(version).startswith(_SERIES):
                raise _metadata_error(
                    path,
                    f"extension {EXTENSION} of version {format_json_excerpt(version)}",
                    f"version {VERSION}",
                    fix="read it with the version of dechirp that wrote it",
                )
        elif extension.get("optional") is True:
            ignored_names.append(name)
        else:
            raise _metadata_error(
                path,
                f"the extension {format_json_excerpt(name)}, which is not optional",
                f"no required extension but {EXTENSION}",
                fix="convert it with a program that supports the extension",
            )
    if not ignored_names:
        return ()
    return (
        Finding(
            level="note",
            setting="core:extensions",
            value=f"{', '.join(format_json_excerpt(name) for name in ignored_names)}, ignored",
            expected="the core fields, which are enough to read the samples",
            fix="check whether the extensions describe the samples",
        ),
    )


def _metadata_error(
    path: Path, value: str, expected: str, *, fix: str = "copy it again from its source"
) -> RecordingError:
    """Return the error of metadata that cannot be read."""
    return RecordingError(path, value=value, expected=expected, fix=fix)
