"""Network captures (pcap, pcapng) of the UDP stream of a DCA1000.

Samples arrive on UDP port 4098: uint32 sequence number from 1, uint48 number of bytes sent before,
payload. The byte count, not the order of arrival, gives the position of a payload.

pcap: https://www.ietf.org/archive/id/draft-ietf-opsawg-pcap; pcapng: draft-ietf-opsawg-pcapng.
"""

import struct
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.readers.dca1000 import possible_word_layouts
from dechirp.recordings.samples.raw_samples import interpret_raw_samples
from dechirp.recordings.settings_lookup import find_sub_frame_settings
from dechirp.recordings.streams.byte_sources import open_concatenated_files
from dechirp.recordings.streams.packets import (
    assemble_packet_payloads,
    read_unsigned,
    wrap_scan_to_return_packet_runs,
)
from dechirp.recordings.streams.scan import scan_file_in_windows

_DATA_PORT = 4098
_PCAP = {  # magic numbers: microsecond and nanosecond time stamps, in both byte orders
    b"\xd4\xc3\xb2\xa1": "<",
    b"\x4d\x3c\xb2\xa1": "<",
    b"\xa1\xb2\xc3\xd4": ">",
    b"\xa1\xb2\x3c\x4d": ">",
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_ETHERNET, _RAW_IP, _LINUX_SLL, _LINUX_SLL2 = 1, 101, 113, 276
_MAX_LOST_RATIO = 3  # lost bytes for each captured byte
_SNAP_LENGTH_FIX = "capture whole packets: use no snap length, or one of 65535 bytes"


@frozen_dataclass
class Pcap(Format):
    """Network captures (pcap, pcapng) of the stream of a TI DCA1000.

    Packets captured by Wireshark, tcpdump or dumpcap.
    """

    options: ClassVar[tuple[str, ...]] = ("iq", "inner_name")

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(12)
        is_pcapng = head.startswith(_PCAPNG) and _pcapng_byte_order(head) is not None
        return MatchQuality.CONTAINER if head[:4] in _PCAP or is_pcapng else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        runs, stopped, snapped = _scan_sample_packets(path)
        runs = runs.reshape(-1, 7)  # empty if the file ends after its header
        _check_snap_length_kept_samples(path, runs, snapped)
        stream, findings = assemble_packet_payloads(path, open_concatenated_files(path), runs)
        if n_snapped := int(runs[runs[:, 4] > 0, -2].sum()):
            findings += (_snap_length_warning(n_snapped, int(snapped[1])),)
        size = path.stat().st_size
        if stopped < size:
            findings += (_cut_packet_warning(size - stopped, stopped),)
        settings = find_sub_frame_settings(path, hints)
        return interpret_raw_samples(
            path, stream, possible_word_layouts(settings), settings.with_findings(*findings), hints
        )


def _pcapng_byte_order(head: bytes) -> str | None:
    """Return the byte order of a pcapng file, from its section header; None if damaged."""
    return {b"\x4d\x3c\x2b\x1a": "<", b"\x1a\x2b\x3c\x4d": ">"}.get(head[8:12])


def _scan_sample_packets(path: Path) -> tuple[np.ndarray, int, np.ndarray]:
    """Find all packets of samples in a capture.

    Returns
    -------
    runs : (n, 7) int64
        Runs of packets: number, bytes before, offset and size of the payload, missing bytes of the
        payload, and the two columns of `packets.group_packets_into_runs`.
    stopped : int
        Offset at which the file ended or became unreadable.
    snapped : (2,) int64
        Number of packets of any protocol that were captured only in part, and the longest length.
    """
    snapped = np.zeros(2, np.int64)
    with path.open("rb") as file:
        header = file.read(24)
    if header.startswith(_PCAPNG):
        is_little_endian = _pcapng_byte_order(header) == "<"
        links = np.full(2**16, -1, np.int64)  # link type of each interface
        n_links = np.zeros(1, np.int64)

        def scan_blocks(content: np.ndarray, offset: int, stop: int) -> tuple[int, np.ndarray]:
            return _find_sample_packets_in_pcapng(
                content, offset, stop, is_little_endian, links, n_links, snapped
            )

        return *scan_file_in_windows(path, wrap_scan_to_return_packet_runs(scan_blocks), 0), snapped
    order = _PCAP[header[:4]]
    if len(header) < 24:
        raise _damaged_capture_error(path, "a capture without a complete header of 24 bytes")
    link = struct.unpack(f"{order}I", header[20:24])[0] & 0x0FFFFFFF

    def scan_records(content: np.ndarray, offset: int, stop: int) -> tuple[int, np.ndarray]:
        return _find_sample_packets_in_pcap(content, offset, stop, order == "<", link, snapped)

    return *scan_file_in_windows(path, wrap_scan_to_return_packet_runs(scan_records), 24), snapped


def _check_snap_length_kept_samples(
    path: Path, runs: np.ndarray, snap_count_and_length: np.ndarray
) -> None:
    """Raise `RecordingError` if the snap length removed nearly all samples."""
    is_whole, counts = runs[:, 4] == 0, runs[:, -2]
    lost_bytes, captured_bytes = counts @ runs[:, 4], counts @ runs[:, 3]
    n_snapped, snap_length = snap_count_and_length
    if not n_snapped or (is_whole.any() and lost_bytes <= _MAX_LOST_RATIO * captured_bytes):
        return
    raise RecordingError(
        path,
        value=f"{n_snapped} packets captured with a snap length of {snap_length} bytes, which"
        " removed most samples",
        expected="complete packets",
        fix=_SNAP_LENGTH_FIX,
    )


def _snap_length_warning(n_snapped: int, snap_length: int) -> Finding:
    """Warn that packets were captured only in part."""
    return Finding(
        level="warning",
        setting="recording",
        value=f"{n_snapped} packets of samples captured with a snap length of {snap_length}"
        " bytes: the rest of each is lost",
        expected="complete packets",
        fix=_SNAP_LENGTH_FIX,
    )


def _damaged_capture_error(path: Path, value: str) -> RecordingError:
    """Return the error of a damaged capture."""
    return RecordingError(
        path, value=value, expected="a network capture", fix="copy the file again from its source"
    )


def _cut_packet_warning(n_bytes: int, stop: int) -> Finding:
    """Warn that the capture ends within a packet."""
    return Finding(
        level="warning",
        setting="recording",
        value=f"{n_bytes} bytes from byte {stop}, an incomplete packet, left out",
        expected="complete packets up to the end of the capture",
        fix="if more than the end is missing, copy the file again from its source",
    )


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def _find_ipv4_header(content: np.ndarray, offset: int, stop: int, link_type: int) -> int:
    """Return the offset of the IPv4 header in a captured frame; `stop` if there is none."""
    if link_type == _RAW_IP:
        return offset
    size = 14 if link_type == _ETHERNET else 16 if link_type == _LINUX_SLL else 20
    is_supported = link_type in (_ETHERNET, _LINUX_SLL, _LINUX_SLL2)
    if not is_supported or offset + size > stop:
        return stop
    ethertype = read_unsigned(
        content, offset if link_type == _LINUX_SLL2 else offset + size - 2, 2, False
    )
    offset += size
    while ethertype in (0x8100, 0x88A8) and offset + 4 <= stop:  # VLAN tags
        ethertype = read_unsigned(content, offset + 2, 2, False)
        offset += 4
    return offset if ethertype == 0x0800 else stop


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def _fill_row_if_sample_packet(
    content: np.ndarray,
    offset: int,
    stop: int,
    n_bytes: int,
    link_type: int,
    row: np.ndarray,
    snap_count_and_length: np.ndarray,
) -> bool:
    """Fill `row` if a captured packet contains samples; return whether it does.

    The packet had `n_bytes` bytes on the wire, of which `offset` to `stop` were captured.
    """
    packet_end = max(stop, offset + n_bytes)
    if packet_end > stop:
        snap_count_and_length[0] += 1
        snap_count_and_length[1] = max(snap_count_and_length[1], stop - offset)
    offset = _find_ipv4_header(content, offset, stop, link_type)
    if offset + 20 > stop:
        return False
    is_udp = content[offset] >> 4 == 4 and content[offset + 9] == 17
    is_fragment = read_unsigned(content, offset + 6, 2, False) & 0x3FFF
    # Short Ethernet frames are padded.
    payload_end = min(packet_end, offset + read_unsigned(content, offset + 2, 2, False))
    header_bytes = int(content[offset] & 15) * 4
    offset += header_bytes
    if not is_udp or is_fragment or header_bytes < 20 or offset + 18 >= min(payload_end, stop):
        return False
    payload_end = min(payload_end, offset + read_unsigned(content, offset + 4, 2, False))
    if read_unsigned(content, offset + 2, 2, False) != _DATA_PORT or offset + 18 >= min(
        payload_end, stop
    ):
        return False
    row[0] = read_unsigned(content, offset + 8, 4, True)
    row[1] = read_unsigned(content, offset + 12, 6, True)
    row[2] = offset + 18
    row[3] = min(payload_end, stop) - offset - 18
    row[4] = max(payload_end - stop, 0)
    return True


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def _find_sample_packets_in_pcap(
    content: np.ndarray,
    offset: int,
    stop: int,
    is_little_endian: bool,
    link_type: int,
    snap_count_and_length: np.ndarray,
) -> tuple[int, np.ndarray]:
    """Return the next offset and the rows of the pcap records that begin before `stop`."""
    rows = np.empty(((stop - offset) // 16 + 1, 5), np.int64)
    n = 0
    while offset < stop:
        if offset + 16 > content.size:
            break
        size = read_unsigned(content, offset + 8, 4, is_little_endian)
        if offset + 16 + size > content.size:
            break
        n_sent = read_unsigned(content, offset + 12, 4, is_little_endian)
        if _fill_row_if_sample_packet(
            content,
            offset + 16,
            offset + 16 + size,
            n_sent,
            link_type,
            rows[n],
            snap_count_and_length,
        ):
            n += 1
        offset += 16 + size
    return offset, rows[:n].copy()


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def _find_sample_packets_in_pcapng(
    content: np.ndarray,
    offset: int,
    stop: int,
    is_little_endian: bool,
    link_types: np.ndarray,
    n_links: np.ndarray,
    snap_count_and_length: np.ndarray,
) -> tuple[int, np.ndarray]:
    """Return the next offset and the rows of the pcapng blocks that begin before `stop`."""
    rows = np.empty(((stop - offset) // 12 + 1, 5), np.int64)
    n = 0
    while offset < stop:
        if offset + 12 > content.size:
            break
        block_type = read_unsigned(content, offset, 4, is_little_endian)
        size = read_unsigned(content, offset + 4, 4, is_little_endian)
        if size < 12 or offset + size > content.size:
            break
        # An interface description.
        if block_type == 1 and size >= 20 and n_links[0] < link_types.size:
            link_types[n_links[0]] = read_unsigned(content, offset + 8, 2, is_little_endian)
            n_links[0] += 1
        payload_start, n_captured, n_sent, interface = 0, 0, 0, 0
        if block_type == 6 and size >= 32:  # an enhanced packet
            interface = read_unsigned(content, offset + 8, 4, is_little_endian)
            n_captured = read_unsigned(content, offset + 20, 4, is_little_endian)
            n_sent = read_unsigned(content, offset + 24, 4, is_little_endian)
            payload_start = offset + 28
        elif block_type == 3 and size >= 16:  # a simple packet, without a time stamp
            n_captured = size - 16
            n_sent = read_unsigned(content, offset + 8, 4, is_little_endian)
            payload_start = offset + 12
        is_packet = (
            payload_start > 0
            and payload_start + n_captured <= offset + size
            and interface < n_links[0]
        )
        link = link_types[interface] if is_packet else 0
        if is_packet and _fill_row_if_sample_packet(
            content,
            payload_start,
            payload_start + n_captured,
            n_sent,
            link,
            rows[n],
            snap_count_and_length,
        ):
            n += 1
        offset += size
    return offset, rows[:n].copy()
