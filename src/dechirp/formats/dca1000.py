"""TI DCA1000 captures (`.bin`): bare samples, or with the headers of their packets kept.

Of xWR16xx, 18xx and 68xx chips through two lanes, of xWR12xx and 14xx through four; see
`formats.samples.layouts`. Long captures are split (`adc_data_0.bin`, `adc_data_1.bin` ...), at
bytes, not at frames.

A file with headers (`*_Raw_0.bin` of mmWave Studio) has 14 bytes before each payload:
uint32 number, uint32 bytes of payload, uint48 bytes sent before.
"""

import re
from pathlib import Path
from typing import ClassVar

import numba
import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told, foreign
from dechirp.formats.kept import must_agree
from dechirp.formats.kept_beside import is_kept, read_kept
from dechirp.formats.samples.bare import bare_contents
from dechirp.formats.samples.layouts import FourLanes, Layout, TwoLanes
from dechirp.formats.settings.base import Settings
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.bytes_in import BytesIn, files_in
from dechirp.formats.streams.packets import (
    LARGEST_PAYLOAD,
    in_places,
    in_runs,
    last_number,
    runs_of,
)
from dechirp.formats.streams.walk import walk
from dechirp.formats.streams.whole_numbers import whole_number

_HEADER_BYTES = 14
SPLIT_BYTES = 2**29
"""Of a file: recorders split at 1 GB or more, and a short capture is never split."""


@value
class Dca1000(Format):
    """TI DCA1000 captures: bare samples (`.bin`), or with the headers of their packets.

    Bare samples: everything but their order comes from the settings. What `dechirp convert`
    wrote has its own beside it.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by nothing in the content being of another kind; bare samples have no mark."""
        if not path.is_file():
            return Fit.NO
        if is_kept(path):
            return Fit.OWN
        if has_headers(path):
            return Fit.CONTAINER
        return Fit.POSSIBLE if foreign(path) is None else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        if is_kept(path):
            kept = read_kept(path, None if told.settings is None else told.settings.radar)
            settings = kept.settings
            must_agree(path, told, device=settings.device, iq=settings.iq)
            return kept.of(bare_contents(path, files_in(path), layouts(settings), settings, told))
        settings = settings_for(path, told)
        stream, findings = _stream(path, settings)
        return bare_contents(
            path, stream, layouts(settings), settings.with_findings(*findings), told
        )


def layouts(settings: Settings) -> list[Layout]:
    """Orders in which a DCA1000 may have written the words, as far as the settings say."""
    alternating = FourLanes(receivers=settings.receivers_of(settings.radar.array.n_rx))
    if settings.interleaved is None:
        return [TwoLanes(), alternating]
    return [alternating] if settings.interleaved else [TwoLanes()]


def has_headers(path: Path) -> bool:
    """Whether packets with their headers are in a file, by the first two of them."""
    with path.open("rb") as file:
        first = file.read(_HEADER_BYTES)
        if len(first) < _HEADER_BYTES or int.from_bytes(first[4:8], "little") != LARGEST_PAYLOAD:
            return False
        file.seek(LARGEST_PAYLOAD, 1)
        second = file.read(_HEADER_BYTES)
    if not second:  # one packet in all, and not a byte more
        return path.stat().st_size == _HEADER_BYTES + LARGEST_PAYLOAD
    size = int.from_bytes(second[4:8], "little")
    one, two = (int.from_bytes(header[:4], "little") for header in (first, second))
    before_one, before_two = (int.from_bytes(header[8:], "little") for header in (first, second))
    # They may have come in the wrong order, or twice, but both counters run in step.
    in_step = before_two - before_one == (two - one) * LARGEST_PAYLOAD
    return 0 < size <= LARGEST_PAYLOAD and abs(two - one) < 2**16 and in_step


def _stream(path: Path, settings: Settings) -> tuple[BytesIn, tuple[Finding, ...]]:
    if has_headers(path):
        return _packets(path)
    parts = _parts(path, settings)
    return files_in(*parts), _joined(parts) + _torn_off(path, settings)


def _joined(parts: list[Path]) -> tuple[Finding, ...]:
    if len(parts) == 1:
        return ()
    return (
        Finding(
            level="note",
            setting="recording",
            got=f"{len(parts)} files of one capture, {parts[0].name} to {parts[-1].name}, joined",
            need="the parts of a split capture in the order of their numbers",
            fix="Nothing is to be done; move a file away that is not part of it.",
        ),
    )


def _torn_off(path: Path, settings: Settings) -> tuple[Finding, ...]:
    """Warn of a file in which a capture goes on that began in another: so do its frames."""
    name = re.fullmatch(r"(.*_)[1-9]\d*(\.\w+)", path.name)
    first = path if name is None else path.with_name(f"{name[1]}0{name[2]}")
    if first == path or not first.is_file() or path not in _parts(first, settings):
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            got=f"a part of the capture that begins in {first.name}, read by itself: its first"
            " frame may begin in the part before",
            need="the first part, to which the others are joined",
            fix=f"Open {first.name}.",
        ),
    )


def _packets(path: Path) -> tuple[BytesIn, tuple[Finding, ...]]:
    """Payloads of packets with their headers, of all the files over which they were split."""
    every, stopped = walk(path, in_runs(_headers), 0)
    parts, base = [path], 0
    while (following := next_part(parts)) is not None:
        begins = _goes_on(parts[-1], stopped, following, last_number(every))
        if begins is None:
            break
        across, at = begins
        across[:, 2] += base + stopped
        base += parts[-1].stat().st_size
        parts.append(following)
        found, stopped = walk(following, in_runs(_headers), at)
        if len(found):
            found[:, 2] += base
            across = np.concatenate([across, found])
        every = np.concatenate([every, across])
    packets, findings = in_places(path, files_in(*parts), every)
    if stopped < parts[-1].stat().st_size:
        findings += (_cut_packet(parts[-1], stopped),)
    return packets, _joined(parts) + findings


def _goes_on(
    before: Path, stopped: int, following: Path, number: int
) -> tuple[np.ndarray, int] | None:
    """Run, if any, of the packet across two files, and where in the second the next begins.

    None if the second does not go on where the first ends, at the packet after this number.
    """
    longest = _HEADER_BYTES + LARGEST_PAYLOAD
    with before.open("rb") as file:
        file.seek(stopped)
        rest = file.read(longest)
    with following.open("rb") as file:
        both = np.frombuffer(rest + file.read(longest), np.uint8)
    _, rows = _headers(both, 0, 1)
    if len(rest) == longest or not len(rows) or not 0 < rows[0, 0] - number < 2**16:
        return None
    if not rest:
        return runs_of(rows[:0]), 0
    return runs_of(rows[:1]), _HEADER_BYTES + int(rows[0, 3]) - len(rest)


def _parts(path: Path, settings: Settings) -> list[Path]:
    """Files of the capture that begins with this one: it alone, unless it was split.

    A capture that is whole in its first file may have others of the next number beside it.
    """
    name = re.fullmatch(r"(.*_)0(\.\w+)", path.name)
    size = path.stat().st_size
    if name is None or _is_whole(size, settings):
        return [path]
    parts = [path]
    while (following := next_part(parts)) is not None:
        # All but the last are full.
        if following.stat().st_size > size:
            break
        parts.append(following)
        if following.stat().st_size < size:
            break
    return parts


def next_part(parts: list[Path]) -> Path | None:
    """File of the next number, in the same folder; None if there is none."""
    first = parts[0]
    name = re.fullmatch(r"(.*_)0(\.\w+)", first.name)
    if name is None:
        return None
    following = first.with_name(f"{name[1]}{len(parts)}{name[2]}")
    is_there = following.is_file() and following.resolve().parent == first.resolve().parent
    return following if is_there else None


def _is_whole(size: int, settings: Settings) -> bool:
    radar = settings.radar
    sizes = [2 * lay.chirp_words(radar.frame.chirp, radar.array.n_rx) for lay in layouts(settings)]
    frame_bytes = [radar.frame.n_sent * size for size in sizes]
    if settings.n_frames is not None:
        return any(size >= settings.n_frames * one for one in frame_bytes)
    return size < SPLIT_BYTES and any(size % one == 0 for one in frame_bytes)


def _cut_packet(path: Path, stopped: int) -> Finding:
    size = path.stat().st_size
    return Finding(
        level="warning",
        setting="recording",
        got=f"{size - stopped} bytes of {path.name}, from byte {stopped} on, that are no whole"
        " packet, left out",
        need="whole packets to the end of the file",
        fix="If more than the end is missing, copy the file again from its source.",
    )


@numba.njit(cache=True)
def _headers(content: np.ndarray, at: int, stop: int) -> tuple[int, np.ndarray]:
    """Rows number, bytes before, place and size of the payload, of packets that begin here.

    All packets but the last of a capture are full; where they are tiny, nothing is to be won.
    """
    rows = np.empty(((stop - at) // 64 + 16, 4), np.int64)
    n = 0
    while at < stop and n < len(rows):
        if at + _HEADER_BYTES > content.size:
            break
        size = whole_number(content, at + 4, 4, True)
        if size < 1 or size > LARGEST_PAYLOAD or at + _HEADER_BYTES + size > content.size:
            break
        rows[n, 0] = whole_number(content, at, 4, True)
        rows[n, 1] = whole_number(content, at + 8, 6, True)
        rows[n, 2] = at + _HEADER_BYTES
        rows[n, 3] = size
        n += 1
        at += _HEADER_BYTES + size
    return at, rows[:n].copy()
