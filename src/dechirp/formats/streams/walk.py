"""A long file looked through from end to end, without it staying in memory."""

import mmap
from collections.abc import Callable
from pathlib import Path

import numpy as np

_WINDOW = 2**26  # bytes; what was passed is handed back to the system in such parts


def walk(
    path: Path, step: Callable[[np.ndarray, int, int], tuple[int, np.ndarray]], start: int
) -> tuple[np.ndarray, int]:
    """Call a compiled step over and over, window by window.

    Parameters
    ----------
    path : Path
        A file that is not empty.
    step : function
        Takes the bytes of the whole file, where to begin and where to stop; returns where the
        next record begins and rows (n, k) of what it found. It stops early, before its
        window's end, only where it cannot go on.
    start : int
        Place of the first record.

    Returns
    -------
    rows : (n, k) int64
    stopped : int
        Place at which no further record could be read.
    """
    parts = []
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        content = np.frombuffer(mapped, np.uint8)
        at = start
        while at < content.size:
            window_end = min((at // _WINDOW + 1) * _WINDOW, content.size)
            then, rows = step(content, at, window_end)
            parts.append(rows)
            if hasattr(mapped, "madvise") and then > at:
                passed = at // mmap.PAGESIZE * mmap.PAGESIZE
                mapped.madvise(mmap.MADV_DONTNEED, passed, max(min(then, content.size) - passed, 1))
            at = then
            if at < window_end:
                break
        del content
    return np.concatenate(parts) if parts else np.empty((0, 0), np.int64), at
