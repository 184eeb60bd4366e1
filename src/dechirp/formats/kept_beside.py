"""What bare samples cannot say of themselves: a file of ours beside them, `x.dechirp.json`.

It is the description that our containers hold, as one JSON object, with more keys: `layout`, how
the words of `x.bin` lie; `columns`, those of the tables; `gap`, which chirps were lost; and
`findings`, what the user should know of how it was written. Other tools need not know it.
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
from dechirp.core.values import value
from dechirp.formats.arrays.json_columns import listed, unlisted
from dechirp.formats.arrays.stored import parsing
from dechirp.formats.base import IQ_ORDERS, Contents
from dechirp.formats.description import Description, of_text, tables_of
from dechirp.formats.kept import lost_chirps
from dechirp.formats.samples.layouts import N_LANES
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings.mmwave_setup import lies_in_its_folder
from dechirp.radar.radar import Radar

MOST_BYTES = 2**25
"""Of such a file, of which objects and lists take 100 bytes, and all else 12 for each."""
SAMPLES = ".bin"
"""Ending of the file of samples."""
_MOST_BRACKETS = 2**18
_MARK = b'"dechirp_exchange"'
_LANES = (2, N_LANES)
_NEED = "what dechirp wrote beside the samples"


@value
class Layout:
    """How the words of the samples lie: int16, each a code of the converter."""

    device: str | None
    """Kind of the chip that writes so, as `radar.devices` calls it."""
    lanes: int
    """2: one receiver after the other; 4: in turn."""
    receivers: tuple[int, ...]
    """Lane of each receiver, of those in turn."""
    iq: Iq | None
    """Which part of a complex sample comes first; None: real samples."""
    n_frames: int


@value
class Kept:
    """What was kept beside the samples of a file."""

    path: Path
    description: Description
    scale: float
    """Size of one step of the codes."""
    layout: Layout
    gaps: np.ndarray | None
    tables: Mapping[str, xr.Dataset]
    findings: tuple[Finding, ...]

    @property
    def settings(self) -> Settings:
        """Radar and layout, as a vendor's file would say them."""
        return Settings(
            radar=self.description.radar,
            iq=self.layout.iq,
            n_frames=self.layout.n_frames,
            interleaved=self.layout.lanes == N_LANES,
            receivers=self.layout.receivers,
            device=self.layout.device,
        )

    def of(self, bare: Contents) -> Contents:
        """Contents of the words at full scale 1, with what was kept of them.

        Raises
        ------
        RecordingError
            If the lost chirps are those of other frames.
        """
        assert bare.decode is not None
        return replace(
            bare,
            decode=_times(bare.decode, self.scale * 2**15),
            units=self.description.units,
            # A file that was cut short has fewer frames.
            gaps=lost_chirps(
                self.path, None if self.gaps is None else self.gaps[: bare.n_frames], bare
            ),
            scale=self.scale,
            tables=self.tables,
            # The order of I and Q is known, wherever echoes lie: beyond half the rate, too.
            findings=tuple(one for one in bare.findings if one.setting != "iq") + self.findings,
        )


def beside(path: Path) -> Path:
    """Name of the file that belongs to one of samples, whether it is there or not."""
    return path.with_suffix(".dechirp.json")


def is_kept(path: Path) -> bool:
    """Whether such a file of ours lies beside one of samples."""
    file = beside(path)
    # x.h5 and x.sigmf-data may lie beside x.bin.
    if path.suffix.lower() != SAMPLES or not lies_in_its_folder(file):
        return False
    with file.open("rb") as opened:
        return _MARK in opened.read(64)


def kept_text(
    description: Description,
    columns: Mapping[str, Mapping[str, np.ndarray]],
    layout: Layout,
    gaps: np.ndarray | None,
    findings: Sequence[Finding],
) -> str:
    """Text of the file; `columns` of each table, as `description.described` gives them."""
    said = json.loads(description.text)  # its mark comes first
    said["layout"] = asdict(layout)
    said["findings"] = [asdict(finding) for finding in findings]
    said["gap"] = None if gaps is None else listed(gaps)
    said["columns"] = {
        name: {column: listed(values) for column, values in table.items()}
        for name, table in columns.items()
    }
    return json.dumps(said) + "\n"


def read_kept(path: Path, radar: Radar | None = None) -> Kept:
    """What was kept beside a file of samples; `radar`: one that the user gave instead.

    Raises
    ------
    RecordingError
        If it is damaged, too large, or of another version.
    """
    file = beside(path)
    text = _text(file)
    with parsing(file, _NEED):
        said = json.loads(text)
        layout = _layout(said["layout"])
        findings = tuple(_finding(one) for one in said["findings"])
        gaps = None if said["gap"] is None else unlisted(said["gap"]).astype(bool)
        if gaps is not None and (gaps.ndim != 2 or len(gaps) != layout.n_frames):
            raise ValueError(f"gap of {gaps.shape} chirps")
        description = of_text(file, text, radar)
        tables = tables_of(
            file, description, lambda name, column: unlisted(said["columns"][name][column])
        )
    scale, n_rx = description.scale, description.radar.array.n_rx
    # Steps of float32 samples; beyond, their products would be nothing, or infinite.
    if scale is None or not 1e-30 < scale < 1e30:
        raise _damaged(file, f"with steps of {scale}")
    if radar is None and len(layout.receivers) != n_rx:
        raise _damaged(file, f"with {len(layout.receivers)} receivers, and {n_rx} in its array")
    return Kept(
        path=file,
        description=description,
        scale=scale,
        layout=layout,
        gaps=gaps,
        tables=tables,
        findings=findings,
    )


def _times(
    decode: Callable[[int, np.ndarray], None], factor: float
) -> Callable[[int, np.ndarray], None]:
    def scaled(number: int, out: np.ndarray) -> None:
        decode(number, out)
        # Words over 2^15 are exact, so that this rounds once, as words times the scale would.
        out *= np.float32(factor)

    return scaled


def _text(file: Path) -> str:
    with file.open("rb") as opened:
        content = opened.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise _damaged(file, f"longer than {MOST_BYTES} bytes")
    n_brackets = content.count(b"[") + content.count(b"{")
    if n_brackets > _MOST_BRACKETS:
        raise _damaged(file, f"with {n_brackets} objects and lists")
    return content.decode("utf-8", errors="replace")


def _layout(said: Mapping[str, Any]) -> Layout:
    made = Layout(**{**said, "receivers": tuple(said["receivers"])})
    whole = [made.lanes, made.n_frames, *made.receivers]
    if any(type(one) is not int for one in whole) or made.iq not in (None, *IQ_ORDERS):
        raise ValueError("layout")
    if made.lanes not in _LANES or made.n_frames < 1 or not isinstance(made.device, str | None):
        raise ValueError("layout")
    if not made.receivers or not set(made.receivers) <= set(range(N_LANES)):
        raise ValueError("receivers")
    return made


def _finding(said: Mapping[str, Any]) -> Finding:
    made = Finding(**said)
    is_said = all(isinstance(one, str) for one in asdict(made).values())
    if not is_said or made.level not in ("note", "warning", "error"):
        raise ValueError("findings")
    return made


def _damaged(file: Path, got: str) -> RecordingError:
    return RecordingError(
        file,
        got=got,
        need=_NEED,
        fix="Copy it again from its source, or move it away and give the radar.",
    )
