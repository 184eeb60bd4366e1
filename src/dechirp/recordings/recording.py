"""Recordings: samples in a file or folder, read as the cube that a simulation would return."""

import math
import shlex
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
import xarray as xr
from xarray.core import indexing

from dechirp.core.argument_types import check_argument_types
from dechirp.core.conventions import CUBE_AXES, axis_coordinate
from dechirp.core.display import Displayable, Table, format_count_with_noun
from dechirp.core.errors import InvalidSetting, RecordingError
from dechirp.core.findings import Finding, findings_display_table
from dechirp.core.memory import check_free_memory
from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array
from dechirp.radar.calibration import Calibration
from dechirp.radar.cube import label_cube
from dechirp.radar.devices.base import Device
from dechirp.radar.devices.lookup import device as known_device
from dechirp.radar.radar import Radar
from dechirp.recordings.lazy_frames import LazyFrames
from dechirp.recordings.readers.base import IQ_ORDERS, Contents, RecordingHints
from dechirp.recordings.recognise import (
    check_choice,
    find_recording_in_folder,
    read_as_best_format,
    split_file_and_inner_path,
    unreadable_path_error,
)
from dechirp.recordings.settings.base import Iq, RecordingSettings
from dechirp.recordings.settings.calibration import read_calibration
from dechirp.recordings.settings.read import read_settings


@frozen_dataclass
class Recording(Displayable):
    """Samples on disk with the radar that recorded them, decoded on access.

    Samples are complex64, or float32 for real sampling; full scale is 1 unless the recording is
    calibrated. The converter's offset is not removed.
    """

    _file_reader: ClassVar[str] = "dechirp.open"

    path: Path
    format: str
    contents: Contents
    frame_numbers: range
    """Selected frames of those on disk, zero-based."""

    @property
    def radar(self) -> Radar:
        """The radar; its hardware is unknown unless the user gave it.

        Raises
        ------
        RecordingError
            If the recording contains only detections and the user gave no radar.
        """
        if self.contents.radar is None:
            raise RecordingError(
                self.path,
                value=f"of the format {self.format}, which contains detections without their radar",
                expected="a recording with a known radar",
                fix="give the radar: --radar FILE (radar=FILE in Python); `points` needs none",
            )
        return self.contents.radar

    @property
    def n_frames(self) -> int:
        """Number of selected frames."""
        return len(self.frame_numbers)

    def select_frames(self, first: int, stop: int) -> "Recording":
        """Return a recording of the frames `first` to `stop` (zero-based, `stop` excluded).

        Raises
        ------
        RecordingError
            If the range is empty or exceeds the recording.
        """
        n_frames = self.contents.n_frames
        if not 0 <= first < stop <= n_frames:
            raise RecordingError(
                self.path,
                value=f"of {n_frames} frame{'s' if n_frames > 1 else ''}, with"
                f" frames {first}:{stop} requested",
                expected="a non-empty range of existing frames",
                fix=f"select frames from 0:{n_frames}",
            )
        return replace(self, frame_numbers=range(first, stop))

    def select_receivers(self, receivers: Sequence[int]) -> "Recording":
        """Return the recording of some receivers, by their numbers, in their order."""
        contents, all_receivers = self.contents, self.radar.array.n_rx
        assert contents.decode is not None  # detections have no receivers
        decode_all = contents.decode

        def decode(number: int, out: np.ndarray) -> None:
            samples = np.empty((len(out), all_receivers, out.shape[2]), out.dtype)
            decode_all(number, samples)
            out[:] = samples[:, list(receivers)]

        radar = self.radar.select_receivers(receivers)
        selected = replace(contents, radar=radar, decode=decode, decode_frames=None)
        return replace(self, contents=selected)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Assumptions made while reading, and suspicious content."""
        return self.contents.findings

    @property
    def points(self) -> xr.Dataset | None:
        """Detections of the radar itself, as `detect` returns them; None for samples only."""
        points = self.contents.points
        return None if points is None else self._rows_of_selected_frames(points)

    @property
    def tables(self) -> dict[str, xr.Dataset]:
        """Tables stored with the samples, as `detections` and `truth`, for these frames."""
        return {
            name: self._rows_of_selected_frames(table)
            for name, table in self.contents.tables.items()
        }

    def _rows_of_selected_frames(self, table: xr.Dataset) -> xr.Dataset:
        """Return the rows of the selected frames; all rows of a table without frames."""
        if self.n_frames == self.contents.n_frames or "frame" not in table.variables:
            return table
        selected = self.frame_numbers
        if "frame" in table.dims:
            return table.isel(frame=slice(selected.start, selected.stop))
        if table["frame"].ndim != 1:
            return table
        (row_axis,), numbers = table["frame"].dims, table["frame"].values
        return table.isel(
            {row_axis: np.flatnonzero((numbers >= selected.start) & (numbers < selected.stop))}
        )

    def _display_line(self) -> str:
        parts = [
            f"{Path(self.path).name}: {self.format}",
            format_count_with_noun(self.n_frames, "frame"),
        ]
        if self.contents.decode is None:
            parts.append("detections without samples")
        if self.contents.radar is not None:
            parts.append(self.contents.radar._display_line())
        return ", ".join(parts)

    def _display_tables(self) -> Iterable[Table]:
        if self.findings:
            yield findings_display_table(self.findings)
        if self.contents.radar is not None:
            yield from self.contents.radar._display_tables()

    def check_has_samples(self) -> None:
        """Raise `RecordingError` if the recording contains only detections."""
        if self.contents.decode is None:
            raise RecordingError(
                self.path,
                value=f"of the format {self.format}, which contains detections without samples",
                expected="a recording with samples",
                fix=f"see them with dechirp inspect {shlex.quote(str(self.path))}; in Python,"
                " follow `points` of the recording with dechirp.group_tracking.track_groups, and an"
                " object list with dechirp.object_lists.read_objects, objects_to_detections and"
                " dechirp.track",
            )

    @property
    def sizes(self) -> dict[str, int]:
        """Size of the cube along each axis; empty without samples."""
        if self.contents.decode is None:
            return {}
        frame = self.radar.frame
        sizes = (self.n_frames, frame.n_chirps_total, self.radar.array.n_rx, frame.chirp.n_samples)
        return dict(zip(CUBE_AXES, sizes, strict=True))

    @cached_property
    def cube(self) -> xr.DataArray:
        """The selected frames, (frame, chirp, rx, sample), decoded on first access.

        Lost samples are zero, and the coordinate `gap` (frame, chirp) marks their chirps.

        Raises
        ------
        NotEnoughMemory
            If it does not fit; `frames` needs one frame at a time.
        RecordingError
            If there are no samples, or invalid ones; the message gives their position.
        """
        shape, dtype = self._cube_shape(), self._sample_dtype()
        check_free_memory(
            f"the cube of {self.path.name}",
            needed_bytes=math.prod(shape) * dtype.itemsize,
            fix="read it frame by frame (frames() in Python), or fewer frames",
        )
        samples = np.empty(shape, dtype)
        decode_frames = self.contents.decode_frames
        if decode_frames is None:
            for index, number in enumerate(self.frame_numbers):
                self._decode_frame(number, samples[index])
        elif len(samples):
            try:
                decode_frames(self.frame_numbers.start, samples)
            except OSError as error:
                raise unreadable_path_error(self.path, error) from None
        return self._label_samples_as_cube(samples, self.frame_numbers)

    @property
    def lazy_cube(self) -> xr.DataArray:
        """The selected frames as a lazy array, which decodes a frame when its samples are loaded.

        Raises `RecordingError` as `cube` does, for invalid samples when they are loaded.
        """
        frames = LazyFrames(
            self._decode_frame, self.frame_numbers, self._cube_shape()[1:], self._sample_dtype()
        )
        cube = self._label_samples_as_cube(indexing.LazilyIndexedArray(frames), self.frame_numbers)
        cube.encoding["preferred_chunks"] = {"frame": 1}
        return cube

    def frames(self) -> Iterator[xr.DataArray]:
        """Yield cubes of one frame each, decoded one by one; raises as `cube` does."""
        shape, dtype = self._cube_shape(), self._sample_dtype()
        for number in self.frame_numbers:
            samples = np.empty((1, *shape[1:]), dtype)
            self._decode_frame(number, samples[0])
            yield self._label_samples_as_cube(samples, range(number, number + 1))

    def iter_frame_samples(self) -> Iterator[tuple[int, np.ndarray, np.ndarray | None]]:
        """Yield number, samples (chirp, rx, sample) and lost chirps (chirp,) of each frame.

        Without labels, which take longer than small frames; the array is used for the next frame
        again. Lost chirps are a mask, or None if no chirp of the recording is lost. Raises as
        `cube` does.
        """
        gaps = self.contents.gaps
        samples = np.empty(self._cube_shape()[1:], self._sample_dtype())
        for number in self.frame_numbers:
            self._decode_frame(number, samples)
            yield number, samples, None if gaps is None else gaps[number]

    def _cube_shape(self) -> tuple[int, ...]:
        self.check_has_samples()
        return tuple(self.sizes.values())

    def _sample_dtype(self) -> np.dtype:
        return np.dtype(
            np.complex64 if self.radar.frame.chirp.sampling == "complex" else np.float32
        )

    def _decode_frame(self, frame_number: int, out: np.ndarray) -> None:
        assert self.contents.decode is not None  # `_cube_shape` was asked before
        try:
            self.contents.decode(frame_number, out)
        except OSError as error:
            raise unreadable_path_error(self.path, error) from None

    def _label_samples_as_cube(self, samples: Any, frame_numbers: range) -> xr.DataArray:
        gaps = self.contents.gaps
        return label_frames_as_cube(
            samples,
            self.contents,
            first_frame=frame_numbers.start,
            gaps=None if gaps is None else gaps[frame_numbers.start : frame_numbers.stop],
        )


def label_frames_as_cube(
    samples: Any, contents: Contents, *, first_frame: int, gaps: np.ndarray | None
) -> xr.DataArray:
    """Label samples (frame, chirp, rx, sample) of contents, from the frame number `first_frame` on.

    `gaps`, (frame, chirp), if not None, becomes the coordinate `gap`.
    """
    assert contents.radar is not None  # samples always have a radar
    cube = label_cube(samples, contents.radar, units=contents.units, first_frame=first_frame)
    if contents.scale is not None:
        cube.attrs["scale"] = contents.scale
    if contents.frame_starts_s is not None:
        starts_s = contents.frame_starts_s[first_frame : first_frame + len(samples)]
        cube = cube.assign_coords(frame=axis_coordinate("frame", starts_s))
    if gaps is None:
        return cube
    attributes = {"long_name": "samples of the chirp were lost and are zero"}
    return cube.assign_coords(gap=xr.Variable(("frame", "chirp"), gaps, attributes))


@check_argument_types
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
    """Open a recording; samples are decoded on access.

    Parameters
    ----------
    path : path
        A file, or a folder: a recording itself, or with one recording in it. The name of an array
        in a file of several follows it: `capture.mat/CollectionA`.
    radar : Radar or path, optional
        The radar, or its settings file (YAML, TI .cfg, .mmwave.json or .setup.json, mmWave
        Studio log, Infineon config.json). Default: the settings in the recording, else the
        settings file next to it whose name starts with the recording's, else the only one in
        the folder.
    settings : path, optional
        With a modified radar or one from elsewhere: the vendor's file that defines the sample
        layout.
    device : str, optional
        The chip or board, as xwr1843: it defines antenna positions and sample layout.
    format : str, optional
        Kind of the format; default: recognised from the content.
    axes : names, optional
        Meaning of each axis of a plain array: frame, chirp, tx, rx, element (of the virtual array,
        in place of tx and rx), sample, iq. A list, or one text with commas.
    encoding : str, optional
        Encoding of the samples of a plain array: int16, uint16-wrapped, offset-binary or
        full-scale. For WAV recordings: inverted or upright.
    iq : {"iq", "qi"}, optional
        Order of the parts of a complex sample, if no settings define it.
    calibration : Calibration or path, optional
        Replaces the calibration of the radar: a value, or a file written by `dechirp calibrate`.
    frames : (int, int), optional
        First frame to read, zero-based, and the one after the last; default: all. Other frames
        are never decoded.

    Raises
    ------
    RecordingError
        If the recording does not match its options.
    InvalidFile
        If its YAML settings or the calibration file have mistakes.
    InvalidSetting
        If the calibration is for another array, or the device is unknown.
    """
    path = recording_path(path)
    if isinstance(calibration, str | Path):
        calibration = read_calibration(calibration)
    check_axes_and_frames(axes, frames)
    check_choice(path, "iq", iq, IQ_ORDERS)
    known_device_type = None if device is None else known_device(device)
    given_settings = combine_radar_and_layout_settings(radar, settings, known_device_type)
    file = path
    try:
        file, inner_name = split_file_and_inner_path(path)
        hints = RecordingHints(
            settings=given_settings,
            device=known_device_type,
            inner_name=inner_name,
            axes=None if axes is None else split_axis_names(axes),
            encoding=encoding,
            iq=cast(Iq | None, iq),
        )
        file, folder_findings = find_recording_in_folder(file, format, hints)
        kind, contents = read_as_best_format(file, format, hints)
    except OSError as error:
        raise unreadable_path_error(file, error) from None
    recording = Recording(
        path=path if inner_name is not None else file,
        format=kind,
        contents=replace(contents, findings=(*folder_findings, *contents.findings)),
        frame_numbers=range(contents.n_frames),
    )
    if calibration is not None:
        calibrated = replace(recording.radar, calibration=calibration)
        recording = replace(recording, contents=replace(contents, radar=calibrated))
    return recording if frames is None else recording.select_frames(*frames)


def recording_path(path: str | Path) -> Path:
    """Return the path of a recording; raise `InvalidSetting` if it is an empty text.

    `Path("")` is the current folder.
    """
    if isinstance(path, str) and not path.strip():
        raise InvalidSetting(
            "path",
            value="empty",
            expected="the name of a file or a folder",
            fix="give it; . is the current folder",
        )
    return Path(path)


def split_axis_names(axes: Sequence[str] | str) -> tuple[str, ...]:
    """Return the names of axes, given as a list or as one text with commas."""
    return tuple(axes.replace(",", " ").split() if isinstance(axes, str) else axes)


def check_axes_and_frames(axes: object, frames: object) -> None:
    """Raise `InvalidSetting` unless the values are names, and a pair of integers, or None."""
    is_names = isinstance(axes, str) or (
        isinstance(axes, Sequence) and all(isinstance(name, str) for name in axes)
    )
    if axes is not None and not is_names:
        raise InvalidSetting(
            "axes",
            value=repr(axes)[:80],
            expected="names of axes, in the order of the array",
            fix='give them as "frame,chirp,rx,sample", or as a list',
        )
    is_pair = (
        isinstance(frames, Sequence)
        and len(frames) == 2
        and all(isinstance(number, Integral) for number in frames)
    )
    if frames is not None and not is_pair:
        raise InvalidSetting(
            "frames",
            value=repr(frames)[:80],
            expected="two whole numbers: the first frame, from 0, and the one after the last",
            fix="give frames=(0, 10) for the first ten",
        )


def combine_radar_and_layout_settings(
    radar: Radar | str | Path | None, layout_file: str | Path | None, device: Device | None
) -> RecordingSettings | None:
    """Combine the given radar with a given layout file; return None without either."""
    layout_settings = None if layout_file is None else read_settings(Path(layout_file), device)
    if radar is None:
        return layout_settings
    if isinstance(radar, Radar):
        radar_settings = RecordingSettings(radar=radar).completed_from_device(device)
        if device is not None and radar.array == Array():
            radar_settings = radar_settings.with_board_array(device)
    else:
        radar_settings = read_settings(Path(radar), device)
    return (
        radar_settings
        if layout_settings is None
        else layout_settings.with_radar(radar_settings.radar)
    )
