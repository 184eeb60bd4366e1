"""TI cascade captures (MMWCAS): four chips, each with its own files of samples and of frames.

`master_0000_data.bin` and `master_0000_idx.bin`, and so for slave1 to slave3; `_0001_` and on
where a capture went on. Samples are int16, (frame, chirp in the order sent, sample, rx of the
chip, I and Q). The receivers of the cube are those of master, slave1, slave2, slave3, in the
order of `radar.devices.cascade`.

Not verified on a real capture: after TI's description of its own reader, and mmwave-repack.
"""

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told, must_stay_in
from dechirp.formats.samples.bare import bare_contents
from dechirp.formats.samples.layouts import N_LANES, Pairs
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.bytes_in import files_in

CHIPS = ("master", "slave1", "slave2", "slave3")
"""Chips in the order of their receivers in the cube. Two tools disagree on which slave is
which device; this is TI's order."""

_NAME = re.compile(r"(master|slave[123])_(\d{4})_(data|idx)\.bin")
_HEADER_BYTES, _ENTRY_BYTES = 24, 48


@value
class TiCascade(Format):
    """TI cascade captures (MMWCAS): four chips, each with its files.

    The folder of a capture, or one of its files.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by the master's file of frames, whose size must be what its head says."""
        index = _folder(path) / "master_0000_idx.bin"
        if path.is_file() and not _NAME.fullmatch(path.name):
            return Fit.NO
        return Fit.CONTAINER if index.is_file() and _n_frames(index) is not None else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        folder = _folder(path)
        settings = settings_for(folder / "master_0000_data.bin", told)
        n_rx = settings.radar.array.n_rx
        if n_rx != N_LANES * len(CHIPS):
            raise RecordingError(
                path,
                got="a capture of four chips with four receivers each",
                need=f"of {n_rx} receivers, as radar.array.rx says",
                fix="Give the settings of the capture, with --device cascade.",
            )
        chips: list[Contents] = []
        for number in range(len(CHIPS)):
            chips.append(_chip(folder, number, settings, told))
            # One order for all: guessed chip by chip, noise could exchange the parts of one.
            told = replace(told, iq=chips[0].iq)
        n_frames = min(chip.n_frames for chip in chips)

        def decode(index: int, out: np.ndarray) -> None:
            for number, chip in enumerate(chips):
                if chip.decode is not None:
                    chip.decode(index, out[:, N_LANES * number : N_LANES * (number + 1)])

        findings = tuple(dict.fromkeys(finding for chip in chips for finding in chip.findings))
        # Frames of one chirp, merged into one, can be shorter than the settings say.
        shortest = min((chip.radar.frame for chip in chips if chip.radar), key=lambda f: f.n_sent)
        return Contents(
            radar=replace(settings.radar, frame=shortest),
            n_frames=n_frames,
            decode=decode,
            findings=findings + _uneven([chip.n_frames for chip in chips]),
            iq=chips[0].iq,
            scale=chips[0].scale,
            device=chips[0].device,
            settings_path=chips[0].settings_path,
        )


def _folder(path: Path) -> Path:
    return path if path.is_dir() else path.parent


def _chip(folder: Path, number: int, settings: Settings, told: Told) -> Contents:
    """Frames of one chip, with its four receivers alone."""
    radar, name = settings.radar, CHIPS[number]
    own = radar.array.rx_m[N_LANES * number : N_LANES * (number + 1)]
    alone = replace(settings, radar=replace(radar, array=replace(radar.array, rx_m=own)))
    data: list[Path] = []
    while (part := folder / f"{name}_{len(data):04}_data.bin").is_file():
        must_stay_in(folder, part)
        data.append(part)
    if not data:
        raise RecordingError(
            folder,
            got=f"a capture without {name}_0000_data.bin",
            need=f"files of {', '.join(CHIPS)}",
            fix="Copy the whole folder again.",
        )
    counted = [_n_frames(part.with_name(part.name.replace("data", "idx"))) for part in data]
    if None not in counted:
        told_frames = sum(count for count in counted if count is not None)
        alone = replace(alone, n_frames=told_frames)
    order = Pairs(receivers=tuple(range(N_LANES)), n_present=N_LANES)
    return bare_contents(data[0], files_in(*data), [order], alone, told)


def _n_frames(index: Path) -> int | None:
    """Frames that a file of frames lists; none: it is no such file."""
    if not index.is_file():
        return None
    with index.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES:
        return None
    _tag, _version, _flags, n_frames, _data_bytes = struct.unpack("<4IQ", head)
    expected = _HEADER_BYTES + n_frames * _ENTRY_BYTES
    return int(n_frames) if n_frames and index.stat().st_size == expected else None


def _uneven(n_frames: list[int]) -> tuple[Finding, ...]:
    if len(set(n_frames)) == 1:
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            got=", ".join(f"{n} frames of {c}" for n, c in zip(n_frames, CHIPS, strict=True)),
            need="the same number of frames of each chip",
            fix="The frames that all have are read; copy the folder again if there should be more.",
        ),
    )
