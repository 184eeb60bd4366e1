"""Point clouds in files: one file a frame, in a folder of them, or one file for all frames."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.memory import SMALL_BYTES, check_free_memory
from dechirp.recordings.messages.foreign_point_clouds import convert_clouds_to_contents
from dechirp.recordings.messages.message_arrays import PointCloud
from dechirp.recordings.messages.ros import NANO
from dechirp.recordings.readers.base import Contents, RecordingHints, check_stays_in_folder

_MAX_TIME_S = 2**63 / NANO
# Digits of a time since 1970 at the end of a file name, and the ns of their last digit.
_NS_OF_DIGITS = {13: 10**6, 16: 10**3, 19: 1}


def list_cloud_files(path: Path, suffix: str) -> list[Path]:
    """Return the file itself, or the files of a folder with this suffix, in order of numbers.

    A folder with other files than these and hidden ones has none.
    """
    if path.is_file():
        return [path]
    files = [file for file in path.iterdir() if not file.name.startswith(".")]
    if not all(file.name.lower().endswith(suffix) and file.is_file() for file in files):
        return []
    return sorted(files, key=_natural_sort_key)


def read_cloud_files(
    path: Path,
    files: Sequence[Path],
    read_points: Callable[[Path], np.ndarray],
    hints: RecordingHints,
) -> Contents:
    """Read the points of all files as detections, a frame for each file.

    `read_points` returns (n,) with the fields of its points. Times are those of the file names, if
    these end with the ms, us or ns since 1970; else those of the radar if it was given. Points of a
    single file with a field `frame` are divided by it, with times in s of their field `time`.
    """
    n_bytes = sum(file.stat().st_size for file in files)
    if n_bytes > SMALL_BYTES:
        # Columns of double precision, and the points themselves.
        check_free_memory(
            f"the points of {path.name}", needed_bytes=5 * n_bytes, fix="read fewer of its files"
        )
    times_ns = _file_times_ns(files)
    radar = None if hints.settings is None else hints.settings.radar
    if times_ns is None and radar is not None:
        times_ns = [round(radar.frame.frame_start_s(n) * 1e9) for n in range(len(files))]
    clouds = []
    dtype = None
    for number, file in enumerate(files):
        if file != path:
            check_stays_in_folder(path, file)
        points = read_points(file)
        # Files of one recording have equal fields; others keep those of the first file.
        dtype = dtype or points.dtype
        if points.dtype != dtype:
            points = _with_fields_of(points, dtype)
        time_ns = None if times_ns is None else times_ns[number]
        clouds.append(PointCloud(time_ns=time_ns, frame_id="", points=points))
    if len(clouds) == 1 and "frame" in (clouds[0].points.dtype.names or ()):
        clouds = _divide_into_frames(clouds[0])
    return convert_clouds_to_contents(path, clouds, radar, source=path.name)


def _divide_into_frames(cloud: PointCloud) -> list[PointCloud]:
    """Return a cloud for each value of the field `frame`, in ascending order."""
    points = cloud.points[np.argsort(cloud.points["frame"], kind="stable")]
    starts = 1 + np.flatnonzero(np.diff(points["frame"]))
    clouds = []
    for frame_points in np.split(points, starts):
        time_s = np.nan
        if "time" in (points.dtype.names or ()) and len(frame_points):
            time_s = float(frame_points["time"][0])
        time_ns = round(time_s * NANO) if abs(time_s) < _MAX_TIME_S else None
        clouds.append(replace(cloud, time_ns=time_ns, points=frame_points))
    return clouds


def _natural_sort_key(file: Path) -> list[tuple[int, str]]:
    """Return the key of a name by which 2 comes before 10."""
    return [
        (int(part), "") if part.isdigit() else (-1, part)
        for part in re.split(r"([0-9]+)", file.name)
    ]


def _file_times_ns(files: Sequence[Path]) -> list[int] | None:
    """Return the times in the names of files; 0 for a single one, None without ascending times."""
    if len(files) == 1:
        return [0]
    times_ns = []
    for file in files:
        digits = re.findall(r"[0-9]+", file.name.partition(".")[0])
        unit_ns = _NS_OF_DIGITS.get(len(digits[-1])) if digits else None
        if unit_ns is None:
            return None
        times_ns.append(int(digits[-1]) * unit_ns)
    return times_ns if all(np.diff(np.array(times_ns)) > 0) else None


def _with_fields_of(points: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return points with the fields of a type; zero where they have none of that name."""
    converted = np.zeros(len(points), dtype)
    for name in dtype.names or ():
        if name in (points.dtype.names or ()):
            converted[name] = points[name]
    return converted
