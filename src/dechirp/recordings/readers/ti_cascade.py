"""TI cascade captures (MMWCAS): four chips, each with its own sample and index files.

`master_0000_data.bin` and `master_0000_idx.bin`, likewise for slave1 to slave3; `_0001_` and so on
continue a capture. Samples are int16, (frame, chirp in the order sent, sample, rx of the chip, I
and Q). The receivers of the cube are those of master, slave1, slave2, slave3, in the order of
`radar.devices.cascade`.

Not verified on a real capture; written from TI's description of its own reader and mmwave-repack.
"""

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    check_stays_in_folder,
)
from dechirp.recordings.samples.layouts import N_LANES, Pairs
from dechirp.recordings.samples.raw_samples import interpret_raw_samples
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings_lookup import find_recording_settings
from dechirp.recordings.streams.byte_sources import open_concatenated_files

CHIPS = ("master", "slave1", "slave2", "slave3")
"""Chips in the order of their receivers in the cube. Two tools disagree on which slave is which
device; this is the order of TI.
"""

_NAME = re.compile(r"(master|slave[123])_(\d{4})_(data|idx)\.bin")
_HEADER_BYTES, _ENTRY_BYTES = 24, 48


@frozen_dataclass
class TiCascade(Format):
    """TI cascade captures (MMWCAS): four chips, each with its files.

    The folder of a capture, or one of its files.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> MatchQuality:
        index = _capture_folder(path) / "master_0000_idx.bin"
        if path.is_file() and not _NAME.fullmatch(path.name):
            return MatchQuality.NO
        return (
            MatchQuality.CONTAINER
            if index.is_file() and _read_frame_count(index) is not None
            else MatchQuality.NO
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        folder = _capture_folder(path)
        settings = find_recording_settings(folder / "master_0000_data.bin", hints)
        n_rx = settings.radar.array.n_rx
        if n_rx != N_LANES * len(CHIPS):
            raise RecordingError(
                path,
                value="four chips with four receivers each",
                expected=f"{n_rx} receivers, as in radar.array.rx",
                fix="give the settings of the capture, with --device cascade",
            )
        chips: list[Contents] = []
        for number in range(len(CHIPS)):
            chips.append(_read_chip_frames(folder, number, settings, hints))
            # All chips share one order; guessed per chip, noise could swap I and Q of one of them.
            hints = replace(hints, iq=chips[0].iq)
        n_frames = min(chip.n_frames for chip in chips)

        def decode(index: int, out: np.ndarray) -> None:
            for number, chip in enumerate(chips):
                if chip.decode is not None:
                    chip.decode(index, out[:, N_LANES * number : N_LANES * (number + 1)])

        findings = tuple(dict.fromkeys(finding for chip in chips for finding in chip.findings))
        # Merged frames of one chirp can be shorter than in the settings.
        shortest = min(
            (chip.radar.frame for chip in chips if chip.radar), key=lambda f: f.n_chirps_total
        )
        return Contents(
            radar=replace(settings.radar, frame=shortest),
            n_frames=n_frames,
            decode=decode,
            findings=findings + _unequal_frame_counts_warning([chip.n_frames for chip in chips]),
            iq=chips[0].iq,
            scale=chips[0].scale,
            device=chips[0].device,
            settings_path=chips[0].settings_path,
        )


def _capture_folder(path: Path) -> Path:
    """Return the folder of a capture, given the folder or one of its files."""
    return path if path.is_dir() else path.parent


def _read_chip_frames(
    folder: Path, chip_number: int, settings: RecordingSettings, hints: RecordingHints
) -> Contents:
    """Read the frames of one chip, with its four receivers only."""
    radar, name = settings.radar, CHIPS[chip_number]
    rx_m = radar.array.rx_m[N_LANES * chip_number : N_LANES * (chip_number + 1)]
    chip_settings = replace(settings, radar=replace(radar, array=replace(radar.array, rx_m=rx_m)))
    data: list[Path] = []
    while (part := folder / f"{name}_{len(data):04}_data.bin").is_file():
        check_stays_in_folder(folder, part)
        data.append(part)
    if not data:
        raise RecordingError(
            folder,
            value=f"a capture without {name}_0000_data.bin",
            expected=f"files of {', '.join(CHIPS)}",
            fix="copy the whole folder again",
        )
    frame_counts = [
        _read_frame_count(part.with_name(part.name.replace("data", "idx"))) for part in data
    ]
    if None not in frame_counts:
        n_frames = sum(count for count in frame_counts if count is not None)
        chip_settings = replace(chip_settings, n_frames=n_frames)
    order = Pairs(receivers=tuple(range(N_LANES)), n_present=N_LANES)
    return interpret_raw_samples(
        data[0], open_concatenated_files(*data), [order], chip_settings, hints
    )


def _read_frame_count(index_file: Path) -> int | None:
    """Return the number of frames in an index file; None if it is not an index file."""
    if not index_file.is_file():
        return None
    with index_file.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES:
        return None
    _tag, _version, _flags, n_frames, _data_bytes = struct.unpack("<4IQ", head)
    expected = _HEADER_BYTES + n_frames * _ENTRY_BYTES
    return int(n_frames) if n_frames and index_file.stat().st_size == expected else None


def _unequal_frame_counts_warning(n_frames: list[int]) -> tuple[Finding, ...]:
    """Warn that the chips have different numbers of frames."""
    if len(set(n_frames)) == 1:
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            value=", ".join(f"{n} frames of {c}" for n, c in zip(n_frames, CHIPS, strict=True)),
            expected="the same number of frames of each chip",
            fix="copy the folder again if frames are missing; the frames of all chips are read",
        ),
    )
