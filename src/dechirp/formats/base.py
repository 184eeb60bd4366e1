"""What a recording format is: it knows its files by their content, and decodes them."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import field
from enum import IntEnum
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.settings.base import Iq, Settings
from dechirp.radar.radar import Radar

IQ_ORDERS = ("iq", "qi")


class Fit(IntEnum):
    """How well the content of a file fits a format; the highest is chosen."""

    NO = 0
    """It is something else."""
    POSSIBLE = 1
    """Nothing speaks against it: all that can be said of bare samples."""
    CONTAINER = 2
    """A file of this kind, whose meaning the user has to tell."""
    OWN = 3
    """A recording of this format, with its own settings."""


@value
class Told:
    """What the user said of a recording, where its file does not say it."""

    settings: Settings | None = None
    axes: tuple[str, ...] | None = None
    encoding: str | None = None
    iq: Iq | None = None


@value
class Contents:
    """What a recording holds: the radar that made it, and its frames, decoded one by one."""

    radar: Radar
    n_frames: int
    frame: Callable[[int], np.ndarray] = field(repr=False)
    """Samples of one frame, (chirp, rx, sample), full scale 1, complex64 or float32."""
    findings: tuple[Finding, ...] = ()
    iq: Iq | None = None
    """Order in which the parts of a sample were read, where the format has two."""


class Format(Family):
    """A way in which recordings lie on disk."""

    group: ClassVar[str] = "dechirp.format"
    suffixes: ClassVar[tuple[str, ...]] = ()
    """Endings of file names that claim this format; the content decides."""
    options: ClassVar[tuple[str, ...]] = ()
    """Which of axes, encoding and iq the format needs to be told, or may be."""

    @abstractmethod
    def recognise(self, path: Path) -> Fit:
        """How well the content of an existing file or folder fits."""

    @abstractmethod
    def read(self, path: Path, told: Told) -> Contents:
        """Check the recording against its settings; decode nothing yet.

        Raises
        ------
        RecordingError
            If it is damaged, or does not fit its settings.
        InvalidFile
            If the file of its settings has mistakes.
        """


# First bytes of files that are not bare samples.
_MAGIC = {
    b"\x93NUMPY": "a NumPy array",
    b"PK\x03\x04": "a ZIP archive",
    b"\x89HDF": "an HDF5 file",
    b"\x1f\x8b": "a gzip archive",
    b"RIFF": "a WAV or AVI file",
    b"\x89PNG": "a PNG picture",
    b"%PDF": "a PDF document",
    b"MATLAB": "a MATLAB file",
    b"\xd4\xc3\xb2\xa1": "a network capture (pcap)",
    b"\x02\x01\x04\x03\x06\x05\x08\x07": "detections from a TI radar's serial port",
}


def foreign(path: Path) -> str | None:
    """Say what a file visibly is if not bare samples; None if nothing gives it away."""
    with path.open("rb") as file:
        head = file.read(512)
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            return kind
    # int16 samples of a silent input are mostly bytes 0 and 255; text has neither.
    if head and all(byte in b"\t\n\r\f" or 32 <= byte < 127 for byte in head):
        return "text"
    return None
