"""Bytes of a recording in the order in which the radar sent them, wherever they lie."""

from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.values import value

_NOTHING_LOST = np.empty((0, 2), np.int64)


class BytesIn(ABC):
    """A stream of bytes on disk, of which any part can be read; nothing is kept."""

    n_bytes: int

    @abstractmethod
    def read(self, start: int, into: np.ndarray) -> None:
        """Fill `into`, uint8, with the bytes from `start` on; lost ones with zeros."""

    @property
    def lost(self) -> np.ndarray:
        """(n, 2): first byte, and the one after the last, of each part that never arrived."""
        return _NOTHING_LOST


@value
class FilesIn(BytesIn):
    """Files, one after the other."""

    paths: tuple[Path, ...]
    sizes: tuple[int, ...]
    n_bytes: int
    """Bytes of all files together."""

    def read(self, start: int, into: np.ndarray) -> None:
        """See `BytesIn.read`."""
        begin, filled = 0, 0
        for path, size in zip(self.paths, self.sizes, strict=True):
            first = start + filled - begin
            if 0 <= first < size and filled < into.size:
                part = into[filled : filled + size - first]
                _fill(path, first, part)
                filled += part.size
            begin += size


def files_in(*paths: Path) -> FilesIn:
    """Files, one after the other, with their sizes as they are now."""
    sizes = tuple(path.stat().st_size for path in paths)
    return FilesIn(paths=paths, sizes=sizes, n_bytes=sum(sizes))


@value
class PacketsIn(BytesIn):
    """Payloads of packets in files, which may have come in any order, twice or not at all.

    Kept as runs of packets of one size that follow one another; sorted by `starts`, without
    overlap.
    """

    files: FilesIn
    n_bytes: int
    starts: np.ndarray
    """(n,) int64: place in the stream of the first byte of each run."""
    offsets: np.ndarray
    """(n,) int64: its place in the files, one after the other."""
    sizes: np.ndarray
    """(n,) int64: bytes of the payload of each of its packets."""
    counts: np.ndarray
    """(n,) int64: its packets."""
    distances: np.ndarray
    """(n,) int64: from one of their payloads to the next in the files."""

    def read(self, start: int, into: np.ndarray) -> None:
        """See `BytesIn.read`."""
        into[:] = 0
        stop = start + into.size
        first = int(np.searchsorted(self.starts, start, side="right")) - 1
        chosen = slice(max(first, 0), int(np.searchsorted(self.starts, stop)))
        starts, offsets, sizes = self._packets(chosen, start, stop)
        if not starts.size:
            return
        # One read of the part of the file in which they lie; in order, that is 1 % more than
        # the payloads. Packets far out of order are read one by one.
        low, high = int(offsets.min()), int((offsets + sizes).max())
        if high - low <= 2 * into.size + 2**16:
            block = np.empty(high - low, np.uint8)
            self.files.read(low, block)
        else:
            block = None
        for at, offset, size in zip(starts.tolist(), offsets.tolist(), sizes.tolist(), strict=True):
            skip, end = max(start - at, 0), min(stop - at, size)
            if end <= skip:
                continue
            part = into[at + skip - start : at + end - start]
            if block is None:
                self.files.read(offset + skip, part)
            else:
                part[:] = block[offset + skip - low : offset + end - low]

    def _packets(self, runs: slice, start: int, stop: int) -> tuple[np.ndarray, ...]:
        """Starts, offsets and sizes of those packets of some runs that hold bytes of a part."""
        starts, sizes = self.starts[runs], self.sizes[runs]
        first = np.maximum((start - starts) // sizes, 0)
        n_packets = np.minimum(-((starts - stop) // sizes), self.counts[runs]) - first
        n_packets = np.maximum(n_packets, 0)
        run = np.repeat(np.arange(n_packets.size), n_packets)
        skipped = np.repeat(np.cumsum(n_packets) - n_packets, n_packets)
        place = np.arange(run.size) - skipped + first[run]
        return (
            starts[run] + place * sizes[run],
            self.offsets[runs][run] + place * self.distances[runs][run],
            sizes[run],
        )

    @property
    def lost(self) -> np.ndarray:
        """See `BytesIn.lost`."""
        ends = np.concatenate([[0], self.starts + self.sizes * self.counts])
        begins = np.concatenate([self.starts, [self.n_bytes]])
        return np.stack([ends, begins], axis=1)[begins > ends]


def _fill(path: Path, start: int, into: np.ndarray) -> None:
    """Read one part of a file that must hold it."""
    with path.open("rb", buffering=0) as file:
        file.seek(start)
        view, filled = into.data, 0
        while filled < into.size:
            got = file.readinto(view[filled:])
            if not got:
                raise RecordingError(
                    path,
                    got=f"shorter than when it was opened, by at least {into.size - filled} bytes",
                    need="a file that stays as it is while it is read",
                    fix="Open it again, when nothing writes to it.",
                )
            filled += got
