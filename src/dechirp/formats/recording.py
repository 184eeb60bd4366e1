"""A recording: the samples in a file or folder, as the cube a simulation would give."""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.memory import must_fit
from dechirp.core.values import value
from dechirp.formats.base import IQ_ORDERS, Contents, Fit, Format, Told, foreign
from dechirp.formats.encodings import LIMITS
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings.read import read_settings
from dechirp.radar.cube import labelled_cube
from dechirp.radar.radar import Radar


@value
class Recording:
    """Samples on disk with the radar that made them; decoded only when asked for.

    Samples are complex64, or float32 where sampling is real, and full scale is 1. A
    converter's offset is left in them.
    """

    path: Path
    format: str
    contents: Contents
    frame_numbers: range
    """Which of the frames on disk are read, counted from 0."""
    points: None = None
    """Detections the radar made itself: none in the formats read so far."""

    @property
    def radar(self) -> Radar:
        """The radar; its hardware is not known unless it was given."""
        return self.contents.radar

    @property
    def n_frames(self) -> int:
        """Number of frames that are read."""
        return len(self.frame_numbers)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was assumed, and what looks wrong."""
        return self.contents.findings

    @cached_property
    def cube(self) -> xr.DataArray:
        """The frames that are read, (frame, chirp, rx, sample), decoded on first use.

        Raises
        ------
        NotEnoughMemory
            If it would not fit; `frames` needs one frame at a time.
        RecordingError
            If samples are not numbers of the encoding; the message says where.
        """
        frame, n_rx = self.radar.frame, self.radar.array.n_rx
        dtype = np.dtype(np.complex64 if frame.chirp.sampling == "complex" else np.float32)
        shape = (self.n_frames, frame.n_chirps, n_rx, frame.chirp.n_samples)
        must_fit(
            f"the cube of {self.path.name}",
            needed_bytes=math.prod(shape) * dtype.itemsize,
            fix="Read it frame by frame (frames() in Python), or fewer frames.",
        )
        samples = np.empty(shape, dtype)
        for index, number in enumerate(self.frame_numbers):
            samples[index] = self.contents.frame(number)
        return labelled_cube(
            samples, self.radar, units="full scale", first_frame=self.frame_numbers.start
        )

    def frames(self) -> Iterator[xr.DataArray]:
        """Cubes of one frame each, decoded one after the other; raises as `cube` does."""
        for number in self.frame_numbers:
            samples = self.contents.frame(number)[None]
            yield labelled_cube(samples, self.radar, units="full scale", first_frame=number)


def open(
    path: str | Path,
    *,
    radar: Radar | str | Path | None = None,
    format: str | None = None,
    axes: Sequence[str] | str | None = None,
    encoding: str | None = None,
    iq: str | None = None,
    frames: tuple[int, int] | None = None,
) -> Recording:
    """Open a recording; its samples are decoded when they are asked for.

    Parameters
    ----------
    path : path
        A file, or a folder for formats that are folders.
    radar : Radar or path, optional
        The radar, or its settings file (YAML, mmWave Studio log, Infineon config.json).
        Without it: the settings in the recording, else the file beside it whose name starts
        with the recording's, else the folder's only one.
    format : str, optional
        Kind of the format; without it the content decides.
    axes : names, optional
        What each axis of a bare array is: frame, chirp, rx, sample, iq. A list, or one text
        with commas.
    encoding : str, optional
        How numbers of a bare array stand for samples: int16, uint16-wrapped, offset-binary
        or full-scale.
    iq : {"iq", "qi"}, optional
        Which part of a complex sample comes first, where no settings say.
    frames : (int, int), optional
        First frame to read, counted from 0, and the one after the last; all without it. The
        others are never decoded.

    Raises
    ------
    RecordingError
        If the recording is not what it is said to be.
    InvalidFile
        If its YAML settings have mistakes.
    """
    path = Path(path)
    kind, reader = _format(path, format)
    if isinstance(axes, str):
        axes = axes.replace(",", " ").split()
    options = {"axes": axes, "encoding": encoding, "iq": iq}
    for name, given in options.items():
        if given is not None and name not in reader.options:
            raise RecordingError(
                path,
                got=f"in the format {kind}, with {name} given",
                need=f"given without {name}: the format has its own",
                fix=f"Leave out {name}, or name the format it is meant for.",
            )
    _check_choice(path, "encoding", encoding, tuple(LIMITS))
    told = Told(
        settings=_settings(radar),
        axes=None if axes is None else tuple(axes),
        encoding=encoding,
        iq=_order(path, iq),
    )
    try:
        contents = reader.read(path, told)
    except OSError as error:
        raise _unreadable(path, error) from None
    numbers = _numbers(path, frames, contents.n_frames)
    return Recording(path=path, format=kind, contents=contents, frame_numbers=numbers)


def _numbers(path: Path, frames: tuple[int, int] | None, n_frames: int) -> range:
    """Numbers of the frames to read, all of which there must be."""
    first, stop = (0, n_frames) if frames is None else frames
    if not 0 <= first < stop <= n_frames:
        raise RecordingError(
            path,
            got=f"of {n_frames} frames, asked for those from {first} to before {stop}",
            need="of all the frames that are asked for, at least one",
            fix=f"Ask for frames between 0 and {n_frames}.",
        )
    return range(first, stop)


def _settings(radar: Radar | str | Path | None) -> Settings | None:
    if radar is None:
        return None
    return Settings(radar=radar) if isinstance(radar, Radar) else read_settings(Path(radar))


def _order(path: Path, iq: str | None) -> Iq | None:
    _check_choice(path, "iq", iq, IQ_ORDERS)
    return cast(Iq | None, iq)


def _check_choice(path: Path, name: str, got: str | None, choices: tuple[str, ...]) -> None:
    if got is not None and got not in choices:
        raise RecordingError(
            path,
            got=f"given with {name} {got!r}",
            need=f"given with {name} one of {', '.join(choices)}",
            fix="Choose one of them.",
        )


def _format(path: Path, wanted: str | None) -> tuple[str, Format]:
    """Format of an existing path: the wanted one if it can be, else the best match."""
    formats: dict[str, Format] = {kind: made() for kind, made in Format.members().items()}
    _check_choice(path, "format", wanted, tuple(formats))
    try:
        if not path.exists():
            raise FileNotFoundError(2, "no such file or folder")
        if path.is_file() and path.stat().st_size == 0:
            got = "an empty file (0 bytes)"
            matches = dict.fromkeys(formats, Fit.NO)
        else:
            got = _looks(path)
            matches = {kind: member.recognise(path) for kind, member in formats.items()}
    except OSError as error:
        raise _unreadable(path, error) from None
    best = wanted or max(matches, key=lambda kind: matches[kind])
    # Bare samples fit any name; a name that claims a format of its own must keep to it.
    claimed = path.suffix.lower() in formats[best].suffixes
    if matches[best] > Fit.POSSIBLE or (
        matches[best] == Fit.POSSIBLE and (wanted is not None or claimed)
    ):
        return best, formats[best]
    said = wanted or next(
        (kind for kind, member in formats.items() if path.suffix.lower() in member.suffixes), None
    )
    raise RecordingError(
        path,
        got=got,
        need=f"a recording of the format {said}, as it is said to be"
        if said
        else f"a recording of a format that is read: {', '.join(formats)}",
        fix="Copy it again from its source, or name what it is with --format (format=...).",
    )


def _looks(path: Path) -> str:
    if path.is_file():
        return foreign(path) or "bytes without a mark of their kind"
    names = sorted(file.name for file in path.iterdir())
    more = f" and {len(names) - 8} more" if len(names) > 8 else ""
    return f"a folder with {', '.join(names[:8]) or 'nothing'}{more}"


def _unreadable(path: Path, error: OSError) -> RecordingError:
    return RecordingError(
        path,
        got=f"not readable ({error.strerror or error})",
        need="a file or folder that can be read",
        fix="Check its name and who may read it.",
    )
