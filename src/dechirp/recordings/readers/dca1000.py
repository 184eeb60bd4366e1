"""TI DCA1000 captures (`.bin`): raw samples, with or without the headers of their packets.

The xWR16xx, 18xx and 68xx chips use two LVDS lanes, the xWR12xx and 14xx four; see
`recordings.samples.layouts`. Recorders split long captures (`adc_data_0.bin`, `adc_data_1.bin`
...) at bytes, not at frames.

In a file with headers (`*_Raw_0.bin` of mmWave Studio), 14 bytes precede each payload:
uint32 sequence number, uint32 payload size, uint48 number of bytes sent before.
"""

import re
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.compiled_kernels import AS_WRITTEN, kernel
from dechirp.core.errors import DechirpError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.recordings.native import check_device_and_iq_hints
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    identify_non_raw_content,
)
from dechirp.recordings.samples.layouts import FourLanes, Layout, TwoLanes
from dechirp.recordings.samples.raw_samples import count_frame_bytes, interpret_raw_samples
from dechirp.recordings.settings.base import RecordingSettings
from dechirp.recordings.settings_lookup import find_sub_frame_settings
from dechirp.recordings.sidecar import has_sidecar, read_sidecar
from dechirp.recordings.streams.byte_sources import ByteSource, open_concatenated_files
from dechirp.recordings.streams.packets import (
    MAX_PAYLOAD_BYTES,
    assemble_packet_payloads,
    group_packets_into_runs,
    last_sequence_number,
    read_unsigned,
    wrap_scan_to_return_packet_runs,
)
from dechirp.recordings.streams.scan import scan_file_in_windows

_HEADER_BYTES = 14
SPLIT_BYTES = 2**29
"""File size (bytes) below which a capture is never split: recorders split at 1 GB or more."""


@frozen_dataclass
class Dca1000(Format):
    """TI DCA1000 captures (`.bin`), with or without packet headers.

    Raw samples take everything but their order from the settings. Of several sub-frames in a frame,
    a name such as `adc_data.bin/1` chooses one. A capture written by `dechirp convert` has its
    settings in a sidecar.
    """

    options: ClassVar[tuple[str, ...]] = ("iq", "inner_name")

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        if has_sidecar(path):
            return MatchQuality.SELF_DESCRIBING
        if has_packet_headers(path):
            return MatchQuality.CONTAINER
        return MatchQuality.POSSIBLE if identify_non_raw_content(path) is None else MatchQuality.NO

    def leading_file(self, path: Path, hints: RecordingHints) -> Path:
        first = _first_capture_part(path)
        if first == path:
            return path
        if has_packet_headers(first):
            # A capture of its own begins with packet 1.
            with path.open("rb") as file:
                number = int.from_bytes(file.read(4), "little")
            return path if number == 1 and has_packet_headers(path) else first
        try:
            settings = find_sub_frame_settings(first, hints)
        except DechirpError:
            return path
        return first if path in _find_capture_parts(first, settings) else path

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        if has_sidecar(path):
            sidecar = read_sidecar(path, None if hints.settings is None else hints.settings.radar)
            settings = sidecar.settings
            check_device_and_iq_hints(path, hints, device=settings.device, iq=settings.iq)
            return sidecar.apply_to_raw_contents(
                interpret_raw_samples(
                    path,
                    open_concatenated_files(path),
                    possible_word_layouts(settings),
                    settings,
                    hints,
                )
            )
        settings = find_sub_frame_settings(path, hints)
        stream, findings = _open_payload_stream_with_findings(path, settings)
        return interpret_raw_samples(
            path, stream, possible_word_layouts(settings), settings.with_findings(*findings), hints
        )


def possible_word_layouts(settings: RecordingSettings) -> list[Layout]:
    """Return the word orders in which a DCA1000 may have written, given the settings."""
    alternating = FourLanes(receivers=settings.chip_receiver_indices(settings.radar.array.n_rx))
    if settings.is_interleaved is None:
        return [TwoLanes(), alternating]
    return [alternating] if settings.is_interleaved else [TwoLanes()]


def has_packet_headers(path: Path) -> bool:
    """Return whether a file contains packets with headers, judged by its first two packets."""
    with path.open("rb") as file:
        first = file.read(_HEADER_BYTES)
        if len(first) < _HEADER_BYTES or int.from_bytes(first[4:8], "little") != MAX_PAYLOAD_BYTES:
            return False
        file.seek(MAX_PAYLOAD_BYTES, 1)
        second = file.read(_HEADER_BYTES)
    if not second:  # exactly one packet
        return path.stat().st_size == _HEADER_BYTES + MAX_PAYLOAD_BYTES
    size = int.from_bytes(second[4:8], "little")
    first_number, second_number = (
        int.from_bytes(header[:4], "little") for header in (first, second)
    )
    first_sent_bytes, second_sent_bytes = (
        int.from_bytes(header[8:], "little") for header in (first, second)
    )
    # Packets may arrive out of order or twice, but both counters stay in step.
    are_counters_consistent = (
        second_sent_bytes - first_sent_bytes == (second_number - first_number) * MAX_PAYLOAD_BYTES
    )
    return (
        0 < size <= MAX_PAYLOAD_BYTES
        and abs(second_number - first_number) < 2**16
        and are_counters_consistent
    )


def _open_payload_stream_with_findings(
    path: Path, settings: RecordingSettings
) -> tuple[ByteSource, tuple[Finding, ...]]:
    """Open the payload of a capture, with its split parts or packets, and findings about them."""
    if has_packet_headers(path):
        return _open_packet_payloads_with_findings(path)
    parts = _find_capture_parts(path, settings)
    return open_concatenated_files(*parts), _joined_parts_note(parts) + _later_capture_part_warning(
        path, settings
    )


def _joined_parts_note(parts: list[Path]) -> tuple[Finding, ...]:
    """Return a note that the parts of a split capture were joined."""
    if len(parts) == 1:
        return ()
    return (
        Finding(
            level="note",
            setting="recording",
            value=f"{len(parts)} files of one capture, {parts[0].name} to {parts[-1].name}, joined",
            expected="the parts of a split capture in the order of their numbers",
            fix="no action needed, unless a file belongs to another capture: move it away",
        ),
    )


def _later_capture_part_warning(path: Path, settings: RecordingSettings) -> tuple[Finding, ...]:
    """Warn if a file is a later part of a split capture, whose frames began in an earlier file."""
    first = _first_capture_part(path)
    if first == path or path not in _find_capture_parts(first, settings):
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            value=f"a later part of the capture that begins in {first.name}; its first frame may"
            " begin in the part before",
            expected="the first part, to which the others are joined",
            fix=f"open {first.name}",
        ),
    )


def _open_packet_payloads_with_findings(path: Path) -> tuple[ByteSource, tuple[Finding, ...]]:
    """Assemble the payloads of packets with headers, from all parts of a split capture."""
    runs, stopped = scan_file_in_windows(
        path, wrap_scan_to_return_packet_runs(_scan_packet_headers), 0
    )
    parts, base = [path], 0
    while (following := find_next_capture_part(parts)) is not None:
        continuation = _find_packet_across_parts(
            parts[-1], stopped, following, last_sequence_number(runs)
        )
        if continuation is None:
            break
        crossing_run, next_offset = continuation
        crossing_run[:, 2] += base + stopped
        base += parts[-1].stat().st_size
        parts.append(following)
        part_runs, stopped = scan_file_in_windows(
            following, wrap_scan_to_return_packet_runs(_scan_packet_headers), next_offset
        )
        if len(part_runs):
            part_runs[:, 2] += base
            crossing_run = np.concatenate([crossing_run, part_runs])
        runs = np.concatenate([runs, crossing_run])
    packets, findings = assemble_packet_payloads(path, open_concatenated_files(*parts), runs)
    if stopped < parts[-1].stat().st_size:
        findings += (_cut_packet_warning(parts[-1], stopped),)
    return packets, _joined_parts_note(parts) + findings


def _find_packet_across_parts(
    part: Path, stop: int, next_part: Path, last_packet_number: int
) -> tuple[np.ndarray, int] | None:
    """Find the packet that a split cut in two; return its run and the offset of the next packet.

    None if the second file does not continue the first one after packet `last_packet_number`.
    """
    longest = _HEADER_BYTES + MAX_PAYLOAD_BYTES
    with part.open("rb") as file:
        file.seek(stop)
        remainder = file.read(longest)
    with next_part.open("rb") as file:
        content = np.frombuffer(remainder + file.read(longest), np.uint8)
    _, rows = _scan_packet_headers(content, 0, 1)
    if (
        len(remainder) == longest
        or not len(rows)
        or not 0 < rows[0, 0] - last_packet_number < 2**16
    ):
        return None
    if not remainder:
        return group_packets_into_runs(rows[:0]), 0
    return group_packets_into_runs(rows[:1]), _HEADER_BYTES + int(rows[0, 3]) - len(remainder)


def _find_capture_parts(path: Path, settings: RecordingSettings) -> list[Path]:
    """Return the files of the capture that begins with `path`; only that file unless it was split.

    A capture that is complete in its first file may lie beside unrelated files with later numbers.
    """
    name_match = re.fullmatch(r"(.*_)0(\.\w+)", path.name)
    size = path.stat().st_size
    if name_match is None or _is_complete_capture(size, settings):
        return [path]
    parts = [path]
    while (following := find_next_capture_part(parts)) is not None:
        # All parts but the last are full.
        if following.stat().st_size > size:
            break
        parts.append(following)
        if following.stat().st_size < size:
            break
    return parts


def _first_capture_part(path: Path) -> Path:
    """Return the file of the same name with the number 0; the path itself if there is none."""
    name_match = re.fullmatch(r"(.*_)[1-9]\d*(\.\w+)", path.name)
    first = path if name_match is None else path.with_name(f"{name_match[1]}0{name_match[2]}")
    return first if first.is_file() else path


def find_next_capture_part(parts: list[Path]) -> Path | None:
    """Return the file with the next number in the same folder; None if there is none."""
    first = parts[0]
    name_match = re.fullmatch(r"(.*_)0(\.\w+)", first.name)
    if name_match is None:
        return None
    following = first.with_name(f"{name_match[1]}{len(parts)}{name_match[2]}")
    is_there = following.is_file() and following.resolve().parent == first.resolve().parent
    return following if is_there else None


def _is_complete_capture(file_bytes: int, settings: RecordingSettings) -> bool:
    """Return whether a file of this size contains all frames of its capture."""
    frame_bytes = [
        count_frame_bytes(layout, settings) for layout in possible_word_layouts(settings)
    ]
    if settings.n_frames is not None:
        return any(
            file_bytes >= settings.n_frames * bytes_per_frame for bytes_per_frame in frame_bytes
        )
    return file_bytes < SPLIT_BYTES and any(
        file_bytes % bytes_per_frame == 0 for bytes_per_frame in frame_bytes
    )


def _cut_packet_warning(path: Path, stop: int) -> Finding:
    """Warn that the file ends within a packet."""
    size = path.stat().st_size
    return Finding(
        level="warning",
        setting="recording",
        value=f"{size - stop} bytes of {path.name} from byte {stop}, an incomplete packet, left"
        " out",
        expected="complete packets up to the end of the file",
        fix="if more than the end is missing, copy the file again from its source",
    )


@kernel(plain=AS_WRITTEN, nogil=False, error_model="python")
def _scan_packet_headers(content: np.ndarray, offset: int, stop: int) -> tuple[int, np.ndarray]:
    """Return the next offset and rows (number, bytes before, payload offset, payload size).

    The rows are the packets that begin before `stop`; all but the last of a capture are full.
    """
    rows = np.empty(((stop - offset) // 64 + 16, 4), np.int64)
    n = 0
    while offset < stop and n < len(rows):
        if offset + _HEADER_BYTES > content.size:
            break
        size = read_unsigned(content, offset + 4, 4, True)
        if size < 1 or size > MAX_PAYLOAD_BYTES or offset + _HEADER_BYTES + size > content.size:
            break
        rows[n, 0] = read_unsigned(content, offset, 4, True)
        rows[n, 1] = read_unsigned(content, offset + 8, 6, True)
        rows[n, 2] = offset + _HEADER_BYTES
        rows[n, 3] = size
        n += 1
        offset += _HEADER_BYTES + size
    return offset, rows[:n].copy()
