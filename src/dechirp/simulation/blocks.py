"""In-place processing of samples in blocks that fit the cache, by several threads."""

from collections.abc import Callable

import numpy as np

from dechirp.core.threads import run_in_threads, split_range, thread_count

_BLOCK_SAMPLES = 2**16  # samples: 0.5 MiB in complex64


def apply_to_chirp_blocks(
    samples: np.ndarray, in_place_operation: Callable[[np.ndarray], None]
) -> None:
    """Apply `in_place_operation` in place to blocks of chirps, each (n_chirps, n_rx, n_samples).

    `samples` (n_frames, n_chirps, n_rx, n_samples) is contiguous.
    """
    chirps = samples.reshape(-1, *samples.shape[2:])
    n_pieces = -(-samples.size // _BLOCK_SAMPLES)
    parts = split_range(len(chirps), max(1, min(n_pieces, len(chirps))))
    run_in_threads(thread_count(), lambda part: in_place_operation(chirps[part]), parts)
