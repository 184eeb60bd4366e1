"""Frames of TI's people-counting viewer: points and targets of each frame, without magic words.

The viewer saves what it received as `fHist*.bin`: frame number and number of items (32-bit words),
then items: type, length, content. A point (type 6) is four floats: range, azimuth, velocity and
signal-to-noise ratio, linear. A target (type 7) has 28 bytes: number, then x, y and the velocities
and accelerations along them. A byte for each point (type 8) is the number of its target.

TI, People Counting Demo, mmWave industrial toolbox (point cloud and target list TLVs).
"""

import struct
from array import array

import numpy as np

from dechirp.core.values import frozen_dataclass

_POINTS, _TARGETS, _TARGET_OF_POINT = 6, 7, 8
_ITEM_BYTES = {_POINTS: 16, _TARGETS: 28, _TARGET_OF_POINT: 1}
_MAX_ITEM_BYTES = 2**16
_MAX_FRAME_STEP = 2**16
_MAX_RANGE_M, _MAX_SPEED_M_PER_S = 1e3, 1e2  # a float with a wrong bit is mostly far larger


@frozen_dataclass
class ViewerFrames:
    """Frames of a file, as far as they are complete."""

    frame_numbers: np.ndarray
    counts: np.ndarray
    """Number of points of each frame."""
    points: np.ndarray
    """(point, 4): range, azimuth (to the right), velocity, signal-to-noise ratio."""
    target_counts: np.ndarray
    """Number of targets that the radar tracked in each frame."""
    n_bytes_left: int
    """Bytes after the last complete frame."""


def parse_viewer_frames(content: bytes) -> ViewerFrames:
    """Parse frames up to the first that is incomplete or implausible."""
    numbers, counts, target_counts, points = array("q"), array("q"), array("q"), []
    end = 0
    while end + 8 <= len(content):
        number, n_items = struct.unpack_from("<2I", content, end)
        step = number - numbers[-1] if numbers else 1
        items = _locate_items(content, end + 8, n_items)
        if items is None or not 0 < step <= _MAX_FRAME_STEP:
            break
        offset, n_bytes = items.get(_POINTS, (0, 0))
        frame_points = np.frombuffer(content[offset : offset + n_bytes], "<f4").reshape(-1, 4)
        if not _are_plausible(frame_points):
            break
        numbers.append(number)
        counts.append(len(frame_points))
        points.append(frame_points)
        target_counts.append(items.get(_TARGETS, (0, 0))[1] // _ITEM_BYTES[_TARGETS])
        end = max([end + 8, *(offset + n_bytes for offset, n_bytes in items.values())])
    return ViewerFrames(
        frame_numbers=np.array(numbers, np.int64),
        counts=np.array(counts, np.int64),
        points=np.concatenate(points) if points else np.empty((0, 4), np.float32),
        target_counts=np.array(target_counts, np.int64),
        n_bytes_left=len(content) - end,
    )


def _locate_items(content: bytes, offset: int, n_items: int) -> dict[int, tuple[int, int]] | None:
    """Return offset and size of the content of each item; None unless all are complete."""
    items: dict[int, tuple[int, int]] = {}
    if n_items > len(_ITEM_BYTES):
        return None
    for _ in range(n_items):
        if offset + 8 > len(content):
            return None
        kind, n_bytes = struct.unpack_from("<2I", content, offset)
        offset += 8
        is_valid = kind in _ITEM_BYTES and kind not in items and n_bytes <= _MAX_ITEM_BYTES
        if not is_valid or n_bytes % _ITEM_BYTES[kind] or offset + n_bytes > len(content):
            return None
        items[kind] = offset, n_bytes
        offset += n_bytes
    return items


def _are_plausible(points: np.ndarray) -> bool:
    """Return whether the numbers of points can be those of a radar; False for NaN."""
    distance, azimuth, velocity, snr = points.T
    return bool(
        np.all((distance >= 0) & (distance < _MAX_RANGE_M))
        and np.all(np.abs(azimuth) <= np.pi)
        and np.all(np.abs(velocity) < _MAX_SPEED_M_PER_S)
        and np.all((snr >= 0) & (snr < np.inf))
    )
