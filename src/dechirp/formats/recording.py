"""A recording: the samples in a file or folder, as the cube a simulation would give."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.memory import must_fit
from dechirp.core.values import value
from dechirp.formats.base import IQ_ORDERS, Contents, Fit, Format, Told, foreign
from dechirp.formats.samples.sample_order import choose
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings.read import read_settings
from dechirp.radar.cube import labelled_cube
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.known import device as known_device
from dechirp.radar.radar import Radar


@value
class Recording:
    """Samples on disk with the radar that made them; decoded only when asked for.

    Samples are complex64, or float32 where sampling is real, and full scale is 1 unless the
    recording is calibrated. A converter's offset is left in them.
    """

    path: Path
    format: str
    contents: Contents
    frame_numbers: range
    """Which of the frames on disk are read, counted from 0."""

    @property
    def radar(self) -> Radar:
        """The radar; its hardware is not known unless it was given.

        Raises
        ------
        RecordingError
            If the recording holds detections alone and nobody gave a radar.
        """
        if self.contents.radar is None:
            raise RecordingError(
                self.path,
                got=f"of the format {self.format}, which keeps detections without their radar",
                need="a recording whose radar is known",
                fix="Give the radar: --radar FILE (radar=FILE in Python); `points` needs none.",
            )
        return self.contents.radar

    @property
    def n_frames(self) -> int:
        """Number of frames that are read."""
        return len(self.frame_numbers)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was assumed, and what looks wrong."""
        return self.contents.findings

    @property
    def points(self) -> xr.Dataset | None:
        """Detections that the radar made itself, as `detect` gives them; none: samples alone."""
        found = self.contents.points
        if found is None:
            return None
        numbers = found["frame"].values
        inside = (numbers >= self.frame_numbers.start) & (numbers < self.frame_numbers.stop)
        return found.isel(detection=np.flatnonzero(inside))

    @property
    def sizes(self) -> dict[str, int]:
        """Size of the cube along each of its axes; empty where there are no samples."""
        if self.contents.decode is None:
            return {}
        frame = self.radar.frame
        sizes = (self.n_frames, frame.n_sent, self.radar.array.n_rx, frame.chirp.n_samples)
        return dict(zip(CUBE_AXES, sizes, strict=True))

    @cached_property
    def cube(self) -> xr.DataArray:
        """The frames that are read, (frame, chirp, rx, sample), decoded on first use.

        Where samples were lost they are zero, and a coordinate `gap` (frame, chirp) is True.

        Raises
        ------
        NotEnoughMemory
            If it would not fit; `frames` needs one frame at a time.
        RecordingError
            If there are no samples, or they are not numbers of the encoding; the message says
            where.
        """
        shape, dtype = self._shape(), self._dtype()
        must_fit(
            f"the cube of {self.path.name}",
            needed_bytes=math.prod(shape) * dtype.itemsize,
            fix="Read it frame by frame (frames() in Python), or fewer frames.",
        )
        samples = np.empty(shape, dtype)
        for index, number in enumerate(self.frame_numbers):
            self._decode(number, samples[index])
        return self._labelled(samples, self.frame_numbers)

    def frames(self) -> Iterator[xr.DataArray]:
        """Cubes of one frame each, decoded one after the other; raises as `cube` does."""
        shape, dtype = self._shape(), self._dtype()
        for number in self.frame_numbers:
            samples = np.empty((1, *shape[1:]), dtype)
            self._decode(number, samples[0])
            yield self._labelled(samples, range(number, number + 1))

    def _shape(self) -> tuple[int, ...]:
        if not self.sizes:
            raise RecordingError(
                self.path,
                got=f"of the format {self.format}, which holds detections and no samples",
                need="a recording of samples",
                fix="Use its `points`.",
            )
        return tuple(self.sizes.values())

    def _dtype(self) -> np.dtype:
        return np.dtype(
            np.complex64 if self.radar.frame.chirp.sampling == "complex" else np.float32
        )

    def _decode(self, number: int, out: np.ndarray) -> None:
        assert self.contents.decode is not None  # `_shape` was asked before
        try:
            self.contents.decode(number, out)
        except OSError as error:
            raise _unreadable(self.path, error) from None

    def _labelled(self, samples: np.ndarray, numbers: range) -> xr.DataArray:
        cube = labelled_cube(
            samples, self.radar, units=self.contents.units, first_frame=numbers.start
        )
        gaps = self.contents.gaps
        if gaps is None:
            return cube
        said = {"long_name": "samples of the chirp were lost and are zero"}
        mark = xr.Variable(("frame", "chirp"), gaps[numbers.start : numbers.stop], said)
        return cube.assign_coords(gap=mark)


def open(
    path: str | Path,
    *,
    radar: Radar | str | Path | None = None,
    device: str | None = None,
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
        A file, or a folder for formats that are folders. An array in a file of several is
        named below it: `capture.mat/CollectionA`.
    radar : Radar or path, optional
        The radar, or its settings file (YAML, TI .cfg, .mmwave.json or .setup.json, mmWave
        Studio log, Infineon config.json). Without it: the settings in the recording, else the
        file beside it whose name starts with the recording's, else the folder's only one.
    device : str, optional
        The chip or board, as xwr1843: where its antennas are, and how it writes samples.
    format : str, optional
        Kind of the format; without it the content decides.
    axes : names, optional
        What each axis of a bare array is: frame, chirp, tx, rx, element (of the virtual array,
        in place of tx and rx), sample, iq. A list, or one text with commas.
    encoding : str, optional
        How numbers of a bare array stand for samples: int16, uint16-wrapped, offset-binary
        or full-scale. Of a WAV radar: inverted or upright.
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
    if isinstance(axes, str):
        axes = axes.replace(",", " ").split()
    _check_choice(path, "iq", iq, IQ_ORDERS)
    known = None if device is None else known_device(device)
    settings = _settings(radar, known)
    try:
        file, inside = _inside(path)
        told = Told(
            settings=settings,
            device=known,
            inside=inside,
            axes=None if axes is None else tuple(axes),
            encoding=encoding,
            iq=cast(Iq | None, iq),
        )
        kind, contents = _contents(file, format, told)
    except OSError as error:
        raise _unreadable(path, error) from None
    numbers = _numbers(path, frames, contents.n_frames)
    return Recording(path=path, format=kind, contents=contents, frame_numbers=numbers)


def recognised(path: str | Path, format: str | None = None) -> tuple[str, ...]:
    """Kinds of the formats that fit the content of a path: one, or several of bare samples.

    Raises
    ------
    RecordingError
        If none does, or there is nothing to be read.
    """
    path = Path(path)
    members: dict[str, Format] = {kind: made() for kind, made in Format.members().items()}
    _check_choice(path, "format", format, tuple(members))
    try:
        return tuple(_fitting(_inside(path)[0], format, members))
    except OSError as error:
        raise _unreadable(path, error) from None


def _inside(path: Path) -> tuple[Path, str | None]:
    """Path on disk, and the name of an array in it where one is named below it."""
    if not path.exists():
        for above in path.parents:
            if above.is_file():
                return above, path.relative_to(above).as_posix()
    return path, None


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


def _settings(radar: Radar | str | Path | None, device: Device | None) -> Settings | None:
    if radar is None:
        return None
    if isinstance(radar, Radar):
        return Settings(radar=radar).of_device(device)
    return read_settings(Path(radar), device)


def _check_choice(path: Path, name: str, got: str | None, choices: tuple[str, ...]) -> None:
    if got is not None and got not in choices:
        raise RecordingError(
            path,
            got=f"given with {name} {got!r}",
            need=f"given with {name} one of {', '.join(choices)}",
            fix="Choose one of them.",
        )


def _contents(path: Path, wanted: str | None, told: Told) -> tuple[str, Contents]:
    """Kind of the format of a path, and what it holds: the wanted one, else the best fit."""
    formats: dict[str, Format] = {kind: made() for kind, made in Format.members().items()}
    _check_choice(path, "format", wanted, tuple(formats))
    kinds = _fitting(path, wanted, formats)
    if len(kinds) == 1:
        (kind,) = kinds
        return kind, _read(path, kind, formats[kind], told)
    # Bare samples: each format that they fit is tried, and the one is taken that leaves the
    # energy in clearly the fewest beat frequencies. If none fits, the first says why.
    found, refused = {}, []
    for kind in kinds:
        try:
            found[kind] = _read(path, kind, formats[kind], told)
        except RecordingError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    names, contents = list(found), list(found.values())
    place, chosen = choose(
        names,
        [one.concentration or 0.0 for one in contents],
        n_samples=max(one.radar.frame.chirp.n_samples for one in contents if one.radar),
        setting="format",
        fix="give --format.",
    )
    best = contents[place]
    return names[place], replace(best, findings=best.findings + chosen)


def _fitting(path: Path, wanted: str | None, formats: dict[str, Format]) -> list[str]:
    """Kinds that fit the content best: the wanted one if it can be; several of bare samples."""
    if not path.exists():
        raise FileNotFoundError(2, "no such file or folder")
    if not (path.is_file() or path.is_dir()):
        raise OSError(0, "neither a file nor a folder")
    if path.is_file() and path.stat().st_size == 0:
        got, fits = "an empty file (0 bytes)", {}
    else:
        got = _looks(path)
        asked = [kind for kind, member in formats.items() if wanted == kind or not member.only_told]
        fits = {kind: formats[kind].recognise(path) for kind in asked}
    best = fits.get(wanted, Fit.NO) if wanted else max(fits.values(), default=Fit.NO)
    if best > Fit.NO:
        return [wanted] if wanted else [kind for kind, fit in fits.items() if fit == best]
    raise RecordingError(
        path,
        got=got,
        need=f"a recording of the format {wanted}, as it is said to be"
        if wanted
        else f"a recording of a format that is read: {', '.join(formats)}",
        fix="Copy it again from its source, or name what it is with --format (format=...).",
    )


def _read(path: Path, kind: str, reader: Format, told: Told) -> Contents:
    """Contents of a path, after a look at whether the format takes what was said of it."""
    if told.inside is not None and "inside" not in reader.options:
        raise RecordingError(
            path / told.inside,
            got=f"named inside {path.name}, of the format {kind}",
            need="a file, or an array in one that holds several",
            fix=f"Name {path.name} itself.",
        )
    options = {"axes": told.axes, "encoding": told.encoding, "iq": told.iq}
    for name, given in options.items():
        if given is not None and name not in reader.options:
            raise RecordingError(
                path,
                got=f"in the format {kind}, with {name} given",
                need=f"given without {name}: the format has its own",
                fix=f"Leave out {name}, or name the format it is meant for.",
            )
    _check_choice(path, "encoding", told.encoding, reader.encodings)
    return reader.read(path, told)


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
