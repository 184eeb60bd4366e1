"""Point clouds of float32 numbers without a header, one file a frame.

Rows of 4 numbers are x, y, z and intensity (KITTI); of 5 also the index of the ring (nuScenes); of
7 x, y, z, cross section, velocity, compensated velocity and time (radar of View-of-Delft); of 8
x, y, z, velocity, range, power, and the angles alpha and beta (TJ4DRadSet). Other rows need the
names of their numbers.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

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
_N_BLOCKS = 32  # of these rows
_MIN_ROWS = 16
_MAX_POSITION_M = 500.0


@frozen_dataclass
class FloatPoints(Format):
    """Detections in float32 files: rows of 4, 5, 7 or 8 numbers, as KITTI, nuScenes and others.

    A file, or a folder of such files (`.bin`), a frame each. `axes` names the numbers of other
    rows: x,y,z,velocity,snr.
    """

    options: ClassVar[tuple[str, ...]] = ("axes",)

    def recognise(self, path: Path) -> MatchQuality:
        files = list_cloud_files(path, ".bin")
        if not files or identify_non_raw_content(files[0]) is not None:
            return MatchQuality.NO
        return MatchQuality.NO if _count_columns(files) is None else MatchQuality.CONTAINER

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        files = list_cloud_files(path, ".bin" if hints.axes is None else "")
        for file in files[:1]:
            kind = identify_non_raw_content(file)
            if kind is not None:
                raise RecordingError(
                    file,
                    value=kind,
                    expected="float32 numbers without a header",
                    fix="remove --axes; formats with headers describe their points themselves",
                )
        n_columns = _count_columns(files) if files else None
        if hints.axes is None and n_columns is None:
            raise RecordingError(
                path,
                value="no rows of points of a known kind",
                expected="rows of 4, 5, 7 or 8 float32 numbers, x, y and z first, in a file or in a"
                " folder of .bin files alone",
                fix="name the numbers of a row, such as --axes x,y,z,velocity,snr",
            )
        fields = _FIELDS[n_columns or 4] if hints.axes is None else _check_fields(path, hints.axes)
        n_columns = len(fields)
        dtype = np.dtype([(name, "<f4") for name in fields])

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


def likely_row_length(path: Path) -> int | None:
    """Return how many float32 numbers a row of points may have, 4 to 12; None without evidence.

    Evidence are columns of one sign, or of whole numbers, beside columns of both signs, unless
    they alternate as I and Q do.
    """
    numbers = np.fromfile(path, "<f4", _HEAD_ROWS)
    n_bytes = path.stat().st_size
    for n_columns in range(4, 13):
        n_rows = len(numbers) // n_columns
        if n_bytes % (4 * n_columns) or n_rows < 4 * _MIN_ROWS:
            continue
        rows = numbers[: n_rows * n_columns].reshape(n_rows, n_columns)
        is_position = np.isfinite(rows).all() and (abs(rows[:, :3]) < _MAX_POSITION_M).all()
        is_signed = (rows.min(axis=0) < 0) & (rows.max(axis=0) > 0)
        is_whole = (rows == np.rint(rows)).all(axis=0)
        kinds = is_signed + 2 * is_whole
        alternates = np.array_equal(kinds[2:], kinds[:-2])
        if is_position and is_signed[:2].any() and not alternates:
            return n_columns
    return None


def _check_fields(path: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the numbers of a row; raise `RecordingError` if they are invalid."""
    if not {"x", "y"} <= {*names} or len({*names}) < len(names):
        raise RecordingError(
            path,
            value=f"axes {','.join(names)[:80]}",
            expected="a different name for each float32 number of a row, x and y among them",
            fix="write them in their order, such as --axes x,y,z,velocity,snr",
        )
    return tuple(names)


def _count_columns(files: Sequence[Path]) -> int | None:
    """Return the numbers of a row, by the largest file; None without evidence of points."""
    largest = max(files, key=lambda file: file.stat().st_size)
    return next((n_columns for n_columns in _FIELDS if _fits_rows(largest, n_columns)), None)


def _fits_rows(path: Path, n_columns: int) -> bool:
    """Return whether a file holds rows of points with this number of columns.

    Positions are within 500 m, of ordinary size, on both sides of the sensor, to the left and right
    or before and behind. Other columns have the values of their kind. Complex samples, of either
    sign in every column, meet this once in 2^16 files.
    """
    n_bytes = path.stat().st_size
    if n_bytes % (4 * n_columns) or n_bytes < 4 * n_columns * _MIN_ROWS:
        return False
    rows = _read_spread_rows(path, n_bytes // (4 * n_columns), n_columns)
    if not np.isfinite(rows).all():
        return False
    rows = rows.astype(float)
    positions = abs(rows[:, :3])
    is_ordinary = (positions < _MAX_POSITION_M) & ((positions > 1e-7) | (positions == 0))
    is_two_sided = (rows[:, :2].min(axis=0) < 0) & (rows[:, :2].max(axis=0) > 0)
    if not is_ordinary.all() or not is_two_sided.any():
        return False
    return _are_other_columns_plausible(rows)


def _read_spread_rows(path: Path, n_rows: int, n_columns: int) -> np.ndarray:
    """Read rows from the whole file: a scanner may write one sector after the other.

    In blocks: single rows of a mapped file of 1 GB, each in pages of its own, took 1 GB of memory.
    """
    if n_rows <= _HEAD_ROWS:
        return np.fromfile(path, "<f4").reshape(-1, n_columns)
    n_block_rows = _HEAD_ROWS // _N_BLOCKS
    starts = np.linspace(0, n_rows - n_block_rows, _N_BLOCKS).astype(int).tolist()
    blocks = [
        np.fromfile(path, "<f4", n_block_rows * n_columns, offset=4 * n_columns * start)
        for start in starts
    ]
    return np.concatenate(blocks).reshape(-1, n_columns)


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
