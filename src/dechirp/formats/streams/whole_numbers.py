"""Whole numbers in the headers of packets, for compiled loops over their bytes."""

import numba
import numpy as np


@numba.njit(cache=True)
def whole_number(content: np.ndarray, at: int, n: int, little: bool) -> int:
    """Whole number of n bytes, 8 at most; `little`: the least of them comes first."""
    made = np.int64(0)
    for i in range(n):
        made |= np.int64(content[at + i]) << (8 * (i if little else n - 1 - i))
    return int(made)
