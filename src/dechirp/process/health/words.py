"""Chirps of frames as words."""

import numpy as np

from dechirp.core.spans import spans


def chirps_of_frames(flags: np.ndarray, frame_numbers: np.ndarray, *, at_most: int = 4) -> str:
    """Words for flags (frame, chirp): which chirps, and of which frames.

    Frames with the same chirps are named together, as where the first of each is damaged.
    """
    together: dict[bytes, list[int]] = {}
    for index in np.flatnonzero(flags.any(axis=1)):
        together.setdefault(flags[index].tobytes(), []).append(int(index))
    groups = list(together.values())
    parts = [
        f"{spans('chirp', np.flatnonzero(flags[indices[0]]))} of"
        f" {spans('frame', frame_numbers[indices])}"
        for indices in groups[:at_most]
    ]
    left = sum(len(indices) for indices in groups[at_most:])
    if left:
        parts.append(f"chirps of {left} more frames")
    return "; ".join(parts)
