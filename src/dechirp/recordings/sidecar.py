"""Sidecar file with the metadata of a raw capture, `x.dechirp.json`.

It contains the description of native containers as a JSON object, with further keys: `layout`, the
word layout of `x.bin`; `columns` of the tables; `gap`, the lost chirps; and `findings` of the
writer. Other tools can ignore it.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.recordings.arrays.json_columns import column_from_json, column_to_json
from dechirp.recordings.arrays.lazy_array import convert_parser_errors
from dechirp.recordings.description import Description, parse_description, read_described_tables
from dechirp.recordings.native import lost_chirp_mask
from dechirp.recordings.readers.base import IQ_ORDERS, Contents
from dechirp.recordings.samples.layouts import N_LANES
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.settings.mmwave_setup import is_file_not_linked_outside_folder

MAX_SIDECAR_BYTES = 2**25
"""Largest size of a sidecar, in which objects and lists take 100 bytes, other values 12."""
SAMPLES_SUFFIX = ".bin"
"""Suffix of the file of samples."""
_MAX_BRACKETS = 2**18
_MARK = b'"dechirp_exchange"'
_LANES = (2, N_LANES)
_EXPECTED = "the metadata that dechirp wrote next to the samples"


@frozen_dataclass
class WordLayout:
    """Layout of the words of the samples: int16, each a converter code."""

    device: str | None
    """Kind of the chip with this layout, as `radar.devices` calls it."""
    lanes: int
    """2: one receiver after the other; 4: interleaved."""
    receivers: tuple[int, ...]
    """Lane of each interleaved receiver."""
    iq: Iq | None
    """Order of the parts of a complex sample; None: real samples."""
    n_frames: int


@frozen_dataclass
class Sidecar:
    """Metadata of a file of samples."""

    path: Path
    description: Description
    scale: float
    """Size of one code step."""
    layout: WordLayout
    gaps: np.ndarray | None
    tables: Mapping[str, xr.Dataset]
    findings: tuple[Finding, ...]

    @property
    def settings(self) -> RecordingSettings:
        """Radar and layout, as those of a vendor's file."""
        return RecordingSettings(
            radar=self.description.radar,
            iq=self.layout.iq,
            n_frames=self.layout.n_frames,
            is_interleaved=self.layout.lanes == N_LANES,
            receivers=self.layout.receivers,
            device=self.layout.device,
        )

    def apply_to_raw_contents(self, raw_contents: Contents) -> Contents:
        """Add the metadata to the contents of the words at full scale 1.

        Raises
        ------
        RecordingError
            If the lost chirps do not match the frames.
        """
        assert raw_contents.decode is not None
        return replace(
            raw_contents,
            decode=_make_scaled_decoder(raw_contents.decode, self.scale * 2**15),
            decode_frames=None,
            units=self.description.units,
            # A truncated file has fewer frames.
            gaps=lost_chirp_mask(
                self.path,
                None if self.gaps is None else self.gaps[: raw_contents.n_frames],
                raw_contents,
            ),
            scale=self.scale,
            tables=self.tables,
            # The sidecar defines the order of I and Q, so findings about it are dropped.
            findings=tuple(finding for finding in raw_contents.findings if finding.setting != "iq")
            + self.findings,
        )


def sidecar_path(path: Path) -> Path:
    """Return the path of the sidecar of a file of samples; the file may not exist."""
    return path.with_suffix(".dechirp.json")


def has_sidecar(path: Path) -> bool:
    """Return True if a file of samples has a sidecar."""
    file = sidecar_path(path)
    # x.h5 and x.sigmf-data may lie beside x.bin.
    if path.suffix.lower() != SAMPLES_SUFFIX or not is_file_not_linked_outside_folder(file):
        return False
    with file.open("rb") as stream:
        return _MARK in stream.read(64)


def format_sidecar_json(
    description: Description,
    columns: Mapping[str, Mapping[str, np.ndarray]],
    layout: WordLayout,
    gaps: np.ndarray | None,
    findings: Sequence[Finding],
) -> str:
    """Return the text of the sidecar; `columns` as from `build_description_and_table_columns`."""
    fields = json.loads(description.json_text)  # its signature comes first
    fields["layout"] = asdict(layout)
    fields["findings"] = [asdict(finding) for finding in findings]
    fields["gap"] = None if gaps is None else column_to_json(gaps)
    fields["columns"] = {
        name: {column: column_to_json(values) for column, values in table.items()}
        for name, table in columns.items()
    }
    return json.dumps(fields) + "\n"


def read_sidecar(path: Path, radar: Radar | None = None) -> Sidecar:
    """Read the sidecar of a file of samples; `radar`, if given, replaces its radar.

    Raises
    ------
    RecordingError
        If it is damaged, too large, or of another version.
    """
    file = sidecar_path(path)
    text = _read_sidecar_text(file)
    with convert_parser_errors(file, _EXPECTED):
        parsed = json.loads(text)
        layout = _parse_word_layout(parsed["layout"])
        findings = tuple(_parse_finding(finding) for finding in parsed["findings"])
        gaps = None if parsed["gap"] is None else column_from_json(parsed["gap"]).astype(bool)
        if gaps is not None and (gaps.ndim != 2 or len(gaps) != layout.n_frames):
            raise ValueError(f"gap of {gaps.shape} chirps")
        description = parse_description(file, text, radar)
        tables = read_described_tables(
            file,
            description,
            lambda name, column: column_from_json(parsed["columns"][name][column]),
        )
    scale, n_rx = description.scale, description.radar.array.n_rx
    # Steps of float32 samples; beyond, their products would be nothing, or infinite.
    if scale is None or not 1e-30 < scale < 1e30:
        raise _damaged_sidecar_error(file, f"with steps of {scale}")
    if radar is None and len(layout.receivers) != n_rx:
        raise _damaged_sidecar_error(
            file, f"with {len(layout.receivers)} receivers, and {n_rx} in its array"
        )
    return Sidecar(
        path=file,
        description=description,
        scale=scale,
        layout=layout,
        gaps=gaps,
        tables=tables,
        findings=findings,
    )


def _make_scaled_decoder(
    decode: Callable[[int, np.ndarray], None], factor: float
) -> Callable[[int, np.ndarray], None]:
    def scaled(number: int, out: np.ndarray) -> None:
        decode(number, out)
        # Words over 2^15 are exact, so that this rounds once, as words times the scale would.
        out *= np.float32(factor)

    return scaled


def _read_sidecar_text(file: Path) -> str:
    with file.open("rb") as stream:
        content = stream.read(MAX_SIDECAR_BYTES + 1)
    if len(content) > MAX_SIDECAR_BYTES:
        raise _damaged_sidecar_error(file, f"longer than {MAX_SIDECAR_BYTES} bytes")
    n_brackets = content.count(b"[") + content.count(b"{")
    if n_brackets > _MAX_BRACKETS:
        raise _damaged_sidecar_error(file, f"with {n_brackets} objects and lists")
    return content.decode("utf-8", errors="replace")


def _parse_word_layout(fields: Mapping[str, Any]) -> WordLayout:
    layout = WordLayout(**{**fields, "receivers": tuple(fields["receivers"])})
    integers = [layout.lanes, layout.n_frames, *layout.receivers]
    if any(type(number) is not int for number in integers) or layout.iq not in (None, *IQ_ORDERS):
        raise ValueError("layout")
    if (
        layout.lanes not in _LANES
        or layout.n_frames < 1
        or not isinstance(layout.device, str | None)
    ):
        raise ValueError("layout")
    if not layout.receivers or not set(layout.receivers) <= set(range(N_LANES)):
        raise ValueError("receivers")
    return layout


def _parse_finding(fields: Mapping[str, Any]) -> Finding:
    finding = Finding(**fields)
    is_text = all(isinstance(field_value, str) for field_value in asdict(finding).values())
    if not is_text or finding.level not in ("note", "warning", "error"):
        raise ValueError("findings")
    return finding


def _damaged_sidecar_error(file: Path, value: str) -> RecordingError:
    return RecordingError(
        file,
        value=value,
        expected=_EXPECTED,
        fix="copy it again from its source, or move it away and give the radar",
    )
