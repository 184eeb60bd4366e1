"""What a recording format is: it knows its files by their content, and decodes them."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import field
from enum import IntEnum
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.families import Family
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.settings.base import Iq, Settings
from dechirp.radar.devices.base import Device
from dechirp.radar.radar import Radar

IQ_ORDERS = ("iq", "qi")

Units = Literal["sqrt(W)", "full scale"]
"""Of a cube: absolute where the recording is calibrated."""


class Fit(IntEnum):
    """How well the content of a file fits a format; the highest is chosen."""

    NO = 0
    """It is something else."""
    POSSIBLE = 1
    """Nothing speaks against it: all that can be said of bare samples."""
    LIKELY = 2
    """Bare samples whose numbers speak for it."""
    CONTAINER = 3
    """A file of this kind, whose meaning the user has to tell."""
    OWN = 4
    """A recording of this format, with its own settings."""


@value
class Told:
    """What the user said of a recording, where its file does not say it."""

    settings: Settings | None = None
    device: Device | None = None
    inside: str | None = None
    """Name of the array that is meant, in a file of several."""
    axes: tuple[str, ...] | None = None
    encoding: str | None = None
    iq: Iq | None = None


@value
class Contents:
    """What a recording holds: frames of samples to decode one by one, or detections."""

    radar: Radar | None
    """The radar that made it; None where only its detections were kept."""
    n_frames: int
    decode: Callable[[int, np.ndarray], None] | None = field(default=None, repr=False)
    """Fill (chirp, rx, sample), complex64 or float32 as the radar samples, with one frame."""
    units: Units = "full scale"
    """Full scale is 1."""
    gaps: np.ndarray | None = field(default=None, repr=False)
    """(frame, chirp), True where samples of the chirp were lost: they are zero. None: no loss."""
    points: xr.Dataset | None = field(default=None, repr=False)
    """Detections that the radar made itself, as `process.chain.detect` gives them."""
    findings: tuple[Finding, ...] = ()
    iq: Iq | None = None
    """Order in which the parts of a sample were read, where the format has two."""
    settings_path: Path | None = None
    """File that says how bare samples lie."""
    device: str | None = None
    """Kind of the chip that made it, as `radar.devices` calls it; None where nothing says."""
    scale: float | None = None
    """Step of the converter in these units, where every sample is a whole number of them."""
    tables: Mapping[str, xr.Dataset] = field(default_factory=dict, repr=False)
    """What was kept beside the samples, by name: `detections`, `truth` and so on."""
    concentration: float | None = None
    """How few beat frequencies hold the energy, at most 1: bare samples read the wrong way
    have it spread over more. None where the format leaves no doubt."""


class Format(Family):
    """A way in which recordings lie on disk."""

    group: ClassVar[str] = "dechirp.format"
    options: ClassVar[tuple[str, ...]] = ()
    """Which of axes, encoding, iq and inside the format needs to be told, or may be."""
    encodings: ClassVar[tuple[str, ...]] = ()
    """What `encoding` may be, where it is one of the options."""
    only_told: ClassVar[bool] = False
    """Whether the user has to name the format: nothing in its files gives it away."""

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
    b"\xff\xd8\xff": "a JPEG picture",
    b"%PDF": "a PDF document",
    b"MATLAB": "a MATLAB file",
    **dict.fromkeys((b"CDF\1", b"CDF\2", b"CDF\5"), "a netCDF file of version 3"),
    b"\x89MCAP0\r\n": "an MCAP file",
    **dict.fromkeys(
        (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\xa1\xb2\x3c\x4d"),
        "a network capture (pcap)",
    ),
    b"\x0a\x0d\x0d\x0a": "a network capture (pcapng)",
    b"\x02\x01\x04\x03\x06\x05\x08\x07": "detections from a TI radar's serial port",
}


# Endings of files that begin with a mark; without it, such a file is not what it says.
_MARKED = {".npy", ".npz", ".mat", ".h5", ".hdf5", ".nc", ".wav", ".pcap", ".pcapng", ".zip", ".gz"}


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
    if path.suffix.lower() in _MARKED:
        return f"bytes without a mark of their kind, which no {path.suffix} file is"
    return None


def must_stay_in(folder: Path, file: Path) -> None:
    """Raise `RecordingError` if a file of a folder is a link that leads out of it."""
    if file.resolve().parent != folder.resolve():
        raise RecordingError(
            folder,
            got=f"a folder in which {file.name} is a link to another one",
            need="one whose files lie in it: none may be read elsewhere",
            fix="Copy the folder with what its links lead to.",
        )
