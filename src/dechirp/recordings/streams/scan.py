"""One pass over a long file, without keeping it in memory."""

import mmap
from collections.abc import Callable
from pathlib import Path

import numpy as np

_WINDOW = 2**26  # bytes; scanned pages are released window by window


def scan_file_in_windows(
    path: Path,
    scan_window: Callable[[np.ndarray, int, int], tuple[int, np.ndarray]],
    start_offset: int,
) -> tuple[np.ndarray, int]:
    """Call a compiled scan function repeatedly, window by window.

    Parameters
    ----------
    path : Path
        A file that is not empty.
    scan_window : function
        Takes the bytes of the whole file, a start and a stop offset; returns the offset of the next
        record and rows (n, k) of results. It stops before the end of its window only where it
        cannot continue.
    start_offset : int
        Offset of the first record.

    Returns
    -------
    rows : (n, k) int64
    stopped : int
        Offset at which no further record could be read.
    """
    parts = []
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        content = np.frombuffer(mapped, np.uint8)
        offset = start_offset
        while offset < content.size:
            window_end = min((offset // _WINDOW + 1) * _WINDOW, content.size)
            next_offset, rows = scan_window(content, offset, window_end)
            parts.append(rows)
            if hasattr(mapped, "madvise") and next_offset > offset:
                passed = offset // mmap.PAGESIZE * mmap.PAGESIZE
                mapped.madvise(
                    mmap.MADV_DONTNEED, passed, max(min(next_offset, content.size) - passed, 1)
                )
            offset = next_offset
            if offset < window_end:
                break
        del content
    return np.concatenate(parts) if parts else np.empty((0, 0), np.int64), offset
