"""TI serial output: packets of points detected by the chip itself, without samples.

Points are four floats, x y z and velocity (type 1); before SDK 3 a count and a Q format, and
16-bit numbers: range bin, Doppler bin, peak, x, y, z. Signal-to-noise ratios come in a separate
item (type 7). In TI's axes x points right and y forward.

Serial lines lose bytes: `recordings.streams.tlv` finds the complete packets, and a finding
reports the loss. Files of the viewer of TI's people-counting demo have no magic words; see
`recordings.streams.people_counting`.

TI, Understanding the Out of Box Demo Data Output (mmWave industrial toolbox).
"""

import mmap
import struct
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.detection_columns import UNITS
from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.recordings.readers.base import Contents, Format, MatchQuality, RecordingHints
from dechirp.recordings.settings_lookup import find_optional_settings
from dechirp.recordings.streams.people_counting import parse_viewer_frames
from dechirp.recordings.streams.tlv import (
    FIXED_POINT,
    MAGIC,
    POINTS,
    SIDE_INFO,
    TlvPackets,
    find_complete_packets,
    has_fixed_point_coordinates,
    parse_packet_header,
)

_HEAD_BYTES = 2**14
_MAX_FRAME_STEP = 2**16  # of frame numbers; a larger step is a damaged number

_ITEM_NAMES = {
    2: "range profile",
    3: "noise profile",
    4: "azimuth map",
    5: "range-Doppler map",
    6: "statistics",
    8: "azimuth-elevation map",
    9: "temperature",
}


@frozen_dataclass
class TiUart(Format):
    """Detections from the serial port of a TI demo (TLV).

    The bytes of the data port, unchanged. A settings file next to them gives the radar.
    """

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file():
            return MatchQuality.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        offset = head.find(MAGIC)
        while offset >= 0:
            if parse_packet_header(head, offset) is not None:
                return MatchQuality.SELF_DESCRIBING
            offset = head.find(MAGIC, offset + 1)
        is_viewer_file = len(parse_viewer_frames(head).points) > 0
        return MatchQuality.SELF_DESCRIBING if is_viewer_file else MatchQuality.NO

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        if not path.stat().st_size:
            raise _no_packet_error(path, 0, 0)
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if len(parse_viewer_frames(head).points):
            return _read_viewer_file(path, hints)
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            stream = find_complete_packets(text)
            if not len(stream.packets):
                raise _no_packet_error(path, stream.n_damaged, stream.n_bytes_lost)
            settings, findings = find_optional_settings(path, hints)
            radar = None if settings is None else settings.radar
            xyzv, snr = _read_points_and_snrs(text, stream.packets, radar)
        points = _points_to_detections(stream.packets, xyzv, snr, radar)
        if np.isnan(xyzv[:, 3]).any():
            findings = (*findings, _missing_doppler_bin_width_warning())
        return Contents(
            radar=radar,
            settings_path=None if settings is None else settings.path,
            n_frames=len(stream.packets),
            points=points,
            findings=(*findings, *_lost_packets_warning(stream), *_unread_tlv_items_note(stream)),
        )


def _read_viewer_file(path: Path, hints: RecordingHints) -> Contents:
    """Read a file of TI's people-counting viewer."""
    frames = parse_viewer_frames(path.read_bytes())
    settings, findings = find_optional_settings(path, hints)
    distance, azimuth, velocity, snr = frames.points.T
    columns = {
        "range": distance,
        "velocity": velocity,
        "azimuth": -azimuth,  # to the left, as everywhere in the package
        "elevation": np.full(len(distance), np.nan, np.float32),
        "snr": snr,
    }
    radar = None if settings is None else settings.radar
    findings += (
        Finding(
            level="note",
            setting="points",
            value=f"targets tracked by the radar in {np.count_nonzero(frames.target_counts)} of"
            f" {frames.counts.size} frames, not read",
            expected="the points from which they were tracked",
            fix="no action needed",
        ),
    )
    if frames.n_bytes_left:
        findings += (
            Finding(
                level="warning",
                setting="recording",
                value=f"{frames.counts.size} complete frames; {frames.n_bytes_left} bytes after"
                " them left out",
                expected="complete frames, as the viewer saves them",
                fix="if more than the end is missing, copy the whole file again",
            ),
        )
    return Contents(
        radar=radar,
        settings_path=None if settings is None else settings.path,
        n_frames=frames.counts.size,
        points=_label_points(frames.frame_numbers, frames.counts, columns, radar),
        findings=findings,
    )


_UNITS = {
    "frame": UNITS["frame"],
    "frame_number": "1",
    **{name: UNITS[name] for name in ("time", "range", "velocity", "azimuth", "elevation", "snr")},
}


def _read_points_and_snrs(
    serial_bytes: mmap.mmap, packets: np.ndarray, radar: Radar | None
) -> tuple[np.ndarray, np.ndarray]:
    """Read the points of all packets, (point, x y z velocity) in TI's axes, and their SNRs."""
    counts = packets["n_points"]
    xyzv = np.empty((int(counts.sum()), 4), np.float32)
    snr = np.full(len(xyzv), np.nan, np.float32)
    first = 0
    for version, _, n, points_at, side_at in packets[counts > 0].tolist():
        rows = slice(first, first + n)
        if has_fixed_point_coordinates(version):
            xyzv[rows] = _decode_fixed_point_xyz_velocities(
                serial_bytes, version, n, points_at, radar
            )
        else:
            content = serial_bytes[points_at : points_at + 16 * n]
            xyzv[rows] = np.frombuffer(content, "<f4").reshape(n, 4)
        if side_at >= 0:
            side = np.frombuffer(serial_bytes[side_at : side_at + 4 * n], "<i2")
            snr[rows] = 10 ** (side[::2] / 100)  # in steps of 0.1 dB
        first += n
    return xyzv, snr


def _points_to_detections(
    packets: np.ndarray, xyzv: np.ndarray, snr: np.ndarray, radar: Radar | None
) -> xr.Dataset:
    """Convert points to detections in single precision, as sent; overwrites `xyzv`."""
    y_left, x_forward, z_up, velocity = xyzv.T
    # In place, because a stream of points only would take many times its size.
    y_left *= -1  # np.negative, in place and with a stride, goes wrong in NumPy 2.4
    ground = np.hypot(y_left, x_forward)
    azimuth = np.arctan2(y_left, x_forward, out=y_left)
    distance = np.hypot(ground, z_up, out=x_forward)
    elevation = np.arctan2(z_up, ground, out=z_up)
    columns = {
        "range": distance,
        "velocity": velocity,
        "azimuth": azimuth,
        "elevation": elevation,
        "snr": snr,
    }
    return _label_points(packets["frame_number"], packets["n_points"], columns, radar)


def _label_points(
    numbers: np.ndarray, counts: np.ndarray, columns: dict[str, np.ndarray], radar: Radar | None
) -> xr.Dataset:
    """Label the columns of points, with the numbers and times of their frames."""
    columns = {
        "frame": np.repeat(np.arange(len(numbers), dtype=np.int32), counts),
        "frame_number": np.repeat(numbers.astype(np.uint32), counts),
        **columns,
    }
    if radar is not None:
        # Time since the first packet; the frame numbers also count lost frames.
        times_s = (numbers - numbers[0]) * radar.frame.frame_start_s(1) + radar.frame.mid_frame_s
        columns["time"] = np.repeat(times_s, counts)
    return xr.Dataset(
        {
            name: ("detection", columns[name], {"units": units})
            for name, units in _UNITS.items()
            if name in columns
        }
    )


def _decode_fixed_point_xyz_velocities(
    serial_bytes: mmap.mmap, version: int, n_points: int, offset: int, radar: Radar | None
) -> np.ndarray:
    """Decode points of SDK 1 and 2 to (point, x y z velocity), in m and m/s, TI's axes."""
    _, q_format = struct.unpack_from("<2H", serial_bytes, offset)
    raw_points = np.frombuffer(
        serial_bytes[offset + 4 : offset + 4 + n_points * FIXED_POINT.itemsize], FIXED_POINT
    )
    xyz = np.stack([raw_points["x"], raw_points["y"], raw_points["z"]], axis=-1) / 2.0**q_format
    velocity = np.full(n_points, np.nan)
    if radar is not None:
        doppler = raw_points["doppler"].astype(np.int64)
        n_bins = radar.frame.n_chirps
        if version >> 16 == 0x0100:  # SDK 1.0 counts them from 0, half of them negative
            doppler = np.where(doppler >= n_bins / 2, doppler - n_bins, doppler)
        velocity = doppler * radar.frame.velocity_resolution_m_per_s
    return np.column_stack([xyz, velocity])


def _lost_packets_warning(stream: TlvPackets) -> tuple[Finding, ...]:
    """Warn about damaged packets, lost bytes and missing frames."""
    numbers = stream.packets["frame_number"]
    steps = np.diff(numbers)
    # The subframes of a frame have one number.
    is_forward = (steps >= 0) & (steps <= _MAX_FRAME_STEP)
    n_missing = int(np.maximum(steps[is_forward] - 1, 0).sum())
    n_jumps = int(np.count_nonzero(~is_forward))
    if not (stream.n_bytes_lost or n_missing or n_jumps):
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            value=f"{len(numbers)} complete packets; {stream.n_damaged} damaged ones,"
            f" {stream.n_bytes_lost} bytes in {stream.n_gaps} places left out, {n_missing} frames"
            f" missing between frame {numbers[0]} and {numbers[-1]}, {n_jumps} jumps of the frame"
            " number",
            expected="every packet that the radar sent",
            fix="record with a faster serial port, or send fewer items (guiMonitor)",
        ),
    )


def _unread_tlv_items_note(stream: TlvPackets) -> tuple[Finding, ...]:
    """Return a note about items other than points."""
    unread_items = [
        f"{_ITEM_NAMES.get(kind, 'unknown')} ({kind}) in {count}"
        for kind, count in sorted(stream.packets_per_item_type.items())
        if kind not in (POINTS, SIDE_INFO, -1)
    ]
    if not unread_items:
        return ()
    more = f" and {len(unread_items) - 12} more" if len(unread_items) > 12 else ""
    return (
        Finding(
            level="note",
            setting="points",
            value=f"other items in {len(stream.packets)} packets, not read:"
            f" {', '.join(unread_items[:12])}{more}",
            expected=f"points ({POINTS}) and their side information ({SIDE_INFO})",
            fix="no action needed",
        ),
    )


def _missing_doppler_bin_width_warning() -> Finding:
    """Warn that velocities need the radar."""
    return Finding(
        level="warning",
        setting="points",
        value="velocities in Doppler bins, as before SDK 3, left out",
        expected="the radar, which gives the width of a bin",
        fix="give the radar: --radar FILE (radar=FILE in Python)",
    )


def _no_packet_error(path: Path, n_damaged: int, n_bytes: int) -> RecordingError:
    """Return the error of a file without a complete packet."""
    return RecordingError(
        path,
        value=f"no complete packet: {n_damaged} magic words in {n_bytes} bytes, none followed by"
        " a valid packet",
        expected="the bytes of a TI radar's data port, with packets of points",
        fix="record the data port at its baud rate, not the command port",
    )
