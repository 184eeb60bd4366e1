"""RADIal (not verified on a real file).

Four files `adc0` to `adc3`, one a chip, of bare int16: I and Q alternate; 512 samples, 4
receivers and 256 chirps, the first running fastest, as its documentation says.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.arrays.axes import contents, must_be_words, shape_in
from dechirp.formats.arrays.on_disk import mapped
from dechirp.formats.arrays.stored import Part, Stored
from dechirp.formats.arrays.unverified import unverified
from dechirp.formats.base import Contents, Fit, Format, Told, must_stay_in
from dechirp.formats.settings_for import settings_for

_AXES = ("frame", "chirp", "rx", "sample", "iq")
_N_CHIPS = 4
_RX_AXIS = _AXES.index("rx")
_RX_PER_CHIP = 4
_NAME = re.compile(r"(.*adc)([0-3])(\.\w+)?")


@value
class Radial(Format):
    """RADIal data set, four files a frame (not verified on a real file).

    The folder of the four files, or one of them.

    The twelve transmitters send at once, each with its own Doppler shift (DDM). They are not
    separated: what is read is one transmitter and sixteen receivers.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)
    only_told: ClassVar[bool] = True

    def recognise(self, path: Path) -> Fit:
        """Tell by the names of the files."""
        return Fit.POSSIBLE if _files(path) else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        files = _files(path)
        sizes = {file.stat().st_size for file in files}
        if len(sizes) != 1:
            raise RecordingError(
                path,
                got=f"files of {', '.join(map(str, sorted(sizes))) or 'no'} bytes",
                need=f"{_N_CHIPS} files adc0 to adc3 of one size",
                fix="Copy all of them again from their source.",
            )
        (n_bytes,) = sizes
        for file in files:
            must_stay_in(file.parent, file)
        must_be_words(files[0], n_bytes)
        settings = settings_for(files[0], told)
        radar = settings.radar
        # A chip's file is like a recording of that chip's receivers alone.
        rx_m = (radar.array.rx_m * _RX_PER_CHIP)[:_RX_PER_CHIP]
        of_chip = replace(settings, radar=replace(radar, array=replace(radar.array, rx_m=rx_m)))
        what = f"files of {n_bytes} bytes, 2 for each number,"
        shape, findings = shape_in(path, _AXES, of_chip, n_bytes // 2, what=what)
        stored = _together([mapped(file, np.dtype("<i2"), shape) for file in files])
        known = replace(told, settings=settings, axes=_AXES, encoding="int16")
        held = contents(path, stored, known, file_bytes=_N_CHIPS * n_bytes, findings=findings)
        return unverified(held, "RADIal", _not_separated())


def _files(path: Path) -> list[Path]:
    """Files of the four chips, in order; none if there are not exactly those."""
    stem = _NAME.fullmatch(path.name)
    if path.is_file() and stem is None:
        return []
    folder = path if path.is_dir() else path.parent
    found = sorted(
        (name[2], file)
        for file in folder.iterdir()
        if (name := _NAME.fullmatch(file.name))
        and file.is_file()
        and (path.is_dir() or (stem and name[1] == stem[1]))
    )
    return [file for _, file in found] if [chip for chip, _ in found] == [*"0123"] else []


def _together(chips: list[Stored]) -> Stored:
    """Arrays of the chips, one after the other along the receivers."""

    def read(part: Part) -> np.ndarray:
        each = (*part[:_RX_AXIS], slice(0, _RX_PER_CHIP), *part[_RX_AXIS + 1 :])
        return np.concatenate([chip.read(each) for chip in chips], axis=_RX_AXIS)

    first = chips[0].shape
    shape = (*first[:_RX_AXIS], _N_CHIPS * _RX_PER_CHIP, *first[_RX_AXIS + 1 :])
    return Stored(shape=shape, dtype=chips[0].dtype, read=read)


def _not_separated() -> Finding:
    return Finding(
        level="warning",
        setting="radar.frame.multiplexing",
        got="none: 12 transmitters that send at once are read as one",
        need="their separation by Doppler, which is not done yet",
        fix="Every target shows 12 times along velocity; trust range alone.",
    )
