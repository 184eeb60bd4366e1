"""Numbers of frames, chirps and receivers as words."""

from collections.abc import Iterable

import numpy as np


def spans(of: str, numbers: Iterable[int], *, at_most: int = 6) -> str:
    """Words for ascending numbers: `frames 3, 7 to 9 and 12`."""
    every = np.fromiter(numbers, np.int64)
    cuts = np.flatnonzero(np.diff(every) > 1) + 1
    runs = [(int(run[0]), int(run[-1])) for run in np.split(every, cuts) if run.size]
    parts = [f"{low}" if low == high else f"{low} to {high}" for low, high in runs[:at_most]]
    if len(runs) > at_most:
        parts.append(f"{len(runs) - at_most} more places")
    said = ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + "".join(parts[-1:])
    return f"{of}{'s' if every.size > 1 else ''} {said}"
