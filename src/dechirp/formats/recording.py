"""A recording: the samples in a file or folder, as the cube a simulation would give."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.displayed import Displayed, Table, several
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding, findings
from dechirp.core.memory import must_fit
from dechirp.core.values import value
from dechirp.formats.base import IQ_ORDERS, Contents, Told
from dechirp.formats.recognise import contents_of, inside_of, must_be_one_of, unreadable
from dechirp.formats.settings.base import Iq, Settings
from dechirp.formats.settings.calibration import read_calibration
from dechirp.formats.settings.read import read_settings
from dechirp.radar.calibration import Calibration
from dechirp.radar.cube import labelled_cube
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.known import device as known_device
from dechirp.radar.radar import Radar


@value
class Recording(Displayed):
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

    def part(self, first: int, stop: int) -> "Recording":
        """Give the same recording with these of its frames alone, counted from 0.

        Raises
        ------
        RecordingError
            If not all of them are there, or there is none.
        """
        n_frames = self.contents.n_frames
        if not 0 <= first < stop <= n_frames:
            raise RecordingError(
                self.path,
                got=f"of {n_frames} frame{'s' if n_frames > 1 else ''}, asked for those from"
                f" {first} to before {stop}",
                need="of all the frames that are asked for, at least one",
                fix=f"Ask for frames between 0 and {n_frames}.",
            )
        return replace(self, frame_numbers=range(first, stop))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was assumed, and what looks wrong."""
        return self.contents.findings

    @property
    def points(self) -> xr.Dataset | None:
        """Detections that the radar made itself, as `detect` gives them; none: samples alone."""
        found = self.contents.points
        return None if found is None else self._in_frames(found)

    @property
    def tables(self) -> dict[str, xr.Dataset]:
        """What was kept beside the samples, as `detections` and `truth`, of these frames."""
        return {name: self._in_frames(table) for name, table in self.contents.tables.items()}

    def _in_frames(self, table: xr.Dataset) -> xr.Dataset:
        """The rows of the frames that are read; all of a table whose rows are of no frame."""
        if self.n_frames == self.contents.n_frames or "frame" not in table.variables:
            return table
        own = self.frame_numbers
        if "frame" in table.dims:
            return table.isel(frame=slice(own.start, own.stop))
        if table["frame"].ndim != 1:
            return table
        (over,), numbers = table["frame"].dims, table["frame"].values
        return table.isel({over: np.flatnonzero((numbers >= own.start) & (numbers < own.stop))})

    def _line(self) -> str:
        parts = [f"{Path(self.path).name}: {self.format}", several(self.n_frames, "frame")]
        if self.contents.decode is None:
            parts.append("detections without samples")
        if self.contents.radar is not None:
            parts.append(self.contents.radar._line())
        return ", ".join(parts)

    def _tables(self) -> Iterable[Table]:
        if self.findings:
            yield findings(self.findings)
        if self.contents.radar is not None:
            yield from self.contents.radar._tables()

    def must_hold_samples(self) -> None:
        """Raise `RecordingError` if it holds detections alone."""
        if self.contents.decode is None:
            raise RecordingError(
                self.path,
                got=f"of the format {self.format}, which holds detections and no samples",
                need="a recording of samples",
                fix="Use its `points`, or `dechirp inspect` to see them.",
            )

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
        self.must_hold_samples()
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
            raise unreadable(self.path, error) from None

    def _labelled(self, samples: np.ndarray, numbers: range) -> xr.DataArray:
        gaps = self.contents.gaps
        return labelled_frames(
            samples,
            self.contents,
            first=numbers.start,
            gaps=None if gaps is None else gaps[numbers.start : numbers.stop],
        )


def labelled_frames(
    samples: np.ndarray, contents: Contents, *, first: int, gaps: np.ndarray | None
) -> xr.DataArray:
    """Label samples (frame, chirp, rx, sample) of contents, the first frame of this number.

    `gaps`, (frame, chirp), where not None, becomes the coordinate `gap`.
    """
    assert contents.radar is not None  # who has samples has their radar
    cube = labelled_cube(samples, contents.radar, units=contents.units, first_frame=first)
    if contents.scale is not None:
        cube.attrs["scale"] = contents.scale
    if gaps is None:
        return cube
    said = {"long_name": "samples of the chirp were lost and are zero"}
    return cube.assign_coords(gap=xr.Variable(("frame", "chirp"), gaps, said))


def open(
    path: str | Path,
    *,
    radar: Radar | str | Path | None = None,
    settings: str | Path | None = None,
    device: str | None = None,
    format: str | None = None,
    axes: Sequence[str] | str | None = None,
    encoding: str | None = None,
    iq: str | None = None,
    calibration: Calibration | str | Path | None = None,
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
    settings : path, optional
        Beside a radar that was changed or made otherwise: the vendor's file that says how its
        samples lie, of which that holds.
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
    calibration : Calibration or path, optional
        Of the array, in place of one that the radar has: a value, or the file that
        `dechirp calibrate` wrote.
    frames : (int, int), optional
        First frame to read, counted from 0, and the one after the last; all without it. The
        others are never decoded.

    Raises
    ------
    RecordingError
        If the recording is not what it is said to be.
    InvalidFile
        If its YAML settings or the file of the calibration have mistakes.
    InvalidSetting
        If the calibration is of another array, or no device of that name is known.
    """
    path = Path(path)
    if isinstance(calibration, str | Path):
        calibration = read_calibration(calibration)
    if isinstance(axes, str):
        axes = axes.replace(",", " ").split()
    must_be_one_of(path, "iq", iq, IQ_ORDERS)
    known = None if device is None else known_device(device)
    told_settings = settings_told(radar, settings, known)
    try:
        file, inside = inside_of(path)
        told = Told(
            settings=told_settings,
            device=known,
            inside=inside,
            axes=None if axes is None else tuple(axes),
            encoding=encoding,
            iq=cast(Iq | None, iq),
        )
        kind, contents = contents_of(file, format, told)
    except OSError as error:
        raise unreadable(path, error) from None
    whole = Recording(
        path=path, format=kind, contents=contents, frame_numbers=range(contents.n_frames)
    )
    if calibration is not None:
        calibrated = replace(whole.radar, calibration=calibration)
        whole = replace(whole, contents=replace(contents, radar=calibrated))
    return whole if frames is None else whole.part(*frames)


def settings_told(
    radar: Radar | str | Path | None, layout: str | Path | None, device: Device | None
) -> Settings | None:
    """The radar, with what is known of the layout; none: neither was given."""
    read = None if layout is None else read_settings(Path(layout), device)
    if radar is None:
        return read
    made = (
        Settings(radar=radar).of_device(device)
        if isinstance(radar, Radar)
        else read_settings(Path(radar), device)
    )
    return made if read is None else read.of_radar(made.radar)
