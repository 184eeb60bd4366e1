"""Network captures (pcap, pcapng) of what a DCA1000 sends.

Samples come to UDP port 4098: uint32 number from 1, uint48 bytes sent before, payload. They
are put in their places by the bytes before them, not by arrival.

pcap: https://www.ietf.org/archive/id/draft-ietf-opsawg-pcap; pcapng: draft-ietf-opsawg-pcapng.
"""

import struct
from pathlib import Path
from typing import ClassVar

import numba
import numpy as np

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.dca1000 import layouts
from dechirp.formats.samples.bare import bare_contents
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.bytes_in import files_in
from dechirp.formats.streams.packets import in_places, in_runs
from dechirp.formats.streams.walk import walk
from dechirp.formats.streams.whole_numbers import whole_number

_DATA_PORT = 4098
_PCAP = {  # first bytes: of seconds and micro- or nanoseconds, in either order of bytes
    b"\xd4\xc3\xb2\xa1": "<",
    b"\x4d\x3c\xb2\xa1": "<",
    b"\xa1\xb2\xc3\xd4": ">",
    b"\xa1\xb2\x3c\x4d": ">",
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_ETHERNET, _RAW_IP, _LINUX_SLL, _LINUX_SLL2 = 1, 101, 113, 276
_MOST_LOST = 3  # bytes for each one that is left
_CAPTURE_WHOLE = "Capture whole packets: without a snap length, or with one of 65535 bytes."


@value
class Pcap(Format):
    """Network captures (pcap, pcapng) of what a TI DCA1000 sends.

    The packets of a DCA1000 as Wireshark, tcpdump or dumpcap keep them.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by the first bytes."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(12)
        of_blocks = head.startswith(_PCAPNG) and _byte_order(head) is not None
        return Fit.CONTAINER if head[:4] in _PCAP or of_blocks else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        runs, stopped, cut = _records(path)
        runs = runs.reshape(-1, 7)  # none at all of a file that ends with its header
        _must_be_whole(path, runs, cut)
        stream, findings = in_places(path, files_in(path), runs)
        if n_cut := int(runs[runs[:, 4] > 0, -2].sum()):
            findings += (_snapped(n_cut, int(cut[1])),)
        size = path.stat().st_size
        if stopped < size:
            findings += (_cut(size - stopped, stopped),)
        settings = settings_for(path, told)
        return bare_contents(
            path, stream, layouts(settings), settings.with_findings(*findings), told
        )


def _byte_order(head: bytes) -> str | None:
    """Of a pcapng file, by the mark in its first block."""
    return {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}.get(head[8:12])


def _records(path: Path) -> tuple[np.ndarray, int, np.ndarray]:
    """What a capture holds.

    Returns
    -------
    runs : (n, 7) int64
        Of packets with their number, bytes before, place and size of the payload, and bytes of it
        not captured; see `packets.runs_of`.
    stopped : int
        Where the file broke off.
    cut : (2,) int64
        Packets of any kind of which only the start was captured, and the bytes of the longest.
    """
    cut = np.zeros(2, np.int64)
    with path.open("rb") as file:
        head = file.read(24)
    if head.startswith(_PCAPNG):
        little = _byte_order(head) == "<"
        links = np.full(2**16, -1, np.int64)  # of each interface, filled as they are declared
        n_links = np.zeros(1, np.int64)

        def blocks(content: np.ndarray, at: int, stop: int) -> tuple[int, np.ndarray]:
            return _blocks(content, at, stop, little, links, n_links, cut)

        return *walk(path, in_runs(blocks), 0), cut
    order = _PCAP[head[:4]]
    if len(head) < 24:
        raise _damaged(path, "a capture without its header of 24 bytes")
    link = struct.unpack(f"{order}I", head[20:24])[0] & 0x0FFFFFFF

    def records(content: np.ndarray, at: int, stop: int) -> tuple[int, np.ndarray]:
        return _packets(content, at, stop, order == "<", link, cut)

    return *walk(path, in_runs(records), 24), cut


def _must_be_whole(path: Path, runs: np.ndarray, cut: np.ndarray) -> None:
    """Raise `RecordingError` if packets were cut, and no samples, or hardly any, are left."""
    is_whole, counts = runs[:, 4] == 0, runs[:, -2]
    lost, left = counts @ runs[:, 4], counts @ runs[:, 3]
    if not cut[0] or (is_whole.any() and lost <= _MOST_LOST * left):
        return
    raise RecordingError(
        path,
        got=f"{cut[0]} packets captured with a snap length of {cut[1]} bytes: too little of their"
        " samples",
        need="whole packets of samples",
        fix=_CAPTURE_WHOLE,
    )


def _snapped(n_cut: int, length: int) -> Finding:
    return Finding(
        level="warning",
        setting="recording",
        got=f"{n_cut} packets of samples captured with a snap length of {length} bytes: the rest"
        " of each is lost",
        need="whole packets",
        fix=_CAPTURE_WHOLE,
    )


def _damaged(path: Path, got: str) -> RecordingError:
    return RecordingError(
        path, got=got, need="a network capture", fix="Copy the file again from its source."
    )


def _cut(n_bytes: int, stopped: int) -> Finding:
    return Finding(
        level="warning",
        setting="recording",
        got=f"{n_bytes} bytes from byte {stopped} on that are no whole packet, left out",
        need="whole packets to the end of the capture",
        fix="If more than the end is missing, copy the file again from its source.",
    )


@numba.njit(cache=True)
def _inside_link(content: np.ndarray, at: int, stop: int, link: int) -> int:
    """Place of the IPv4 packet in a captured one; `stop` if there is none."""
    if link == _RAW_IP:
        return at
    size = 14 if link == _ETHERNET else 16 if link == _LINUX_SLL else 20
    known = link in (_ETHERNET, _LINUX_SLL, _LINUX_SLL2)
    if not known or at + size > stop:
        return stop
    kind = whole_number(content, at if link == _LINUX_SLL2 else at + size - 2, 2, False)
    at += size
    while kind in (0x8100, 0x88A8) and at + 4 <= stop:  # tags of virtual networks
        kind = whole_number(content, at + 2, 2, False)
        at += 4
    return at if kind == 0x0800 else stop


@numba.njit(cache=True)
def _payload(
    content: np.ndarray,
    at: int,
    stop: int,
    n_bytes: int,
    link: int,
    row: np.ndarray,
    cut: np.ndarray,
) -> bool:
    """Fill a row if a packet of n bytes, captured from `at` to before `stop`, holds samples."""
    sent = max(stop, at + n_bytes)
    if sent > stop:
        cut[0] += 1
        cut[1] = max(cut[1], stop - at)
    at = _inside_link(content, at, stop, link)
    if at + 20 > stop:
        return False
    is_udp = content[at] >> 4 == 4 and content[at + 9] == 17
    is_fragment = whole_number(content, at + 6, 2, False) & 0x3FFF
    end = min(sent, at + whole_number(content, at + 2, 2, False))  # short frames are padded
    length = int(content[at] & 15) * 4
    at += length
    if not is_udp or is_fragment or length < 20 or at + 18 >= min(end, stop):
        return False
    end = min(end, at + whole_number(content, at + 4, 2, False))
    if whole_number(content, at + 2, 2, False) != _DATA_PORT or at + 18 >= min(end, stop):
        return False
    row[0] = whole_number(content, at + 8, 4, True)
    row[1] = whole_number(content, at + 12, 6, True)
    row[2] = at + 18
    row[3] = min(end, stop) - at - 18
    row[4] = max(end - stop, 0)
    return True


@numba.njit(cache=True)
def _packets(
    content: np.ndarray, at: int, stop: int, little: bool, link: int, cut: np.ndarray
) -> tuple[int, np.ndarray]:
    """Rows of the records of a pcap file that begin in this window."""
    rows = np.empty(((stop - at) // 16 + 1, 5), np.int64)
    n = 0
    while at < stop:
        if at + 16 > content.size:
            break
        size = whole_number(content, at + 8, 4, little)
        if at + 16 + size > content.size:
            break
        sent = whole_number(content, at + 12, 4, little)
        if _payload(content, at + 16, at + 16 + size, sent, link, rows[n], cut):
            n += 1
        at += 16 + size
    return at, rows[:n].copy()


@numba.njit(cache=True)
def _blocks(
    content: np.ndarray,
    at: int,
    stop: int,
    little: bool,
    links: np.ndarray,
    n_links: np.ndarray,
    cut: np.ndarray,
) -> tuple[int, np.ndarray]:
    """Rows of the blocks of a pcapng file that begin in this window."""
    rows = np.empty(((stop - at) // 12 + 1, 5), np.int64)
    n = 0
    while at < stop:
        if at + 12 > content.size:
            break
        kind = whole_number(content, at, 4, little)
        size = whole_number(content, at + 4, 4, little)
        if size < 12 or at + size > content.size:
            break
        if kind == 1 and size >= 20 and n_links[0] < links.size:  # an interface
            links[n_links[0]] = whole_number(content, at + 8, 2, little)
            n_links[0] += 1
        begin, captured, sent, interface = 0, 0, 0, 0
        if kind == 6 and size >= 32:  # a packet
            interface = whole_number(content, at + 8, 4, little)
            captured = whole_number(content, at + 20, 4, little)
            sent = whole_number(content, at + 24, 4, little)
            begin = at + 28
        elif kind == 3 and size >= 16:  # one without its time
            captured = size - 16
            sent = whole_number(content, at + 8, 4, little)
            begin = at + 12
        inside = begin > 0 and begin + captured <= at + size and interface < n_links[0]
        link = links[interface] if inside else 0
        if inside and _payload(content, begin, begin + captured, sent, link, rows[n], cut):
            n += 1
        at += size
    return at, rows[:n].copy()
