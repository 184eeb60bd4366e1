"""Packets of a DCA1000: payloads put in their places, and what became of the others."""

from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.streams.bytes_in import PacketsIn

LARGEST_PAYLOAD = 1456
"""Bytes of samples in a packet; the last of a capture has fewer."""


@value
class Packets:
    """What was found in a file, (n,) each, in the order of arrival."""

    sequence: np.ndarray
    """Number of the packet, counted from 1."""
    starts: np.ndarray
    """Bytes of samples that the radar had sent before."""
    offsets: np.ndarray
    """Place of the payload in the file."""
    sizes: np.ndarray
    """Bytes of the payload."""


def in_places(path: Path, found: Packets) -> tuple[PacketsIn, tuple[Finding, ...]]:
    """Payloads sorted by the bytes before them, not by arrival, and findings on the way.

    Raises
    ------
    RecordingError
        If there are none, or their counters jump so far that most of the samples are missing.
    """
    if not found.sequence.size:
        raise RecordingError(
            path,
            got="a capture without a packet of samples",
            need="packets of samples, as a DCA1000 sends them to port 4098",
            fix="Capture while the radar is recording.",
        )
    found, findings = _first_capture(found)
    late = int(np.count_nonzero(np.diff(found.sequence.astype(np.int64)) < 0))
    order = np.argsort(found.starts, kind="stable")
    starts, sizes = found.starts[order], found.sizes[order]
    ends = np.maximum.accumulate(starts + sizes)
    new = np.concatenate([[True], starts[1:] >= ends[:-1]])
    chosen = order[new]
    stream = PacketsIn(
        path=path,
        n_bytes=int(ends[-1]),
        starts=found.starts[chosen],
        offsets=found.offsets[chosen],
        sizes=found.sizes[chosen],
    )
    received = int(stream.sizes.sum())
    span = stream.n_bytes - int(stream.starts[0])
    if span > 4 * received + 2**20:
        raise RecordingError(
            path,
            got=f"packets with {received} bytes of samples, whose counters span {span} bytes",
            need="counters that run on, with at most three quarters lost",
            fix="Capture again; if several captures are in the file, split it.",
        )
    if late:
        findings += (_note(f"{late} packets out of order, sorted by their counters"),)
    if n_twice := int(np.count_nonzero(~new)):
        findings += (_note(f"{n_twice} packets that came twice, the second left out"),)
    return stream, findings


def _first_capture(found: Packets) -> tuple[Packets, tuple[Finding, ...]]:
    """Packets up to where the numbers begin again from 1."""
    sequence = found.sequence.astype(np.int64)
    begins = np.flatnonzero((sequence[1:] == 1) & (sequence[:-1] > 16)) + 1
    if not begins.size:
        return found, ()
    kept = slice(0, int(begins[0]))
    finding = Finding(
        level="warning",
        setting="recording",
        got=f"{begins.size + 1} captures, one after the other: the first is read",
        need="one capture in a file",
        fix="Split the file to read the others.",
    )
    first = Packets(
        sequence=found.sequence[kept],
        starts=found.starts[kept],
        offsets=found.offsets[kept],
        sizes=found.sizes[kept],
    )
    return first, (finding,)


def _note(got: str) -> Finding:
    return Finding(
        level="note",
        setting="recording",
        got=got,
        need="packets in order, each once",
        fix="Nothing is to be done.",
    )
