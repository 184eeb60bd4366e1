"""Samples in pieces that stay in the cache, several threads at once, without a second cube."""

from collections.abc import Callable

import numba
import numpy as np

from dechirp.core.threads import in_threads, slices

_AT_ONCE = 2**16  # samples: 0.5 MiB in complex64


def in_pieces(samples: np.ndarray, work: Callable[[np.ndarray], None]) -> None:
    """Call `work` with some chirps at a time, (n_chirps, n_rx, n_samples), to change in place.

    `samples` (n_frames, n_chirps, n_rx, n_samples) is contiguous.
    """
    chirps = samples.reshape(-1, *samples.shape[2:])
    n_pieces = -(-samples.size // _AT_ONCE)
    parts = slices(len(chirps), max(1, min(n_pieces, len(chirps))))
    in_threads(numba.get_num_threads(), lambda part: work(chirps[part]), parts)
