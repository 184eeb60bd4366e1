"""The text of a SigMF recording (`.sigmf-meta`): what its numbers are, and where they lie.

SigMF, Signal Metadata Format specification, version 1.2.6.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import must_stay_in
from dechirp.formats.settings.json_text import count, number, shown

META, DATA, ARCHIVE = ".sigmf-meta", ".sigmf-data", ".sigmf"
EXTENSION, VERSION = "radar", "1.0.0"
"""Ours: docs/sigmf-radar.md."""
_SERIES = "1."  # of versions that say the same with the same names
LONGEST = 2**24
"""Bytes of a text: in memory at most 20 times as many, besides 100 for each object and list."""
_MOST_BRACKETS = 2**18
_MOST_CHANNELS = 4096  # more than any radar has, and positions would be made up for each
_DATATYPE = re.compile(r"([cr])([fiu])(8|16|32|64)(?:_(le|be))?")


@value
class Meta:
    """What a metadata file says."""

    path: Path
    """The metadata file."""
    data: Path
    """The file of its numbers."""
    dtype: np.dtype
    """Of one number."""
    is_complex: bool
    """Whether two numbers make a sample."""
    n_channels: int
    sample_rate_hz: float | None
    sha512: str | None
    said: dict[str, Any]
    """Its object `global`."""
    captures: list[dict[str, Any]]
    annotations: list[dict[str, Any]]
    findings: tuple[Finding, ...]

    @property
    def is_ours(self) -> bool:
        """Whether it has the radar, as `exchange` writes it."""
        return f"{EXTENSION}:radar" in self.said


def pair_of(path: Path) -> tuple[Path, Path]:
    """Metadata file and data file of a recording, of which any is named, or neither ending."""
    stem = path.name
    for ending in (META, DATA):
        stem = stem.removesuffix(ending)
    return path.with_name(stem + META), path.with_name(stem + DATA)


def tree_of(path: Path) -> dict[str, Any]:
    """The JSON object of a metadata file.

    Raises
    ------
    RecordingError
        If it is none, or too long.
    """
    with path.open("rb") as file:
        content = file.read(LONGEST + 1)
    if len(content) > LONGEST:
        raise _refused(path, f"longer than {LONGEST} bytes", "a metadata file of at most that")
    if content.count(b"{") + content.count(b"[") > _MOST_BRACKETS:
        raise _refused(path, "with too many objects and lists", f"at most {_MOST_BRACKETS}")
    try:
        tree = json.loads(content)
    except RecursionError:
        raise _refused(path, "nested too deeply", "the JSON of SigMF") from None
    except ValueError as error:
        raise _refused(path, f"not JSON ({error})", "the JSON of SigMF") from None
    said = tree.get("global") if isinstance(tree, dict) else None
    if not isinstance(said, dict) or "core:datatype" not in said:
        raise _refused(path, "without global and its core:datatype", "the metadata of SigMF")
    return tree


def read_meta(path: Path) -> Meta:
    """Metadata of a recording, of which either file is named.

    Raises
    ------
    RecordingError
        If it is damaged, or needs what is not known here.
    """
    meta, data = pair_of(path)
    other = data if path == meta else meta
    if not other.is_file():
        raise _refused(path, f"without {other.name} beside it", f"a pair of {META} and {DATA}")
    must_stay_in(path.parent, other)
    tree = tree_of(meta)
    said: dict[str, Any] = tree["global"]
    _must_conform(meta, data, said)
    dtype, is_complex = _numbers(meta, said["core:datatype"])
    n_channels, rate_hz = said.get("core:num_channels", 1), said.get("core:sample_rate")
    if not count(n_channels) or not 1 <= n_channels <= _MOST_CHANNELS:
        got = f"with core:num_channels {shown(n_channels)}"
        raise _refused(meta, got, f"a count of at most {_MOST_CHANNELS}")
    if rate_hz is not None and not (number(rate_hz) and rate_hz > 0):
        raise _refused(meta, f"with core:sample_rate {shown(rate_hz)}", "samples per second")
    sha512 = said.get("core:sha512")
    captures = _objects(meta, tree, "captures")
    if any(one.get("core:header_bytes") for one in captures):
        raise _not_conforming(meta, "core:header_bytes")
    return Meta(
        path=meta,
        data=data,
        dtype=dtype,
        is_complex=is_complex,
        n_channels=n_channels,
        sample_rate_hz=None if rate_hz is None else float(rate_hz),
        sha512=sha512.lower() if isinstance(sha512, str) else None,
        said=said,
        captures=captures,
        annotations=_objects(meta, tree, "annotations"),
        findings=_extensions(meta, said),
    )


def _objects(path: Path, tree: dict[str, Any], name: str) -> list[dict[str, Any]]:
    """Segments of captures or annotations: objects with a whole `core:sample_start`."""
    made = tree.get(name, [])
    is_whole = isinstance(made, list) and all(
        isinstance(one, dict) and count(one.get("core:sample_start")) for one in made
    )
    if not is_whole:
        raise _refused(
            path, f"with {name} that are no list of segments", "a core:sample_start in each"
        )
    return made


def _must_conform(meta: Path, data: Path, said: dict[str, Any]) -> None:
    """Raise `RecordingError` where the numbers are anything but one block in the file beside it."""
    if said.get("core:dataset", data.name) != data.name:
        raise _not_conforming(meta, "core:dataset")
    for name in ("core:trailing_bytes", "core:metadata_only"):
        if said.get(name):
            raise _not_conforming(meta, name)


def _not_conforming(meta: Path, name: str) -> RecordingError:
    return _refused(
        meta,
        f"with {name}: its numbers lie in another file, or have others around them",
        f"all of its numbers, and nothing else, in the {DATA} of its name",
        fix="Convert it to a conforming SigMF recording.",
    )


def _numbers(path: Path, datatype: Any) -> tuple[np.dtype, bool]:
    """Type of a number, and whether two make a sample."""
    parts = _DATATYPE.fullmatch(datatype) if isinstance(datatype, str) else None
    if parts is not None:
        shape, kind, bits, order = parts.groups()
        if (bits == "8") == (order is None) and kind + bits not in ("f8", "f16", "i64", "u64"):
            code = f"{'>' if order == 'be' else '<'}{kind}{int(bits) // 8}"
            return np.dtype(code), shape == "c"
    raise _refused(
        path,
        f"with core:datatype {shown(datatype)}",
        "one of SigMF: c or r, then f32, f64, i8, i16, i32, u8, u16 or u32, then _le or _be where"
        " numbers have several bytes",
    )


def _extensions(path: Path, said: dict[str, Any]) -> tuple[Finding, ...]:
    """Say which extensions are passed over.

    Raises
    ------
    RecordingError
        If one of them is needed to read it.
    """
    listed = said.get("core:extensions", [])
    is_whole = isinstance(listed, list) and all(
        isinstance(one, dict) and isinstance(one.get("name"), str) for one in listed
    )
    if not is_whole:
        raise _refused(path, "with core:extensions that are no list of names", "the JSON of SigMF")
    passed = []
    for one in listed:
        name, version = one["name"], one.get("version")
        if name == EXTENSION and f"{EXTENSION}:radar" in said:
            if not str(version).startswith(_SERIES):
                raise _refused(
                    path,
                    f"with the extension {EXTENSION} of version {shown(version)}",
                    f"of version {VERSION}",
                    fix="Read it with the version of dechirp that wrote it.",
                )
        elif one.get("optional") is True:
            passed.append(name)
        else:
            raise _refused(
                path,
                f"with the extension {shown(name)}, which it says is not optional",
                f"no extension but {EXTENSION} that is needed to read it",
                fix="Convert it with a program that knows the extension.",
            )
    if not passed:
        return ()
    return (
        Finding(
            level="note",
            setting="core:extensions",
            got=f"{', '.join(shown(name) for name in passed)}: what is said with it is passed over",
            need="nothing: they are optional",
            fix="Look whether they say anything of the samples.",
        ),
    )


def _refused(
    path: Path, got: str, need: str, *, fix: str = "Copy it again from its source."
) -> RecordingError:
    return RecordingError(path, got=got, need=need, fix=fix)
