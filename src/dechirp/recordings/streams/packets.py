"""Packets of a DCA1000: assembly of their payloads, with findings about loss and disorder.

Runs of consecutive packets keep the index of an orderly capture short: one run per 64 MiB, and one
more for each loss.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.streams.byte_sources import FileSource, PacketSource

MAX_PAYLOAD_BYTES = 1456
"""Bytes of samples in a packet; the last packet of a capture has fewer."""

_MAX_COMPARED = 256  # duplicate packets compared with the first ones
_MAX_DIFFERENT = 8
"""Number of duplicate packets with other samples at which a capture is refused."""


@frozen_dataclass
class PacketTable:
    """Packets of files, (n,) each, in the order of arrival."""

    sequence: np.ndarray
    """Sequence number of the packet, from 1."""
    starts: np.ndarray
    """Bytes of samples sent before the packet."""
    offsets: np.ndarray
    """Position of the payload in the concatenated files."""
    sizes: np.ndarray
    """Bytes of the payload."""


ScanStep = Callable[[np.ndarray, int, int], tuple[int, np.ndarray]]


def wrap_scan_to_return_packet_runs(scan_packets: ScanStep) -> ScanStep:
    """Convert a step of `scan_file_in_windows` to one that returns runs instead of rows."""

    def run_step(content: np.ndarray, offset: int, stop: int) -> tuple[int, np.ndarray]:
        next_offset, rows = scan_packets(content, offset, stop)
        return next_offset, group_packets_into_runs(rows)

    return run_step


def group_packets_into_runs(packet_rows: np.ndarray) -> np.ndarray:
    """Group packets into runs of consecutive number, stream position and file position.

    Parameters
    ----------
    packet_rows : (n, k) int64
        For each packet: its number, the bytes sent before, offset and size of its payload, and
        other columns that must be equal within a run.

    Returns
    -------
    (m, k + 2) int64
        The row of the first packet of each run, their number, and their distance in the file.
    """
    steps = np.diff(packet_rows, axis=0)
    # Other traffic between packets only adds runs.
    distance = int(np.median(steps[:, 2])) if len(steps) else 0
    follows = (
        (steps[:, 0] == 1)
        & (steps[:, 1] == packet_rows[:-1, 3])
        & (steps[:, 2] == distance)
        & (steps[:, 3:] == 0).all(axis=1)
    )
    heads = np.flatnonzero(np.concatenate([[True], ~follows])[: len(packet_rows)])
    counts = np.diff(np.append(heads, len(packet_rows)))
    return np.column_stack([packet_rows[heads], counts, np.full(len(heads), distance)])


def last_sequence_number(runs: np.ndarray) -> int:
    """Return the number of the packet that arrived last."""
    return int(runs[-1, 0] + runs[-1, -2] - 1)


def _expand_runs_to_packets(runs: np.ndarray) -> PacketTable:
    """Expand runs to single packets."""
    counts = runs[:, -2]
    run = np.repeat(np.arange(len(runs)), counts)
    packet = np.arange(run.size) - np.repeat(np.cumsum(counts) - counts, counts)
    return PacketTable(
        sequence=runs[run, 0] + packet,
        starts=runs[run, 1] + packet * runs[run, 3],
        offsets=runs[run, 2] + packet * runs[run, -1],
        sizes=runs[run, 3],
    )


def assemble_packet_payloads(
    path: Path, files: FileSource, runs: np.ndarray
) -> tuple[PacketSource, tuple[Finding, ...]]:
    """Assemble payloads by their byte counters, not by arrival; return the stream and findings.

    Ordered runs need no further memory; other packets are sorted one by one, in 110 bytes each.

    Raises
    ------
    RecordingError
        If there are no packets, if jumps of their counters leave out most of the samples, or if
        duplicates differ.
    """
    if not runs.size:
        raise RecordingError(
            path,
            value="no packets of samples",
            expected="packets of a DCA1000, sent to port 4098",
            fix="capture while the radar is recording",
        )
    ends = runs[:, 1] + runs[:, 3] * runs[:, -2]
    numbers = runs[:, 0] + runs[:, -2] - 1
    if np.all(runs[1:, 1] >= ends[:-1]) and np.all(runs[1:, 0] > numbers[:-1]):
        stream = PacketSource(
            files=files,
            n_bytes=int(ends[-1]),
            starts=runs[:, 1],
            offsets=runs[:, 2],
            sizes=runs[:, 3],
            counts=runs[:, -2],
            spacings=runs[:, -1],
        )
        _check_counter_jumps(path, stream)
        return stream, ()
    return _sort_and_deduplicate_packets(path, files, _expand_runs_to_packets(runs))


def _sort_and_deduplicate_packets(
    path: Path, files: FileSource, packets: PacketTable
) -> tuple[PacketSource, tuple[Finding, ...]]:
    """Sort packets that are out of order or duplicated, and leave out a second capture."""
    packets, findings = _take_first_capture(packets)
    n_late = int(np.count_nonzero(np.diff(packets.sequence.astype(np.int64)) < 0))
    order = np.argsort(packets.starts, kind="stable")
    starts, sizes = packets.starts[order], packets.sizes[order]
    ends = np.maximum.accumulate(starts + sizes)
    is_new = np.concatenate([[True], starts[1:] >= ends[:-1]])
    unique = order[is_new]
    stream = PacketSource(
        files=files,
        n_bytes=int(ends[-1]),
        starts=packets.starts[unique],
        offsets=packets.offsets[unique],
        sizes=packets.sizes[unique],
        counts=np.ones(unique.size, np.int64),
        spacings=np.zeros(unique.size, np.int64),
    )
    _check_counter_jumps(path, stream)
    if n_late:
        findings += (
            _packet_order_note(f"{n_late} packets out of order, sorted by their counters"),
        )
    return stream, findings + _duplicate_packet_findings(path, stream, packets, order[~is_new])


def _check_counter_jumps(path: Path, stream: PacketSource) -> None:
    """Raise `RecordingError` if jumps of the counters leave out most of the samples."""
    received = int((stream.sizes * stream.counts).sum())
    span = stream.n_bytes - int(stream.starts[0])
    if span > 4 * received + 2**20:
        raise RecordingError(
            path,
            value=f"packets with {received} bytes of samples, whose counters span {span} bytes",
            expected="consecutive counters, with at most three quarters of the samples lost",
            fix="capture again; if several captures are in the file, split it",
        )


def _duplicate_packet_findings(
    path: Path, stream: PacketSource, packets: PacketTable, duplicates: np.ndarray
) -> tuple[Finding, ...]:
    """Report duplicate packets; raise `RecordingError` if too many differ from the first ones."""
    if not duplicates.size:
        return ()
    compared = duplicates[:: -(-duplicates.size // _MAX_COMPARED)]
    n_other = sum(_differs_from_kept_packet(stream, packets, index) for index in compared.tolist())
    description = f"{duplicates.size} duplicate packets, left out"
    if not n_other:
        return (_packet_order_note(description),)
    description += f"; {n_other} of {compared.size} compared differ from the first"
    # A few may be damaged packets with a wrong counter.
    if n_other >= _MAX_DIFFERENT:
        raise RecordingError(
            path,
            value=description,
            expected="packets of one radar and of one recording",
            fix="split the file by sender address if several boards sent at once, or by time if one"
            " board recorded several times",
        )
    return (replace(_packet_order_note(description), level="warning"),)


def _differs_from_kept_packet(stream: PacketSource, packets: PacketTable, index: int) -> bool:
    """Return whether a duplicate packet differs from the packet kept in its place."""
    first, second = np.empty((2, int(packets.sizes[index])), np.uint8)
    stream.read(int(packets.starts[index]), first)
    stream.files.read(int(packets.offsets[index]), second)
    # Zeros may come from a first packet that was cut short.
    return bool(np.any((first != second) & (first != 0)))


def _take_first_capture(packets: PacketTable) -> tuple[PacketTable, tuple[Finding, ...]]:
    """Return the packets before the numbers restart from 1, and a warning if they do."""
    sequence = packets.sequence.astype(np.int64)
    restarts = np.flatnonzero((sequence[1:] == 1) & (sequence[:-1] > 16)) + 1
    if not restarts.size:
        return packets, ()
    first_packets = slice(0, int(restarts[0]))
    finding = Finding(
        level="warning",
        setting="recording",
        value=f"{restarts.size + 1} captures in one file, of which the first is read",
        expected="one capture in a file",
        fix="split the file to read the others",
    )
    first = PacketTable(
        sequence=packets.sequence[first_packets],
        starts=packets.starts[first_packets],
        offsets=packets.offsets[first_packets],
        sizes=packets.sizes[first_packets],
    )
    return first, (finding,)


def _packet_order_note(value: str) -> Finding:
    """Return a note about the order of packets."""
    return Finding(
        level="note",
        setting="recording",
        value=value,
        expected="ordered packets without duplicates",
        fix="no action needed",
    )


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def read_unsigned(content: np.ndarray, offset: int, n_bytes: int, is_little_endian: bool) -> int:
    """Read an unsigned integer of at most 8 bytes, in either byte order."""
    value = np.int64(0)
    for i in range(n_bytes):
        value |= np.int64(content[offset + i]) << (8 * (i if is_little_endian else n_bytes - 1 - i))
    return int(value)
