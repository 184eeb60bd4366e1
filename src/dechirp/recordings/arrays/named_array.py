"""Arrays with named axes, read frame by frame in the order in which the chirps were sent."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.arrays.lazy_array import (
    ALLOWED_BYTES,
    ArrayPart,
    LazyArray,
    complex_field_names,
    memory_exceeds_file_error,
)
from dechirp.recordings.settings.base import Iq

AXES = ("frame", "chirp", "tx", "rx", "element", "sample", "iq")
"""Accepted axis names. `element` counts pairs of a transmitter and a receiver, all receivers of
the first transmitter first; without `element` and `tx`, chirps are in the order sent.
"""

_PIECE_BYTES = 2**24


@frozen_dataclass
class NamedArray:
    """An array with named axes, read frame by frame."""

    path: Path
    array: LazyArray
    sizes: dict[str, int]
    """Sizes by axis name, in the order of the array."""
    tx_order: tuple[int, ...]
    """Transmitter of each chirp of a TDM round; empty if several send at once."""
    is_complex: bool
    iq: Iq | None

    @property
    def sent_chirps_per_chirp_index(self) -> int:
        """Chirps sent for each index of the axis `chirp`."""
        return len(self.tx_order) if {"tx", "element"} & set(self.sizes) else 1

    @property
    def bytes_per_chirp_index(self) -> int:
        """Size of the data at one index of the axis `chirp`, in one frame."""
        inner_sizes = (size for name, size in self.sizes.items() if name not in ("frame", "chirp"))
        return math.prod(inner_sizes) * self.array.dtype.itemsize

    @property
    def reads_whole_frames(self) -> bool:
        """True if reading a part of a frame takes as long as reading all of it."""
        return self.array.outer_axis is not None

    @property
    def bytes_to_decompress_per_frame(self) -> int:
        """Bytes to decompress for a frame; 0 if any part can be read separately."""
        if self.array.outer_axis is None:
            return 0
        whole = math.prod(self.array.shape) * self.array.dtype.itemsize
        return whole // self.sizes["frame"] if self.is_sequential_by_frame else whole

    @property
    def is_sequential_by_frame(self) -> bool:
        """True if consecutive frames follow one another in the sequential data."""
        return (
            self.array.outer_axis is not None and list(self.sizes)[self.array.outer_axis] == "frame"
        )

    def check_frame_memory(self, file_bytes: int) -> None:
        """Raise `RecordingError` if a frame needs more memory than the file allows."""
        n_bytes = self.bytes_to_decompress_per_frame
        if n_bytes > 2 * file_bytes + ALLOWED_BYTES:
            description = f"{n_bytes} bytes to decompress for a frame"
            raise memory_exceeds_file_error(self.path, description, file_bytes=file_bytes)

    def iter_chirp_blocks(
        self, frame_index: int, is_chirp_lost: np.ndarray | None = None
    ) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the chirps of a frame in the order sent, some MB at a time.

        Each item is the number of the first chirp, and real numbers: the samples (chirp, rx,
        sample), or I and Q of complex ones (chirp, rx, sample, 2). Chirps that are lost come out
        as zeros.
        """
        n_chirps = self.sizes.get("chirp", 1)
        step = max(1, _PIECE_BYTES // self.bytes_per_chirp_index)
        per_read = n_chirps if self.reads_whole_frames else self._round_up_to_chunks(step)
        for start in range(0, n_chirps, per_read):
            chirps = slice(start, min(start + per_read, n_chirps))
            block = self.array.read(self._slices_of_frame_chirps(frame_index, chirps))
            for first in range(0, chirps.stop - start, step):
                rows = self._slices_along_chirp_axis(slice(first, first + step))
                chirp_block = _reorder_to_sent_chirps(block[rows], list(self.sizes), self.tx_order)
                first_chirp = (start + first) * self.sent_chirps_per_chirp_index
                if is_chirp_lost is not None:
                    is_block_lost = is_chirp_lost[first_chirp : first_chirp + len(chirp_block)]
                    if is_block_lost.any():
                        chirp_block = np.where(
                            is_block_lost.reshape(-1, *[1] * (chirp_block.ndim - 1)), 0, chirp_block
                        )
                yield first_chirp, self._as_real_numbers(chirp_block)

    def _round_up_to_chunks(self, n_chirps: int) -> int:
        """Return the number of chirps to read at a time so that no chunk is read twice."""
        if self.array.chunk is None or "chirp" not in self.sizes:
            return n_chirps
        in_chunk = self.array.chunk[list(self.sizes).index("chirp")]
        return -(-n_chirps // in_chunk) * in_chunk

    def _slices_of_frame_chirps(self, frame_index: int, chirps: slice) -> ArrayPart:
        """Return the part of the array with some chirps of a frame."""
        narrowed = {"frame": slice(frame_index, frame_index + 1), "chirp": chirps}
        return tuple(narrowed.get(name, slice(0, size)) for name, size in self.sizes.items())

    def _slices_along_chirp_axis(self, rows: slice) -> ArrayPart:
        """Return slices that select rows along the axis `chirp`."""
        return tuple(rows if name == "chirp" else slice(None) for name in self.sizes)

    def _as_real_numbers(self, block: np.ndarray) -> np.ndarray:
        """Return real samples as they are; I and Q of complex ones as last axis."""
        if not self.is_complex:
            return block
        if block.dtype.kind == "c":
            block = np.ascontiguousarray(block)
            block = block.view(block.real.dtype).reshape(*block.shape, 2)
        return block[..., ::-1] if self.iq == "qi" else block

    def non_finite_samples_error(
        self, frame_index: int, is_chirp_lost: np.ndarray
    ) -> RecordingError:
        """Return the error of a frame with non-finite samples: number and first position."""
        n_bad, n_samples, position = 0, 0, ""
        for number, block in self.iter_chirp_blocks(frame_index, is_chirp_lost):
            is_bad = ~finite_mask(block).reshape(*block.shape[:3], -1).all(axis=-1)
            if is_bad.any() and not n_bad:
                chirp, rx, sample = np.argwhere(is_bad)[0]
                position = f"chirp {number + chirp}, rx {rx}, sample {sample}"
            n_bad += int(np.count_nonzero(is_bad))
            n_samples += is_bad.size
        return RecordingError(
            self.path,
            value=f"{n_bad} of {n_samples} samples of frame {frame_index} not finite, the first at"
            f" {position}",
            expected="finite numbers (no NaN, no infinity)",
            fix="record it again, or replace those samples before saving",
        )

    def unwritten_chirp_mask(self, n_chirps_sent: int) -> np.ndarray | None:
        """Return (frame, chirp), True where samples were never written; None if all were."""
        if self.array.absent_chunks is None:
            return None
        names, chunk = list(self.sizes), self.array.chunk or self.array.shape
        gaps = np.zeros((self.sizes.get("frame", 1), n_chirps_sent), bool)
        for place in self.array.absent_chunks:
            first = dict(zip(names, place * chunk, strict=True))
            last = dict(zip(names, (place + 1) * chunk, strict=True))
            frames = slice(first.get("frame", 0), last.get("frame", 1))
            chirps = slice(
                first.get("chirp", 0) * self.sent_chirps_per_chirp_index,
                last.get("chirp", 1) * self.sent_chirps_per_chirp_index,
            )
            gaps[frames, chirps] = True
        return gaps


def finite_mask(numbers: np.ndarray) -> np.ndarray:
    """Return where numbers are finite: everywhere for integers."""
    if numbers.dtype.kind in "iu":
        return np.broadcast_to(np.True_, numbers.shape)
    return np.isfinite(numbers)


def _reorder_to_sent_chirps(
    block: np.ndarray, axis_names: list[str], tx_order: tuple[int, ...]
) -> np.ndarray:
    """Return samples (chirp, rx, sample), perhaps with iq, the chirps in the order sent."""
    fields = complex_field_names(block.dtype)
    if fields:
        block = np.stack([block[fields[0]], block[fields[1]]], axis=-1)
        axis_names = [*axis_names, "iq"]
    order = [name for name in AXES if name in axis_names]
    block = np.transpose(block, [axis_names.index(name) for name in order])
    if "element" in axis_names:
        axis = order.index("element")
        block = block.reshape(*block.shape[:axis], len(tx_order), -1, *block.shape[axis + 1 :])
        order[axis : axis + 1] = ["tx", "rx"]
    all_axes = ("frame", "chirp", "tx", "rx", "sample")
    block = np.expand_dims(
        block, tuple(axis for axis, name in enumerate(all_axes) if name not in order)
    )[0]
    if "tx" in order and len(tx_order) > 1:
        block = block.take(tx_order, axis=1)
    return block.reshape(-1, *block.shape[2:])
