"""SigMF recordings: a `.sigmf-meta` and a `.sigmf-data`, either of which names both.

Samples of all channels alternate: those of the receivers, at each instant. With our extension
`radar` (docs/sigmf-radar.md) a file says all; without it, its numbers are the chirps of the radar
that the user gives, one after the other.
"""

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents, shape_in
from dechirp.formats.arrays.encodings import LIMITS
from dechirp.formats.arrays.json_columns import unlisted
from dechirp.formats.arrays.on_disk import mapped
from dechirp.formats.arrays.sigmf_meta import (
    ARCHIVE,
    DATA,
    EXTENSION,
    META,
    Meta,
    pair_of,
    read_meta,
    tree_of,
)
from dechirp.formats.arrays.stored import Part, Stored, parsing
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.description import VERSION as DESCRIPTION_VERSION
from dechirp.formats.kept import kept
from dechirp.formats.settings.json_text import count, shown
from dechirp.formats.settings.receivers import with_receivers
from dechirp.formats.settings_for import settings_for

AXES = ("frame", "chirp", "sample", "rx")
_TAR_AT, _TAR = 257, b"ustar"
_BLOCK_BYTES = 2**20
_HASHED_BYTES = 2**27  # 0.2 s, of which half is reading
_NEED = "a SigMF recording"


@value
class Sigmf(Format):
    """SigMF: samples of the receivers in turn, one chirp after the other.

    Integers of b bits are full scale at 2^(b - 1); those without a sign have their zero there.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> Fit:
        """Tell by the metadata, in the file or beside it."""
        if not path.is_file() or not path.name.endswith((META, DATA, ARCHIVE)):
            return Fit.NO
        if path.name.endswith(ARCHIVE):
            return Fit.CONTAINER if _is_archive(path) else Fit.NO
        meta, _ = pair_of(path)
        if not meta.is_file():
            return Fit.NO
        try:
            said = tree_of(meta)["global"]
        except RecordingError:  # `read` says what is wrong with it
            return Fit.CONTAINER
        return Fit.OWN if f"{EXTENSION}:radar" in said else Fit.CONTAINER

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        if path.name.endswith(ARCHIVE):
            raise RecordingError(
                path,
                got="an archive of SigMF recordings",
                need=f"one recording: a {META} and its {DATA}",
                fix=f"Unpack it (tar -xf {path.name}), and name the {META} in it.",
            )
        meta = read_meta(path)
        is_told = told.axes or told.encoding
        held = _foreign(meta, told) if is_told or not meta.is_ours else _own(meta, told)
        return replace(held, findings=(*meta.findings, *_hashed(meta), *held.findings))


def _is_archive(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(_TAR_AT + len(_TAR))[_TAR_AT:] == _TAR


def _stored(meta: Meta, shape: tuple[int, ...]) -> Stored:
    """Numbers of a shape; both parts of floats in one."""
    if meta.dtype.kind == "f" and meta.is_complex:
        size = 2 * meta.dtype.itemsize
        return mapped(meta.data, np.dtype(f"{meta.dtype.str[0]}c{size}"), shape)
    return mapped(meta.data, meta.dtype, (*shape, 2) if meta.is_complex else shape)


def _own(meta: Meta, told: Told) -> Contents:
    """What a recording holds that has our extension."""
    said, file_bytes = meta.said, meta.data.stat().st_size
    names = ("n_frames", "n_chirps", "n_samples")
    sizes = [said.get(f"{EXTENSION}:{name}") for name in names]
    sample_bytes = meta.dtype.itemsize * (2 if meta.is_complex else 1)
    if not all(isinstance(size, int) and count(size) and size > 0 for size in sizes):
        raise _damaged(meta, f"of {', '.join(map(shown, sizes))} frames, chirps, samples", "counts")
    shape = (*(int(size) for size in sizes if size is not None), meta.n_channels)
    need = math.prod(shape) * sample_bytes
    if file_bytes != need:
        raise RecordingError(
            meta.data,
            got=f"of {file_bytes} bytes",
            need=f"of {need} bytes, as {meta.path.name} says",
            fix="Copy both files again from their source.",
        )
    with parsing(meta.path, _NEED):
        tables = said.get(f"{EXTENSION}:tables", {})
        text = json.dumps(
            {
                "dechirp_exchange": DESCRIPTION_VERSION,
                "radar": said[f"{EXTENSION}:radar"],
                "units": said.get(f"{EXTENSION}:units"),
                **{name: said.get(f"{EXTENSION}:{name}") for name in ("scale", "device", "iq")},
                "tables": {name: _about(table) for name, table in tables.items()},
            }
        )
        return kept(
            meta.path,
            text,
            _stored(meta, shape),
            told,
            columns=lambda table, column: unlisted(tables[table]["variables"][column]),
            gaps=_gaps(meta, shape),
            file_bytes=file_bytes,
            axes=AXES,
        )


def _about(table: dict[str, Any]) -> dict[str, Any]:
    """What is said of a table but its values, as `core.plain` says it of one with texts."""
    variables = {
        name: {
            "dims": of["dims"],
            "attrs": of["attrs"],
            "is_text": False,
            "is_coordinate": of["is_coordinate"],
        }
        for name, of in table["variables"].items()
    }
    return {"attrs": table["attrs"], "variables": variables}


def _gaps(meta: Meta, shape: tuple[int, ...]) -> np.ndarray | None:
    """(frame, chirp), which were lost: whole chirps, as annotations say."""
    n_frames, n_chirps, n_samples, _ = shape
    lost = np.zeros(n_frames * n_chirps, bool)
    for one in meta.annotations:
        if one.get(f"{EXTENSION}:lost") is not True:
            continue
        start, n_lost = one["core:sample_start"], one.get("core:sample_count")
        end = start + n_lost if isinstance(n_lost, int) else -1
        if not 0 <= start < end <= lost.size * n_samples or start % n_samples or end % n_samples:
            got = f"with samples from {start} to before {end} lost"
            raise _damaged(meta, got, f"whole chirps, of {n_samples} samples each")
        lost[start // n_samples : end // n_samples] = True
    return lost.reshape(n_frames, n_chirps) if lost.any() else None


def _foreign(meta: Meta, told: Told) -> Contents:
    """Chirps of the radar that the user gives, in numbers that say nothing of chirps."""
    settings = settings_for(meta.path, told)
    rate_hz, chirp = meta.sample_rate_hz, settings.radar.frame.chirp
    if rate_hz is not None and abs(chirp.sample_rate_hz / rate_hz - 1) > 1e-6:
        raise RecordingError(
            meta.path,
            got=f"sampled at {rate_hz:.6g} Hz",
            need=f"at {chirp.sample_rate_hz:.6g} Hz, as radar.frame.chirp.sample_rate says",
            fix="Correct the settings, or core:sample_rate.",
        )
    if told.axes is None:
        radar, added = with_receivers(settings.radar, meta.n_channels, file=meta.path)
        settings = replace(settings, radar=radar).with_findings(*added)
    file_bytes = meta.data.stat().st_size
    n_values, rest = divmod(file_bytes, meta.dtype.itemsize * (2 if meta.is_complex else 1))
    if rest or n_values % meta.n_channels or not n_values:
        raise RecordingError(
            meta.data,
            got=f"of {file_bytes} bytes",
            need=f"of whole samples of {meta.n_channels} channels, as {meta.path.name} says",
            fix="Copy both files again from their source.",
        )
    what = f"a file of {n_values} samples,"
    axes = told.axes or AXES
    shape, cut = shape_in(meta.data, axes, settings, n_values, what=what)
    stored = _stored(meta, shape)
    is_full_scale = meta.dtype.kind == "f" or told.encoding is not None
    meant = replace(
        told,
        settings=settings,
        axes=(*axes, "iq") if len(stored.shape) > len(axes) else axes,
        encoding=told.encoding if is_full_scale else "full-scale",
    )
    return contents(
        meta.path,
        stored if is_full_scale else _to_full_scale(stored),
        meant,
        file_bytes=file_bytes,
        findings=(*cut, *_lost(meta, math.prod(shape[axes[0] == "frame" :]))),
    )


def _lost(meta: Meta, per_frame: int) -> tuple[Finding, ...]:
    """Warn where samples of the stream are missing within a frame; `per_frame`: the numbers in one.

    `core:global_index` of a capture counts those that were dropped, too. Between frames a radar
    rests.
    """
    offset = meta.said.get("core:offset", 0)
    n_before, lost = 0, []
    for number, one in enumerate(meta.captures):
        start, index = one["core:sample_start"], one.get("core:global_index")
        n_dropped = index - start if count(index) else n_before
        place = start - offset if count(offset) else start
        if number and n_dropped != n_before and place * meta.n_channels % per_frame:
            lost.append((start, n_dropped - n_before))
        n_before = n_dropped
    if not lost:
        return ()
    (start, n_lost), n_places = lost[0], len(lost)
    return (
        Finding(
            level="warning",
            setting="core:global_index",
            got=f"samples missing within frames in {n_places} places, the first {n_lost} before"
            f" sample {start}",
            need="whole frames: all after a gap are cut in the wrong places",
            fix="Cut the recording at its gaps, and read each part by itself.",
        ),
    )


def _to_full_scale(stored: Stored) -> Stored:
    """Integers of any size at full scale 1."""
    half = np.float32(2.0 ** (8 * stored.dtype.itemsize - 1))
    zero = np.float32(half if stored.dtype.kind == "u" else 0)

    def read(part: Part) -> np.ndarray:
        return (stored.read(part).astype(np.float32) - zero) / half

    return replace(stored, dtype=np.dtype(np.float32), read=read)


def _hashed(meta: Meta) -> tuple[Finding, ...]:
    """Say where the numbers are not those whose sum the metadata has, or were not compared."""
    if meta.sha512 is None:
        return ()
    n_bytes = meta.data.stat().st_size
    if n_bytes > _HASHED_BYTES:
        return (
            Finding(
                level="note",
                setting="core:sha512",
                got=f"not compared: {meta.data.name} has {n_bytes} bytes",
                need=f"at most {_HASHED_BYTES} bytes to be compared each time it is opened",
                fix=f"Compare it once with sha512sum {meta.data.name}.",
            ),
        )
    made = hashlib.sha512()
    with meta.data.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            made.update(block)
    if made.hexdigest() == meta.sha512:
        return ()
    return (
        Finding(
            level="warning",
            setting="core:sha512",
            got=f"not that of {meta.data.name}: it was changed or damaged since it was written",
            need="the samples that were recorded",
            fix="Copy both files again from their source.",
        ),
    )


def _damaged(meta: Meta, got: str, need: str) -> RecordingError:
    return RecordingError(meta.path, got=got, need=need, fix="Copy it again from its source.")
