"""Point clouds of float32 numbers without a header, one file a frame.

Rows of 4 numbers are x, y, z and intensity (KITTI); of 5 also the index of the ring (nuScenes); of
7 x, y, z, cross section, velocity, compensated velocity and time (radar of View-of-Delft); of 8
x, y, z, velocity, range, power, and the angles alpha and beta (TJ4DRadSet).
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.messages.cloud_files import list_cloud_files, read_cloud_files
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    identify_non_raw_content,
)

_FIELDS = {
    8: ("x", "y", "z", "v_r", "range", "power", "alpha", "beta"),
    7: ("x", "y", "z", "rcs", "v_r", "v_r_compensated", "time"),
    5: ("x", "y", "z", "intensity", "ring"),
    4: ("x", "y", "z", "intensity"),
}
_HEAD_ROWS = 4096
_MIN_ROWS = 16
_MAX_POSITION_M = 500.0


@frozen_dataclass
class FloatPoints(Format):
    """Detections in float32 files: rows of 4, 5, 7 or 8 numbers, as KITTI, nuScenes and others.

    A file, or a folder of such files (`.bin`), a frame each.
    """

    def recognise(self, path: Path) -> MatchQuality:
        files = list_cloud_files(path, ".bin")
        if not files or identify_non_raw_content(files[0]) is not None:
            return MatchQuality.NO
        return MatchQuality.NO if _count_columns(files) is None else MatchQuality.CONTAINER

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        files = list_cloud_files(path, ".bin")
        n_columns = _count_columns(files)
        if n_columns is None:
            raise RecordingError(
                path,
                value=f"{files[0].stat().st_size} bytes that are no rows of points",
                expected="rows of 4, 5, 7 or 8 float32 numbers, x, y and z first",
                fix="save the points as PCD, which names its fields",
            )
        dtype = np.dtype([(name, "<f4") for name in _FIELDS[n_columns]])

        def read_points(file: Path) -> np.ndarray:
            n_bytes = file.stat().st_size
            if n_bytes % dtype.itemsize:
                raise RecordingError(
                    file,
                    value=f"{n_bytes} bytes",
                    expected=f"rows of {n_columns} float32 numbers, {dtype.itemsize} bytes each",
                    fix="copy the whole file again from its source",
                )
            return np.fromfile(file, dtype)

        return read_cloud_files(path, files, read_points, hints)


def _count_columns(files: Sequence[Path]) -> int | None:
    """Return the numbers of a row, by the largest file; None without evidence of points."""
    largest = max(files, key=lambda file: file.stat().st_size)
    return next((n_columns for n_columns in _FIELDS if _fits_rows(largest, n_columns)), None)


def _fits_rows(path: Path, n_columns: int) -> bool:
    """Return whether a file holds rows of points with this number of columns.

    Positions are within 500 m, of ordinary size, on both sides of the sensor. Other columns have
    the values of their kind. Complex samples, of either sign in every column, meet this once in
    2^16 files.
    """
    n_bytes = path.stat().st_size
    if n_bytes % (4 * n_columns) or n_bytes < 4 * n_columns * _MIN_ROWS:
        return False
    rows = np.fromfile(path, "<f4", _HEAD_ROWS * n_columns).reshape(-1, n_columns)
    if not np.isfinite(rows).all():
        return False
    rows = rows.astype(float)
    positions = abs(rows[:, :3])
    is_ordinary = (positions < _MAX_POSITION_M) & ((positions > 1e-7) | (positions == 0))
    y_m = rows[:, 1]
    if not is_ordinary.all() or not y_m.min() < 0 < y_m.max():
        return False
    return _are_other_columns_plausible(rows)


def _are_other_columns_plausible(rows: np.ndarray) -> bool:
    """Return whether the columns after the positions (x, y, z) have values of their kind.

    Intensities are not negative, rings and times are whole, ranges are those of the positions.
    """
    rest = rows[:, 3:]
    match rows.shape[1]:
        case 8:
            range_m = np.linalg.norm(rows[:, :3], axis=1)
            return bool(np.allclose(rest[:, 1], range_m, rtol=0.01, atol=0.01))
        case 7:
            is_whole = np.array_equal(rest[:, 3], np.rint(rest[:, 3]))
            return bool(is_whole and (abs(rest) < 200).all() and np.ptp(rest[:, 0]) > 0)
    is_intensity = (rest[:, 0] >= 0).all() and rest[:, 0].max() <= 65535 and np.ptp(rest[:, 0]) > 0
    if rows.shape[1] == 4:
        return bool(is_intensity)
    is_ring = np.array_equal(rest[:, 1], np.rint(rest[:, 1])) and (rest[:, 1] >= 0).all()
    return bool(is_intensity and is_ring and rest[:, 1].max() < 1024)
