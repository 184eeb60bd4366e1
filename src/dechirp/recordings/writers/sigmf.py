"""SigMF recordings: `x.sigmf-data`, and `x.sigmf-meta` with the extension `radar`.

The data contain all sampled chirps in order, with interleaved receivers: cf32_le or rf32_le, or
ci16_le or ri16_le for converter codes. docs/sigmf-radar.md describes the extension.

SigMF, Signal Metadata Format specification, version 1.2.6.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dechirp.core.atomic_files import atomic_files
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.recordings.arrays.json_columns import TYPES, column_to_json
from dechirp.recordings.arrays.sigmf_meta import (
    DATA,
    EXTENSION,
    MAX_BYTES,
    META,
    VERSION,
    meta_and_data_paths,
)
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.adc_samples import (
    iter_code_or_float_arrays,
    write_as_codes_else_floats,
)
from dechirp.recordings.writers.base import Progress, Writer
from dechirp.recordings.writers.description_text import (
    check_column_types,
    recording_description_and_columns,
)

_SIGMF_VERSION = "1.2.6"


@frozen_dataclass
class Sigmf(Writer):
    """SigMF: samples, and radar, lost chirps and tables in the extension `radar`."""

    suffixes: ClassVar[tuple[str, ...]] = (META, DATA)
    summary: ClassVar[str] = "samples, radar, gaps, tables of up to 16 MB"

    def check_recording(self, recording: Recording) -> None:
        recording.check_has_samples()
        recording_description_and_columns(recording, None)
        check_column_types(TYPES, recording.tables)
        n_bytes = len(_metadata_json(recording, recording.contents.scale, "0" * 128))
        if n_bytes > MAX_BYTES:
            raise _recording_error(
                f"a radar, frames and tables of {n_bytes} bytes as JSON",
                f"at most {MAX_BYTES}",
                "write an .h5 file, or fewer frames",
            )

    def output_files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        return meta_and_data_paths(out)

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        meta, data = meta_and_data_paths(out)

        def write_with(scale: float | None) -> None:
            with atomic_files(meta, data) as (temporary_meta, temporary_data):
                sha512 = _write_samples_and_hash(temporary_data, recording, scale, progress)
                temporary_meta.write_text(
                    _metadata_json(recording, scale, sha512), encoding="utf-8"
                )

        write_as_codes_else_floats(recording, write_with)
        return meta, data


def _write_samples_and_hash(
    data: Path, recording: Recording, scale: float | None, progress: Progress | None
) -> str:
    """Write the samples and return the checksum of their bytes."""
    checksum = hashlib.sha512()
    with data.open("wb") as file:
        for n_done, frame in enumerate(iter_code_or_float_arrays(recording, scale), start=1):
            little_endian = frame.dtype.newbyteorder("<")
            interleaved = np.ascontiguousarray(frame.swapaxes(1, 2), little_endian)
            block = interleaved.reshape(-1).view(np.uint8).data
            checksum.update(block)
            file.write(block)
            if progress is not None:
                progress(n_done, recording.n_frames)
    return checksum.hexdigest()


def _metadata_json(recording: Recording, scale: float | None, sha512: str) -> str:
    """Return the metadata as JSON."""
    radar, contents = recording.radar, recording.contents
    frame, chirp = radar.frame, radar.frame.chirp
    description = json.loads(recording_description_and_columns(recording, scale)[0].json_text)
    datatype = ("c" if chirp.sampling == "complex" else "r") + (
        "f32_le" if scale is None else "i16_le"
    )
    global_fields = {
        "core:datatype": datatype,
        "core:version": _SIGMF_VERSION,
        "core:sample_rate": chirp.sample_rate_hz,
        "core:num_channels": radar.array.n_rx,
        "core:sha512": sha512,
        "core:recorder": "dechirp",
        "core:extensions": [{"name": EXTENSION, "version": VERSION, "optional": True}],
        f"{EXTENSION}:radar": description["radar"],
        f"{EXTENSION}:units": contents.units,
        **({} if scale is None else {f"{EXTENSION}:scale": scale}),
        **{
            f"{EXTENSION}:{name}": description[name]
            for name in ("device", "iq")
            if description[name] is not None
        },
        f"{EXTENSION}:n_frames": recording.n_frames,
        f"{EXTENSION}:n_chirps": frame.n_chirps_total,
        f"{EXTENSION}:n_samples": chirp.n_samples,
        f"{EXTENSION}:tables": {
            name: _table_to_json(table, description["tables"][name])
            for name, table in recording.tables.items()
        },
    }
    if frame.n_intervals == 1:
        global_fields[f"{EXTENSION}:chirp_starts"] = frame.chirp_starts_s.tolist()
    captures = [_capture_segment(radar, number) for number in range(recording.n_frames)]
    metadata = {
        "global": global_fields,
        "captures": captures,
        "annotations": _lost_chirp_annotations(contents.gaps, chirp.n_samples),
    }
    try:
        return json.dumps(metadata, allow_nan=False)
    except ValueError as error:
        raise _recording_error(
            f"an attribute without a JSON form ({error})", "finite numbers", "leave it out"
        ) from None


def _capture_segment(radar: Radar, frame_number: int) -> dict[str, Any]:
    """Return the capture segment of a frame: first sample, start, and chirp times if they vary."""
    frame, chirp = radar.frame, radar.frame.chirp
    segment = {
        "core:sample_start": frame_number * frame.n_chirps_total * chirp.n_samples,
        "core:frequency": chirp.mid_window_frequency_hz,
        f"{EXTENSION}:start": frame.frame_start_s(frame_number),
    }
    if frame.n_intervals > 1:
        segment[f"{EXTENSION}:chirp_starts"] = frame.for_frame(frame_number).chirp_starts_s.tolist()
    return segment


def _table_to_json(table: Any, structure: dict[str, Any]) -> dict[str, Any]:
    """Return a table with its columns."""
    variables = {
        name: {
            "dims": column["dims"],
            "attrs": column["attrs"],
            "is_coordinate": column["is_coordinate"],
            **column_to_json(np.asarray(table.variables[name].values)),
        }
        for name, column in structure["variables"].items()
    }
    return {"attrs": structure["attrs"], "variables": variables}


def _lost_chirp_annotations(gaps: np.ndarray | None, n_samples: int) -> list[dict[str, Any]]:
    """Return an annotation for each run of lost chirps."""
    if gaps is None:
        return []
    steps = np.diff(gaps.reshape(-1).astype(np.int8), prepend=0, append=0)
    runs = zip(np.flatnonzero(steps > 0), np.flatnonzero(steps < 0), strict=True)
    return [
        {
            "core:sample_start": int(first) * n_samples,
            "core:sample_count": int(end - first) * n_samples,
            "core:label": "lost",
            f"{EXTENSION}:lost": True,
        }
        for first, end in runs
    ]


def _recording_error(value: str, expected: str, fix: str) -> DechirpError:
    return DechirpError(Mistake(setting="recording", value=value, expected=expected, fix=fix))
