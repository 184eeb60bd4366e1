"""Lazy array of frames for xarray, which decodes a frame when its samples are loaded."""

from collections.abc import Callable
from typing import Any

import numpy as np
from xarray.backends import BackendArray
from xarray.backends.locks import SerializableLock
from xarray.core import indexing


class LazyFrames(BackendArray):
    """Samples (frame, chirp, rx, sample) of a recording, of which a frame is in memory at a time.

    Parameters
    ----------
    decode : function
        Writes the samples of a frame, by its number, into an array.
    frame_numbers : range
        Frames along the first axis.
    frame_shape : tuple of int
        Chirps, receivers and samples.
    dtype : dtype
        Type of the samples.
    """

    def __init__(
        self,
        decode: Callable[[int, np.ndarray], None],
        frame_numbers: range,
        frame_shape: tuple[int, ...],
        dtype: np.dtype,
    ) -> None:
        self._decode, self._frame_numbers = decode, frame_numbers
        self.shape, self.dtype = (len(frame_numbers), *frame_shape), dtype
        # Some formats keep a position in their file, so threads of Dask take turns.
        self._lock = SerializableLock()

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.OUTER, self._decode_part
        )

    def _decode_part(self, part: tuple[Any, ...]) -> np.ndarray:
        numbers = np.asarray(self._frame_numbers)[part[0]]
        samples = np.empty(self.shape[1:], self.dtype)
        out = np.empty((numbers.size, *_select_along_axes(samples, part[1:]).shape), self.dtype)
        for index, number in enumerate(np.ravel(numbers)):
            with self._lock:
                self._decode(int(number), samples)
                out[index] = _select_along_axes(samples, part[1:])
        return out if numbers.ndim else out[0]


def _select_along_axes(values: np.ndarray, keys: tuple[Any, ...]) -> np.ndarray:
    """Select by an integer, a slice or an array of integers along each axis independently."""
    for axis in reversed(range(len(keys))):  # from the last: an integer removes its axis
        values = values[(slice(None),) * axis + (keys[axis],)]
    return values
