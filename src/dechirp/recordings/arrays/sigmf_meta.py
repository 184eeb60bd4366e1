"""Metadata of a SigMF recording: type, layout and position of its numbers.

They are in a file (`.sigmf-meta`), or with the numbers in an uncompressed archive (`.sigmf`). The
package sigmf parses and validates them.

SigMF, Signal Metadata Format specification, version 1.2.6.
"""

import tarfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.optional_imports import import_from_extra
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import convert_parser_errors
from dechirp.recordings.readers.base import check_stays_in_folder
from dechirp.recordings.settings.json_text import (
    format_json_excerpt,
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


def is_tar_archive(path: Path) -> bool:
    """Return whether a file is a tar archive."""
    with path.open("rb") as file:
        return file.read(_TAR_OFFSET + len(_TAR))[_TAR_OFFSET:] == _TAR


def _read_archive(path: Path) -> tuple[bytes, str]:
    """Return the metadata in an archive, and the name of its data member.

    The package sigmf takes the last metadata and the first data, also those of two recordings.

    Raises
    ------
    RecordingError
        If it is damaged, or has no recording or several.
    """
    expected = f"an uncompressed tar archive of one recording, a {META} and its {DATA}"
    with convert_parser_errors(path, expected), tarfile.open(path, "r:") as archive:
        names = sorted(
            member.name
            for member in islice(archive, _MAX_MEMBERS)
            if member.isfile() and not member.issparse() and member.name.endswith((META, DATA))
        )
        if archive.next() is not None:
            raise _metadata_error(path, f"more than {_MAX_MEMBERS} members", expected)
        stem = names[0].removesuffix(DATA) if names else ""
        if names != [stem + DATA, stem + META]:
            shown = ", ".join(_format_member_name(name) for name in names[:4])
            raise _metadata_error(
                path,
                f"not one recording but {shown or 'no file of a recording'}",
                expected,
                fix=f"unpack it (tar -xf {path.name}) and open one {META}",
            )
        content = archive.extractfile(stem + META)
        assert content is not None
        return content.read(MAX_BYTES + 1), PurePosixPath(stem + DATA).name


def _format_member_name(name: str) -> str:
    return format_json_excerpt(PurePosixPath(name).name)


def _check_text_size(path: Path, content: bytes) -> None:
    """Raise `RecordingError` if JSON would take too much memory when it is parsed."""
    if len(content) > MAX_BYTES:
        raise _metadata_error(path, f"more than {MAX_BYTES} bytes", f"at most {MAX_BYTES} bytes")
    if content.count(b"{") + content.count(b"[") > _MAX_BRACKETS:
        raise _metadata_error(path, "too many objects and lists", f"at most {_MAX_BRACKETS}")


@contextmanager
def _convert_sigmf_errors(path: Path) -> Iterator[None]:
    """Convert errors of the package sigmf to `RecordingError`s that name the field."""
    validation_error = import_from_extra("io", "jsonschema", setting="recording").ValidationError
    with convert_parser_errors(path, "a SigMF recording"), warnings.catch_warnings():
        # Of extensions that are used and not declared.
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            yield
        except validation_error as error:
            raise _metadata_error(
                path, f"{error.json_path}: {error.message[:200]}", "the metadata of SigMF"
            ) from None


def read_metadata(path: Path) -> SigmfMetadata:
    """Read the metadata of a recording, given either of its files or an archive.

    Raises
    ------
    RecordingError
        If it is damaged, or needs an unsupported feature.
    """
    sigmf = import_from_extra("io", "sigmf", setting="recording")
    if path.name.endswith(ARCHIVE):
        meta = data = path
        content, data_name = _read_archive(path)
        _check_text_size(meta, content)
        with _convert_sigmf_errors(meta):
            reader = sigmf.SigMFArchiveReader(path, skip_checksum=True, autoscale=False)
        file = reader.sigmffile
        data_offset, data_bytes = file.data_offset, file.data_size_bytes
    else:
        meta, data = meta_and_data_paths(path)
        partner = data if path == meta else meta
        if not partner.is_file():
            raise _metadata_error(
                path, f"no {partner.name} next to it", f"a pair of {META} and {DATA}"
            )
        check_stays_in_folder(path.parent, partner)
        with meta.open("rb") as text:
            content = text.read(MAX_BYTES + 1)
        _check_text_size(meta, content)
        with _convert_sigmf_errors(meta):
            file = sigmf.SigMFFile(metadata=content)
            file.validate()
        data_name, data_offset, data_bytes = data.name, 0, data.stat().st_size
    global_fields: dict[str, Any] = file.get_global_info()
    _check_conforming_dataset(meta, data_name, global_fields)
    datatype = global_fields["core:datatype"]
    number = sigmf.sigmffile.dtype_info(datatype)
    if datatype.endswith(("_le", "_be")) == (number["component_size"] == 1):
        raise _metadata_error(
            meta,
            f"core:datatype {format_json_excerpt(datatype)}",
            "_le or _be after numbers of several bytes, and nothing after those of one",
        )
    n_channels, rate_hz = file.num_channels, global_fields.get("core:sample_rate")
    if n_channels > _MAX_CHANNELS:
        description = f"core:num_channels {format_json_excerpt(n_channels)}"
        raise _metadata_error(meta, description, f"a count of at most {_MAX_CHANNELS}")
    if rate_hz is not None and not rate_hz > 0:  # NaN, which the schema accepts
        raise _metadata_error(meta, f"core:sample_rate {rate_hz}", "samples per second")
    sha512 = global_fields.get("core:sha512")
    captures = file.get_captures()
    if any(capture.get("core:header_bytes") for capture in captures):
        raise _non_conforming_dataset_error(meta, "core:header_bytes")
    return SigmfMetadata(
        path=meta,
        data=data,
        data_offset=data_offset,
        data_bytes=data_bytes,
        dtype=number["component_dtype"],
        is_complex=number["is_complex"],
        n_channels=n_channels,
        sample_rate_hz=None if rate_hz is None else float(rate_hz),
        sha512=sha512.lower() if isinstance(sha512, str) else None,
        global_fields=global_fields,
        captures=captures,
        annotations=file.get_annotations(),
        findings=_check_extensions_and_note_ignored(meta, global_fields),
    )


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


def _check_extensions_and_note_ignored(
    path: Path, global_fields: dict[str, Any]
) -> tuple[Finding, ...]:
    """Return a note about ignored extensions.

    Raises
    ------
    RecordingError
        If an unknown extension is required.
    """
    ignored_names = []
    for extension in global_fields.get("core:extensions", []):
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
