"""Packets of a DCA1000: payloads put in their places, and what became of the others.

They are kept as runs of packets that follow one another, so that the list of those of an orderly
capture, of any length, is short: 64 MiB have a run, and each loss begins another.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.streams.bytes_in import FilesIn, PacketsIn

LARGEST_PAYLOAD = 1456
"""Bytes of samples in a packet; the last of a capture has fewer."""

_MOST_COMPARED = 256
_MANY = 8
"""Packets that came twice, of which both are looked at, and how many of them may differ."""


@value
class Packets:
    """What was found in files, (n,) each, in the order of arrival."""

    sequence: np.ndarray
    """Number of the packet, counted from 1."""
    starts: np.ndarray
    """Bytes of samples that the radar had sent before."""
    offsets: np.ndarray
    """Place of the payload in the files, one after the other."""
    sizes: np.ndarray
    """Bytes of the payload."""


Step = Callable[[np.ndarray, int, int], tuple[int, np.ndarray]]


def in_runs(step: Step) -> Step:
    """Let a step of `walk` return runs in the place of rows: see `runs_of`."""

    def stepped(content: np.ndarray, at: int, stop: int) -> tuple[int, np.ndarray]:
        then, rows = step(content, at, stop)
        return then, runs_of(rows)

    return stepped


def runs_of(rows: np.ndarray) -> np.ndarray:
    """Runs of packets that follow one another in number, place and file.

    Parameters
    ----------
    rows : (n, k) int64
        Of each packet: its number, the bytes sent before, place and size of its payload, and
        what else has to be equal in a run.

    Returns
    -------
    (m, k + 2) int64
        The row of the first packet of each run, their number, and their distance in the file.
    """
    steps = np.diff(rows, axis=0)
    # Other traffic between packets only makes more runs.
    distance = int(np.median(steps[:, 2])) if len(steps) else 0
    follows = (
        (steps[:, 0] == 1)
        & (steps[:, 1] == rows[:-1, 3])
        & (steps[:, 2] == distance)
        & (steps[:, 3:] == 0).all(axis=1)
    )
    heads = np.flatnonzero(np.concatenate([[True], ~follows])[: len(rows)])
    counts = np.diff(np.append(heads, len(rows)))
    return np.column_stack([rows[heads], counts, np.full(len(heads), distance)])


def last_number(runs: np.ndarray) -> int:
    """Number of the packet that came last."""
    return int(runs[-1, 0] + runs[-1, -2] - 1)


def _every_packet(runs: np.ndarray) -> Packets:
    """Packets of runs, one by one."""
    counts = runs[:, -2]
    run = np.repeat(np.arange(len(runs)), counts)
    place = np.arange(run.size) - np.repeat(np.cumsum(counts) - counts, counts)
    return Packets(
        sequence=runs[run, 0] + place,
        starts=runs[run, 1] + place * runs[run, 3],
        offsets=runs[run, 2] + place * runs[run, -1],
        sizes=runs[run, 3],
    )


def in_places(
    path: Path, files: FilesIn, runs: np.ndarray
) -> tuple[PacketsIn, tuple[Finding, ...]]:
    """Payloads sorted by the bytes before them, not by arrival, and findings on the way.

    Of runs in order, nothing but them is held; others are looked at packet by packet, in 110
    bytes of memory each.

    Raises
    ------
    RecordingError
        If there are none, if their counters jump so far that most of the samples are missing,
        or if those of one place differ.
    """
    if not runs.size:
        raise RecordingError(
            path,
            got="a capture without a packet of samples",
            need="packets of samples, as a DCA1000 sends them to port 4098",
            fix="Capture while the radar is recording.",
        )
    ends = runs[:, 1] + runs[:, 3] * runs[:, -2]
    numbers = runs[:, 0] + runs[:, -2] - 1
    if np.all(runs[1:, 1] >= ends[:-1]) and np.all(runs[1:, 0] > numbers[:-1]):
        stream = PacketsIn(
            files=files,
            n_bytes=int(ends[-1]),
            starts=runs[:, 1],
            offsets=runs[:, 2],
            sizes=runs[:, 3],
            counts=runs[:, -2],
            distances=runs[:, -1],
        )
        _must_run_on(path, stream)
        return stream, ()
    return _sorted(path, files, _every_packet(runs))


def _sorted(path: Path, files: FilesIn, found: Packets) -> tuple[PacketsIn, tuple[Finding, ...]]:
    """Packets out of order, that came again, or of a second capture, in their places."""
    found, findings = _first_capture(found)
    late = int(np.count_nonzero(np.diff(found.sequence.astype(np.int64)) < 0))
    order = np.argsort(found.starts, kind="stable")
    starts, sizes = found.starts[order], found.sizes[order]
    ends = np.maximum.accumulate(starts + sizes)
    new = np.concatenate([[True], starts[1:] >= ends[:-1]])
    chosen = order[new]
    stream = PacketsIn(
        files=files,
        n_bytes=int(ends[-1]),
        starts=found.starts[chosen],
        offsets=found.offsets[chosen],
        sizes=found.sizes[chosen],
        counts=np.ones(chosen.size, np.int64),
        distances=np.zeros(chosen.size, np.int64),
    )
    _must_run_on(path, stream)
    if late:
        findings += (_note(f"{late} packets out of order, sorted by their counters"),)
    return stream, findings + _twice(path, stream, found, order[~new])


def _must_run_on(path: Path, stream: PacketsIn) -> None:
    """Raise `RecordingError` if counters jump so far that most of the samples are missing."""
    received = int((stream.sizes * stream.counts).sum())
    span = stream.n_bytes - int(stream.starts[0])
    if span > 4 * received + 2**20:
        raise RecordingError(
            path,
            got=f"packets with {received} bytes of samples, whose counters span {span} bytes",
            need="counters that run on, with at most three quarters lost",
            fix="Capture again; if several captures are in the file, split it.",
        )


def _twice(path: Path, kept: PacketsIn, found: Packets, again: np.ndarray) -> tuple[Finding, ...]:
    """What is said of packets that came again, which must hold what the first ones did."""
    if not again.size:
        return ()
    looked_at = again[:: -(-again.size // _MOST_COMPARED)]
    n_other = sum(_differs(kept, found, index) for index in looked_at.tolist())
    got = f"{again.size} packets that came twice, the second left out"
    if not n_other:
        return (_note(got),)
    got += f"; {n_other} of {looked_at.size} looked at hold other samples than the first"
    # A few may be damaged ones, of which the counter is wrong.
    if n_other >= _MANY:
        raise RecordingError(
            path,
            got=got,
            need="packets of one radar and of one recording",
            fix="Split the file: by the address of the sender where several boards sent at once,"
            " by time where one recorded several times.",
        )
    return (replace(_note(got), level="warning"),)


def _differs(kept: PacketsIn, found: Packets, index: int) -> bool:
    """Whether a packet that was left out holds other bytes than those kept in its place."""
    first, second = np.empty((2, int(found.sizes[index])), np.uint8)
    kept.read(int(found.starts[index]), first)
    kept.files.read(int(found.offsets[index]), second)
    # Of what is zero, the first may have been cut short.
    return bool(np.any((first != second) & (first != 0)))


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
