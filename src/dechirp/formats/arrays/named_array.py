"""An array whose axes have names, read frame by frame in the order the chirps were sent."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value
from dechirp.formats.arrays.stored import ALLOWED_BYTES, Part, Stored, pair, too_large
from dechirp.formats.settings.base import Iq

AXES = ("frame", "chirp", "tx", "rx", "element", "sample", "iq")
"""What an axis can be. `element` counts pairs of a transmitter and a receiver, all receivers
of the first transmitter first; without it and without `tx`, chirps are in the order sent."""

_PIECE_BYTES = 2**24


@value
class NamedArray:
    """An array with names, read frame by frame."""

    path: Path
    stored: Stored
    sizes: dict[str, int]
    """By name of axis, in the order of the array."""
    turns: tuple[int, ...]
    """Transmitter of each chirp of a round; empty where several send in a chirp."""
    is_complex: bool
    iq: Iq | None

    @property
    def per_round(self) -> int:
        """Chirps sent for each one along the axis `chirp`."""
        return len(self.turns) if {"tx", "element"} & set(self.sizes) else 1

    @property
    def chirp_bytes(self) -> int:
        """Size of what lies at one place of the axis `chirp`, in one frame."""
        counted = (size for name, size in self.sizes.items() if name not in ("frame", "chirp"))
        return math.prod(counted) * self.stored.dtype.itemsize

    @property
    def reads_whole_frames(self) -> bool:
        """Whether a part of a frame takes as long to read as all of it."""
        return self.stored.outer is not None

    @property
    def unpacked_for_a_frame(self) -> int:
        """Bytes that have to be unpacked for a frame; 0 where any part can be read alone."""
        if self.stored.outer is None:
            return 0
        whole = math.prod(self.stored.shape) * self.stored.dtype.itemsize
        return whole // self.sizes["frame"] if self.goes_on_by_frame else whole

    @property
    def goes_on_by_frame(self) -> bool:
        """Whether the frames lie one after the other in what is unpacked in its order."""
        return self.stored.outer is not None and list(self.sizes)[self.stored.outer] == "frame"

    def must_be_bounded(self, file_bytes: int) -> None:
        """Raise `RecordingError` if more has to be held for a frame than the file is worth."""
        held = self.unpacked_for_a_frame
        if held > 2 * file_bytes + ALLOWED_BYTES:
            what = f"{held} bytes to be held for a frame of its array"
            raise too_large(self.path, what, file_bytes=file_bytes)

    def pieces(
        self, index: int, lost: np.ndarray | None = None
    ) -> Iterator[tuple[int, list[np.ndarray]]]:
        """Chirps of a frame in the order sent, some MB at a time.

        With the number of the first, the real samples, or both parts of complex ones, each
        (chirp, rx, sample). Chirps that are `lost` come out as zeros.
        """
        n_chirps = self.sizes.get("chirp", 1)
        step = max(1, _PIECE_BYTES // self.chirp_bytes)
        per_read = n_chirps if self.reads_whole_frames else self._whole_chunks(step)
        for start in range(0, n_chirps, per_read):
            chirps = slice(start, min(start + per_read, n_chirps))
            block = self.stored.read(self._part(index, chirps))
            for first in range(0, chirps.stop - start, step):
                rows = self._along_chirp(slice(first, first + step))
                sent = _in_order_sent(block[rows], list(self.sizes), self.turns)
                number = (start + first) * self.per_round
                if lost is not None:
                    gone = lost[number : number + len(sent)]
                    if gone.any():
                        sent = np.where(gone.reshape(-1, *[1] * (sent.ndim - 1)), 0, sent)
                yield number, self._parts(sent)

    def _whole_chunks(self, step: int) -> int:
        """Chirps to read at a time, so that no piece of the file is read twice."""
        if self.stored.chunk is None or "chirp" not in self.sizes:
            return step
        in_chunk = self.stored.chunk[list(self.sizes).index("chirp")]
        return -(-step // in_chunk) * in_chunk

    def _part(self, index: int, chirps: slice) -> Part:
        narrowed = {"frame": slice(index, index + 1), "chirp": chirps}
        return tuple(narrowed.get(name, slice(0, size)) for name, size in self.sizes.items())

    def _along_chirp(self, rows: slice) -> Part:
        return tuple(rows if name == "chirp" else slice(None) for name in self.sizes)

    def _parts(self, block: np.ndarray) -> list[np.ndarray]:
        if not self.is_complex:
            return [block]
        if block.dtype.kind == "c":
            parts = [block.real, block.imag]
        else:
            parts = [block[..., 0], block[..., 1]]
        return parts[::-1] if self.iq == "qi" else parts

    def not_finite(self, index: int, lost: np.ndarray) -> RecordingError:
        """Error of a frame with samples that are not finite: how many, and the first."""
        n_bad, n_samples, where = 0, 0, ""
        for number, parts in self.pieces(index, lost):
            bad = ~np.logical_and.reduce([is_finite(part) for part in parts])
            if bad.any() and not n_bad:
                chirp, rx, sample = np.argwhere(bad)[0]
                where = f"chirp {number + chirp}, rx {rx}, sample {sample}"
            n_bad += int(np.count_nonzero(bad))
            n_samples += bad.size
        return RecordingError(
            self.path,
            got=f"a recording with {n_bad} of {n_samples} samples of frame {index} not finite,"
            f" the first at {where}",
            need="finite numbers (no NaN, no infinity)",
            fix="Record it again, or replace those samples before saving.",
        )

    def gaps(self, n_sent: int) -> np.ndarray | None:
        """(frame, chirp), True where samples were never written; None where all were."""
        if self.stored.absent is None:
            return None
        names, chunk = list(self.sizes), self.stored.chunk or self.stored.shape
        gaps = np.zeros((self.sizes.get("frame", 1), n_sent), bool)
        for place in self.stored.absent:
            first = dict(zip(names, place * chunk, strict=True))
            last = dict(zip(names, (place + 1) * chunk, strict=True))
            frames = slice(first.get("frame", 0), last.get("frame", 1))
            chirps = slice(
                first.get("chirp", 0) * self.per_round, last.get("chirp", 1) * self.per_round
            )
            gaps[frames, chirps] = True
        return gaps


def is_finite(numbers: np.ndarray) -> np.ndarray:
    """Where numbers are neither NaN nor infinite: everywhere for integers."""
    if numbers.dtype.kind in "iu":
        return np.broadcast_to(np.True_, numbers.shape)
    return np.isfinite(numbers)


def _in_order_sent(block: np.ndarray, names: list[str], turns: tuple[int, ...]) -> np.ndarray:
    """Samples (chirp, rx, sample) and perhaps iq, the chirps in the order they were sent."""
    fields = pair(block.dtype)
    if fields:
        block = np.stack([block[fields[0]], block[fields[1]]], axis=-1)
        names = [*names, "iq"]
    order = [name for name in AXES if name in names]
    block = np.transpose(block, [names.index(name) for name in order])
    if "element" in names:
        at = order.index("element")
        block = block.reshape(*block.shape[:at], len(turns), -1, *block.shape[at + 1 :])
        order[at : at + 1] = ["tx", "rx"]
    wanted = ("frame", "chirp", "tx", "rx", "sample")
    block = np.expand_dims(block, [at for at, name in enumerate(wanted) if name not in order])[0]
    if "tx" in order and len(turns) > 1:
        block = block.take(turns, axis=1)
    return block.reshape(-1, *block.shape[2:])
