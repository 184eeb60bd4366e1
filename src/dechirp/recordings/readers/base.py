"""Base class of the recording formats: recognise a file by its content and decode its frames."""

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
from dechirp.core.values import frozen_dataclass
from dechirp.radar.devices.base import Device
from dechirp.radar.radar import Radar
from dechirp.recordings.foreign_files import identify_foreign_file, is_text, read_head
from dechirp.recordings.samples.stationary_tones import StationaryTones
from dechirp.recordings.settings.base import Iq, RecordingSettings

IQ_ORDERS = ("iq", "qi")

Units = Literal["W**0.5", "1"]
"""Units of a cube: absolute (sqrt(W)) where the recording is calibrated."""


class MatchQuality(IntEnum):
    """Quality of the match between the content of a file and a format; the best is chosen."""

    NO = 0
    """The file is something else."""
    POSSIBLE = 1
    """Nothing contradicts the format; raw samples give no better evidence."""
    LIKELY = 2
    """Raw samples whose values are typical of the format."""
    CONTAINER = 3
    """A file of this type, whose array the user has to describe."""
    SELF_DESCRIBING = 4
    """A recording of this format that contains its own settings."""


@frozen_dataclass
class RecordingHints:
    """Facts about a recording that the user gives because its file does not contain them."""

    settings: RecordingSettings | None = None
    device: Device | None = None
    inner_name: str | None = None
    """Name of the array or topic to read in a file that holds several."""
    axes: tuple[str, ...] | None = None
    encoding: str | None = None
    iq: Iq | None = None


@frozen_dataclass
class Contents:
    """Contents of a recording: frames of samples, decoded one by one, or detections."""

    radar: Radar | None
    """The radar of the recording; None if only its detections were stored."""
    n_frames: int
    decode: Callable[[int, np.ndarray], None] | None = field(default=None, repr=False)
    """Function that fills (chirp, rx, sample), complex64 or float32, with one frame."""
    decode_frames: Callable[[int, np.ndarray], None] | None = field(default=None, repr=False)
    """Function that fills (frame, chirp, rx, sample) with consecutive frames, from the first on;
    None: `decode` alone. Frames of 50 kB take three times as long one by one.
    """
    units: Units = "1"
    """Units of the samples; "1" means that full scale is 1."""
    gaps: np.ndarray | None = field(default=None, repr=False)
    """(frame, chirp), True where samples of the chirp were lost (zero); None without losses."""
    start_offsets: np.ndarray | None = field(default=None, repr=False)
    """(frame, chirp): start of each chirp after its first sample, in sample intervals; None if all
    begin with it. See `processing.mitigation.chirp_alignment`.
    """
    tones: StationaryTones | None = field(default=None, repr=False)
    """Tones in the samples that are no echoes; None where the format cannot tell them."""
    frame_starts_s: np.ndarray | None = field(default=None, repr=False)
    """(frame,), measured start of each frame from that of the first; None: those of the radar."""
    points: xr.Dataset | None = field(default=None, repr=False)
    """Detections made by the radar itself, in the columns of `processing.detect`."""
    findings: tuple[Finding, ...] = ()
    iq: Iq | None = None
    """Order of I and Q in which complex samples were read, where the format allows both."""
    settings_path: Path | None = None
    """File that describes the layout of raw samples."""
    device: str | None = None
    """Kind of the radar chip, as in `radar.devices`; None if unknown."""
    scale: float | None = None
    """Size of one ADC step in `units`, if every sample is an integer multiple of it."""
    tables: Mapping[str, xr.Dataset] = field(default_factory=dict, repr=False)
    """Tables stored with the samples, by name: `detections`, `truth` and others."""
    other_ramps_encoding: str | None = None
    """Encoding that reads the other ramps of a triangle, where it was assumed which ones rise."""
    concentration: float | None = None
    """Concentration of the energy in few beat frequencies, at most 1; raw samples read in a wrong
    order have a lower one. None if the format is unambiguous.
    """


class Format(Family):
    """A file format of recordings."""

    group: ClassVar[str] = "dechirp.format"
    options: ClassVar[tuple[str, ...]] = ()
    """Hints that the format uses, out of axes, encoding, iq and inner_name."""
    encodings: ClassVar[tuple[str, ...]] = ()
    """Accepted values of `encoding`, if that is one of the options."""
    must_be_named: ClassVar[bool] = False
    """Whether the user must name the format because its files cannot be recognised."""

    @abstractmethod
    def recognise(self, path: Path) -> MatchQuality:
        """Return how well the content of an existing file or folder fits the format."""

    @abstractmethod
    def read(self, path: Path, hints: RecordingHints) -> Contents:
        """Check the recording against its settings, without decoding samples.

        Raises
        ------
        RecordingError
            If the recording is damaged or does not fit its settings.
        InvalidFile
            If the settings file has mistakes.
        """

    def leading_file(self, path: Path, hints: RecordingHints) -> Path:
        """Return the file that stands for a recording of several files; else the file itself."""
        return path


_MIN_RAW_BYTES = 32  # eight complex int16 samples

# Suffixes of file types that begin with a signature; without it, the file is damaged.
_SUFFIXES_WITH_SIGNATURE = {
    ".npy",
    ".npz",
    ".mat",
    ".h5",
    ".hdf5",
    ".nc",
    ".wav",
    ".pcap",
    ".pcapng",
    ".zip",
    ".gz",
    ".bag",
    ".mcap",
    ".db3",
}


def identify_non_raw_content(path: Path) -> str | None:
    """Return the type of a file that is clearly not raw samples; None if it may be."""
    head = read_head(path)
    kind = identify_foreign_file(head)
    if kind is not None:
        return kind.description
    if is_text(head):
        return "text"
    if path.stat().st_size < _MIN_RAW_BYTES:
        return f"only {path.stat().st_size} bytes"
    if path.suffix.lower() in _SUFFIXES_WITH_SIGNATURE:
        return f"bytes without the signature of a {path.suffix} file"
    return None


def experimental_reader_warning(reader: str) -> Finding:
    """Warn about a format whose reader was never checked on a real file."""
    return Finding(
        level="warning",
        setting="format",
        value=f"{reader}, an experimental reader: written from the documentation of the format,"
        " never checked on a real file",
        expected="a range-Doppler map in which a known target has the right range and velocity",
        fix="check that in the first map; if it is wrong, name the axes with a generic format",
    )


def check_stays_in_folder(folder: Path, file: Path) -> None:
    """Raise `RecordingError` if a file of a folder is a link that leads out of the folder."""
    if file.resolve().parent != folder.resolve():
        raise RecordingError(
            folder,
            value=f"{file.name} is a link to another folder",
            expected="files inside the folder; links out of it are not followed",
            fix="copy the folder and the targets of its links",
        )
