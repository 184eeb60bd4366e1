"""RADIal data set.

Four files `adc0` to `adc3`, one a chip, of raw int16: I and Q alternate; 512 samples, 4 receivers
and 256 chirps, the first axis fastest. Written from the documentation of the data set, not
verified on a real file.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import ArrayPart, LazyArray
from dechirp.recordings.arrays.lazy_files import open_memory_mapped_array
from dechirp.recordings.arrays.named_axes import (
    check_even_byte_count,
    infer_shape_and_findings,
    interpret_array_as_recording,
)
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    check_stays_in_folder,
)
from dechirp.recordings.settings_lookup import find_recording_settings

_AXES = ("frame", "chirp", "rx", "sample", "iq")
_N_CHIPS = 4
_RX_AXIS = _AXES.index("rx")
_RX_PER_CHIP = 4
_NAME = re.compile(r"(.*adc)([0-3])(\.\w+)?")


@frozen_dataclass
class Radial(Format):
    """RADIal data set, four files a frame.

    The folder of the four files, or one of them.

    All twelve transmitters send at once, each with its own Doppler shift (DDM). They are not
    separated: the recording is read as one transmitter and sixteen receivers.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)
    must_be_named: ClassVar[bool] = True
    experimental: ClassVar[bool] = True

    def recognise(self, path: Path) -> MatchQuality:
        return MatchQuality.POSSIBLE if _find_chip_files(path) else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        files = _find_chip_files(path)
        sizes = {file.stat().st_size for file in files}
        if len(sizes) != 1:
            raise RecordingError(
                path,
                value=f"files of {', '.join(map(str, sorted(sizes))) or 'no'} bytes",
                expected=f"{_N_CHIPS} files adc0 to adc3 of one size",
                fix="copy all of them again from their source",
            )
        (n_bytes,) = sizes
        for file in files:
            check_stays_in_folder(file.parent, file)
        check_even_byte_count(files[0], n_bytes)
        settings = find_recording_settings(files[0], hints)
        radar = settings.radar
        # The file of a chip is like a recording of that chip's receivers.
        rx_m = (radar.array.rx_m * _RX_PER_CHIP)[:_RX_PER_CHIP]
        chip_settings = replace(
            settings, radar=replace(radar, array=replace(radar.array, rx_m=rx_m))
        )
        description = f"files of {n_bytes} bytes (2 per number)"
        shape, findings = infer_shape_and_findings(
            path, _AXES, chip_settings, n_bytes // 2, description=description
        )
        samples = _concatenate_chips_along_receivers(
            [open_memory_mapped_array(file, np.dtype("<i2"), shape) for file in files]
        )
        complete_hints = replace(hints, settings=settings, axes=_AXES, encoding="int16")
        return interpret_array_as_recording(
            path,
            samples,
            complete_hints,
            file_bytes=_N_CHIPS * n_bytes,
            findings=(*findings, _unsupported_ddm_warning()),
        )


def _find_chip_files(path: Path) -> list[Path]:
    """Return the files of the four chips in order; an empty list if any is missing."""
    stem = _NAME.fullmatch(path.name)
    if path.is_file() and stem is None:
        return []
    folder = path if path.is_dir() else path.parent
    numbered_files = sorted(
        (name[2], file)
        for file in folder.iterdir()
        if (name := _NAME.fullmatch(file.name))
        and file.is_file()
        and (path.is_dir() or (stem and name[1] == stem[1]))
    )
    return (
        [file for _, file in numbered_files]
        if [chip for chip, _ in numbered_files] == [*"0123"]
        else []
    )


def _concatenate_chips_along_receivers(chips: list[LazyArray]) -> LazyArray:
    """Concatenate the arrays of the chips along the receivers."""

    def read(part: ArrayPart) -> np.ndarray:
        chip_part = (*part[:_RX_AXIS], slice(0, _RX_PER_CHIP), *part[_RX_AXIS + 1 :])
        return np.concatenate([chip.read(chip_part) for chip in chips], axis=_RX_AXIS)

    chip_shape = chips[0].shape
    shape = (*chip_shape[:_RX_AXIS], _N_CHIPS * _RX_PER_CHIP, *chip_shape[_RX_AXIS + 1 :])
    return LazyArray(shape=shape, dtype=chips[0].dtype, read=read)


def _unsupported_ddm_warning() -> Finding:
    return Finding(
        level="warning",
        setting="radar.frame.multiplexing",
        value="none: 12 simultaneous transmitters are read as one",
        expected="separation by Doppler (DDM), which this reader does not do",
        fix="use ranges only: every target appears 12 times along velocity",
    )
