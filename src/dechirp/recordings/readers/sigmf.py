"""SigMF recordings: a pair of `.sigmf-meta` and `.sigmf-data`, or both in an archive, `.sigmf`.

Either file of a pair names the recording. An archive is read in place, without unpacking it.

Samples of all channels alternate: those of the receivers at each instant. With the extension
`radar` (docs/sigmf-radar.md) a recording is complete; without it, its numbers are the consecutive
chirps of the radar that the user gives.
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
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.encodings import LIMITS, scale_lazily_to_full_scale
from dechirp.recordings.arrays.json_columns import column_from_json
from dechirp.recordings.arrays.lazy_array import LazyArray, convert_parser_errors
from dechirp.recordings.arrays.lazy_files import open_memory_mapped_array
from dechirp.recordings.arrays.named_axes import (
    infer_shape_and_findings,
    interpret_array_as_recording,
)
from dechirp.recordings.arrays.sigmf_meta import (
    ARCHIVE,
    DATA,
    EXTENSION,
    META,
    SigmfMetadata,
    is_tar_archive,
    meta_and_data_paths,
    read_metadata,
)
from dechirp.recordings.description import VERSION as DESCRIPTION_VERSION
from dechirp.recordings.native import read_native_contents
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.settings.antenna_positions import fit_array_to_receiver_count
from dechirp.recordings.settings.json_text import format_json_excerpt, is_integer
from dechirp.recordings.settings_lookup import find_recording_settings

AXES = ("frame", "chirp", "sample", "rx")
_BLOCK_BYTES = 2**20
_HASHED_BYTES = 2**27  # 0.2 s, half of it for reading
_EXPECTED = "a SigMF recording"


@frozen_dataclass
class Sigmf(Format):
    """SigMF: samples with alternating receivers, one chirp after the other.

    Integers of b bits have their full scale at 2^(b - 1); unsigned ones have their zero there.
    Needs the extra `io`.
    """

    options: ClassVar[tuple[str, ...]] = ("axes", "encoding", "iq")
    encodings: ClassVar[tuple[str, ...]] = tuple(LIMITS)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file() or not path.name.endswith((META, DATA, ARCHIVE)):
            return MatchQuality.NO
        is_archive = path.name.endswith(ARCHIVE)
        meta = path if is_archive else meta_and_data_paths(path)[0]
        if not (is_tar_archive(path) if is_archive else meta.is_file()):
            return MatchQuality.NO
        try:
            is_native = read_metadata(path).has_dechirp_radar
        except RecordingError:  # `read` reports the damage
            return MatchQuality.CONTAINER
        return MatchQuality.SELF_DESCRIBING if is_native else MatchQuality.CONTAINER

    def leading_file(self, path: Path, hints: RecordingHints) -> Path:
        return path if path.name.endswith(ARCHIVE) else meta_and_data_paths(path)[0]

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        meta = read_metadata(path)
        is_layout_given = hints.axes or hints.encoding
        contents = (
            _read_foreign_recording(meta, hints)
            if is_layout_given or not meta.has_dechirp_radar
            else _read_native_recording(meta, hints)
        )
        return replace(
            contents,
            findings=(*meta.findings, *_checksum_mismatch_findings(meta), *contents.findings),
        )


def _open_lazy_samples(meta: SigmfMetadata, shape: tuple[int, ...]) -> LazyArray:
    """Open the data file with a shape; both parts of complex floats as one number."""
    if meta.dtype.kind == "f" and meta.is_complex:
        size = 2 * meta.dtype.itemsize
        dtype = np.dtype(f"{meta.dtype.str[0]}c{size}")
    else:
        dtype, shape = meta.dtype, (*shape, 2) if meta.is_complex else shape
    return open_memory_mapped_array(meta.data, dtype, shape, offset=meta.data_offset)


def _read_native_recording(meta: SigmfMetadata, hints: RecordingHints) -> Contents:
    """Read a recording with the extension `radar`."""
    fields, file_bytes = meta.global_fields, meta.data_bytes
    names = ("n_frames", "n_chirps", "n_samples")
    sizes = [fields.get(f"{EXTENSION}:{name}") for name in names]
    sample_bytes = meta.dtype.itemsize * (2 if meta.is_complex else 1)
    if not all(isinstance(size, int) and is_integer(size) and size > 0 for size in sizes):
        raise _damaged_metadata_error(
            meta,
            f"of {', '.join(map(format_json_excerpt, sizes))} frames, chirps, samples",
            "counts",
        )
    shape = (*(int(size) for size in sizes if size is not None), meta.n_channels)
    expected_bytes = math.prod(shape) * sample_bytes
    if file_bytes != expected_bytes:
        raise RecordingError(
            meta.data,
            value=f"{file_bytes} bytes",
            expected=f"{expected_bytes} bytes, from {meta.path.name}",
            fix="copy the recording again from its source",
        )
    with convert_parser_errors(meta.path, _EXPECTED):
        tables = fields.get(f"{EXTENSION}:tables", {})
        text = json.dumps(
            {
                "dechirp_exchange": DESCRIPTION_VERSION,
                "radar": fields[f"{EXTENSION}:radar"],
                "units": fields.get(f"{EXTENSION}:units"),
                **{name: fields.get(f"{EXTENSION}:{name}") for name in ("scale", "device", "iq")},
                "tables": {
                    name: _table_structure_without_values(table) for name, table in tables.items()
                },
            }
        )
        return read_native_contents(
            meta.path,
            text,
            _open_lazy_samples(meta, shape),
            hints,
            read_column=lambda table, column: column_from_json(tables[table]["variables"][column]),
            gaps=_lost_chirp_mask(meta, shape),
            file_bytes=file_bytes,
            axes=AXES,
        )


def _table_structure_without_values(table: dict[str, Any]) -> dict[str, Any]:
    """Return the description of a table, without values, in the form of `core.dataset_arrays`."""
    variables = {
        name: {
            "dims": variable["dims"],
            "attrs": variable["attrs"],
            "is_text": False,
            "is_coordinate": variable["is_coordinate"],
        }
        for name, variable in table["variables"].items()
    }
    return {"attrs": table["attrs"], "variables": variables}


def _lost_chirp_mask(meta: SigmfMetadata, shape: tuple[int, ...]) -> np.ndarray | None:
    """Return (frame, chirp), True where annotations mark a chirp as lost; None without losses."""
    n_frames, n_chirps, n_samples, _ = shape
    is_lost = np.zeros(n_frames * n_chirps, bool)
    for annotation in meta.annotations:
        if annotation.get(f"{EXTENSION}:lost") is not True:
            continue
        start, n_lost = annotation["core:sample_start"], annotation.get("core:sample_count")
        end = start + n_lost if isinstance(n_lost, int) else -1
        if not 0 <= start < end <= is_lost.size * n_samples or start % n_samples or end % n_samples:
            description = f"with samples from {start} to before {end} lost"
            raise _damaged_metadata_error(
                meta, description, f"whole chirps, of {n_samples} samples each"
            )
        is_lost[start // n_samples : end // n_samples] = True
    return is_lost.reshape(n_frames, n_chirps) if is_lost.any() else None


def _read_foreign_recording(meta: SigmfMetadata, hints: RecordingHints) -> Contents:
    """Read consecutive numbers as the chirps of the radar that the user gives."""
    settings = find_recording_settings(meta.path, hints)
    rate_hz, chirp = meta.sample_rate_hz, settings.radar.frame.chirp
    if rate_hz is not None and abs(chirp.sample_rate_hz / rate_hz - 1) > 1e-6:
        raise RecordingError(
            meta.path,
            value=f"sample rate {format_si(rate_hz, 'hz')}",
            expected=f"{format_si(chirp.sample_rate_hz, 'hz')}, the radar.frame.chirp.sample_rate",
            fix="correct the settings, or core:sample_rate",
        )
    if hints.axes is None:
        radar, receiver_findings = fit_array_to_receiver_count(
            settings.radar, meta.n_channels, file=meta.path
        )
        settings = replace(settings, radar=radar).with_findings(*receiver_findings)
    file_bytes = meta.data_bytes
    n_values, rest = divmod(file_bytes, meta.dtype.itemsize * (2 if meta.is_complex else 1))
    if rest or n_values % meta.n_channels or not n_values:
        raise RecordingError(
            meta.data,
            value=f"{file_bytes} bytes",
            expected=f"complete samples of {meta.n_channels} channels, from {meta.path.name}",
            fix="copy the recording again from its source",
        )
    description = f"a file of {n_values} samples,"
    axes = hints.axes or AXES
    shape, cut_findings = infer_shape_and_findings(
        meta.data, axes, settings, n_values, description=description
    )
    samples = _open_lazy_samples(meta, shape)
    is_full_scale = meta.dtype.kind == "f" or hints.encoding is not None
    complete_hints = replace(
        hints,
        settings=settings,
        axes=(*axes, "iq") if len(samples.shape) > len(axes) else axes,
        encoding=hints.encoding if is_full_scale else "full-scale",
    )
    return interpret_array_as_recording(
        meta.path,
        samples if is_full_scale else scale_lazily_to_full_scale(samples),
        complete_hints,
        file_bytes=file_bytes,
        findings=(
            *cut_findings,
            *_missing_samples_warning(meta, math.prod(shape[axes[0] == "frame" :])),
        ),
    )


def _missing_samples_warning(meta: SigmfMetadata, numbers_per_frame: int) -> tuple[Finding, ...]:
    """Warn about samples that are missing within a frame of `numbers_per_frame` numbers.

    `core:global_index` of a capture also counts dropped samples. Gaps between frames are normal.
    """
    offset = meta.global_fields.get("core:offset", 0)
    n_before, gaps = 0, []
    for number, capture in enumerate(meta.captures):
        start, index = capture["core:sample_start"], capture.get("core:global_index")
        n_dropped = index - start if is_integer(index) else n_before
        sample_index = start - offset if is_integer(offset) else start
        if number and n_dropped != n_before and sample_index * meta.n_channels % numbers_per_frame:
            gaps.append((start, n_dropped - n_before))
        n_before = n_dropped
    if not gaps:
        return ()
    (start, n_lost), n_gaps = gaps[0], len(gaps)
    return (
        Finding(
            level="warning",
            setting="core:global_index",
            value=f"samples missing within frames in {n_gaps} places, the first {n_lost} before"
            f" sample {start}",
            expected="complete frames: those after a gap begin at a wrong sample",
            fix="cut the recording at its gaps and open each part",
        ),
    )


def _checksum_mismatch_findings(meta: SigmfMetadata) -> tuple[Finding, ...]:
    """Compare the data file with its SHA-512, and report a difference or a file too large."""
    if meta.sha512 is None:
        return ()
    n_bytes = meta.data_bytes
    if n_bytes > _HASHED_BYTES:
        return (
            Finding(
                level="note",
                setting="core:sha512",
                value=f"not compared: {meta.data.name} has {n_bytes} bytes",
                expected=f"at most {_HASHED_BYTES} bytes to be compared each time it is opened",
                fix=f"compare it once: {_checksum_command(meta)}",
            ),
        )
    checksum = hashlib.sha512()
    with meta.data.open("rb") as file:
        file.seek(meta.data_offset)
        for start in range(0, n_bytes, _BLOCK_BYTES):
            checksum.update(file.read(min(_BLOCK_BYTES, n_bytes - start)))
    if checksum.hexdigest() == meta.sha512:
        return ()
    return (
        Finding(
            level="warning",
            setting="core:sha512",
            value=f"not the checksum of {meta.data.name}, which was changed or damaged",
            expected="the samples that were recorded",
            fix="copy the recording again from its source",
        ),
    )


def _checksum_command(meta: SigmfMetadata) -> str:
    """Return the shell command that prints the checksum of the samples."""
    name = meta.data.name
    if name.endswith(ARCHIVE):
        return f"tar -xOf {name} --wildcards '*{DATA}' | sha512sum"
    return f"sha512sum {name}"


def _damaged_metadata_error(meta: SigmfMetadata, value: str, expected: str) -> RecordingError:
    """Return the error of damaged metadata."""
    return RecordingError(
        meta.path, value=value, expected=expected, fix="copy it again from its source"
    )
