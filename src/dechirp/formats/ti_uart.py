"""TI radars' serial output: packets of points that the chip detected itself, no samples.

Points are four floats, x y z and velocity (type 1); before SDK 3 a count and a Q format, and
16-bit numbers: range bin, Doppler bin, peak, x, y, z. Their signal-to-noise ratios are in an
item of their own (type 7). In TI's axes x points right and y forward.

Bytes get lost on serial lines: `formats.streams.tlv` finds the whole packets, and the loss is
told.

TI, Understanding the Out of Box Demo Data Output (mmWave industrial toolbox).
"""

import mmap
import struct
from pathlib import Path

import numpy as np
import xarray as xr

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told
from dechirp.formats.streams.tlv import (
    MAGIC,
    OLD_POINT,
    POINTS,
    SIDE_INFO,
    Found,
    header_at,
    is_old,
    search,
)
from dechirp.radar.radar import Radar

_HEAD_BYTES = 2**14
_LARGEST_STEP = 2**16  # of frame numbers: more is a number that was damaged

_ITEMS = {
    2: "range profile",
    3: "noise profile",
    4: "azimuth map",
    5: "range-Doppler map",
    6: "statistics",
    8: "azimuth-elevation map",
    9: "temperature",
}


@value
class TiUart(Format):
    """Detections from the serial port of a TI demo (TLV).

    The bytes of the data port, as they came.
    """

    def recognise(self, path: Path) -> Fit:
        """Tell by a magic word near the start, and a header after it that can be one."""
        if not path.is_file():
            return Fit.NO
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        at = head.find(MAGIC)
        while at >= 0:
            if header_at(head, at) is not None:
                return Fit.OWN
            at = head.find(MAGIC, at + 1)
        return Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        if not path.stat().st_size:
            raise _nothing(path, 0, 0)
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
            found = search(text)
            if not len(found.packets):
                raise _nothing(path, found.n_damaged, found.n_bytes_lost)
            radar = None if told.settings is None else told.settings.radar
            xyzv, snr = _points(text, found.packets, radar)
        points = _detections(found.packets, xyzv, snr, radar)
        findings = () if told.settings is None else told.settings.findings
        if np.isnan(xyzv[:, 3]).any():
            findings = (*findings, _no_velocity())
        return Contents(
            radar=radar,
            n_frames=len(found.packets),
            points=points,
            findings=(*findings, *_lost(found), *_not_read(found)),
        )


_UNITS = {
    "frame": "1",
    "frame_number": "1",
    "time": "s",
    "range": "m",
    "velocity": "m/s",
    "azimuth": "rad",
    "elevation": "rad",
    "snr": "1",
}


def _points(
    text: mmap.mmap, packets: np.ndarray, radar: Radar | None
) -> tuple[np.ndarray, np.ndarray]:
    """Points of all packets, (point, x y z velocity) in TI's axes, and their ratios."""
    counts = packets["n_points"]
    xyzv = np.empty((int(counts.sum()), 4), np.float32)
    snr = np.full(len(xyzv), np.nan, np.float32)
    first = 0
    for version, _, n, points_at, side_at in packets[counts > 0].tolist():
        rows = slice(first, first + n)
        if is_old(version):
            xyzv[rows] = _of_16_bits(text, version, n, points_at, radar)
        else:
            content = text[points_at : points_at + 16 * n]
            xyzv[rows] = np.frombuffer(content, "<f4").reshape(n, 4)
        if side_at >= 0:
            side = np.frombuffer(text[side_at : side_at + 4 * n], "<i2")
            snr[rows] = 10 ** (side[::2] / 100)  # in steps of 0.1 dB
        first += n
    return xyzv, snr


def _detections(
    packets: np.ndarray, xyzv: np.ndarray, snr: np.ndarray, radar: Radar | None
) -> xr.Dataset:
    """Points as detections, in single precision as they were sent; uses up `xyzv`."""
    left, forward, up, velocity = xyzv.T
    # In place: a stream of nothing but points would take many times its size.
    left *= -1  # np.negative, in place and with a stride, goes wrong in NumPy 2.4
    ground = np.hypot(left, forward)
    azimuth = np.arctan2(left, forward, out=left)
    distance = np.hypot(ground, up, out=forward)
    elevation = np.arctan2(up, ground, out=up)
    counts, numbers = packets["n_points"], packets["frame_number"]
    columns = {
        "frame": np.repeat(np.arange(len(packets), dtype=np.int32), counts),
        "frame_number": np.repeat(numbers.astype(np.uint32), counts),
        "range": distance,
        "velocity": velocity,
        "azimuth": azimuth,
        "elevation": elevation,
        "snr": snr,
    }
    if radar is not None:
        # Since the first packet; the radar's own number counts those that were lost.
        times_s = (numbers - numbers[0]) * radar.frame.start_s(1) + radar.frame.mid_frame_s
        columns["time"] = np.repeat(times_s, counts)
    return xr.Dataset(
        {
            name: ("detection", columns[name], {"units": units})
            for name, units in _UNITS.items()
            if name in columns
        }
    )


def _of_16_bits(text: mmap.mmap, version: int, n: int, at: int, radar: Radar | None) -> np.ndarray:
    """Points (point, x y z velocity) from before SDK 3, in m and m/s, TI's axes."""
    _, q_format = struct.unpack_from("<2H", text, at)
    old = np.frombuffer(text[at + 4 : at + 4 + n * OLD_POINT.itemsize], OLD_POINT)
    xyz = np.stack([old["x"], old["y"], old["z"]], axis=-1) / 2.0**q_format
    velocity = np.full(n, np.nan)
    if radar is not None:
        doppler = old["doppler"].astype(np.int64)
        n_bins = radar.frame.n_chirps
        if version >> 16 == 0x0100:  # SDK 1.0 counts them from 0, half of them negative
            doppler = np.where(doppler >= n_bins / 2, doppler - n_bins, doppler)
        velocity = doppler * radar.frame.velocity_resolution_m_per_s
    return np.column_stack([xyz, velocity])


def _lost(found: Found) -> tuple[Finding, ...]:
    """What was lost on the way."""
    numbers = found.packets["frame_number"]
    steps = np.diff(numbers)
    onward = (steps >= 0) & (steps <= _LARGEST_STEP)  # the subframes of a frame have one number
    n_missing = int(np.maximum(steps[onward] - 1, 0).sum())
    n_jumps = int(np.count_nonzero(~onward))
    if not (found.n_bytes_lost or n_missing or n_jumps):
        return ()
    return (
        Finding(
            level="warning",
            setting="recording",
            got=f"{len(numbers)} whole packets; {found.n_damaged} damaged ones,"
            f" {found.n_bytes_lost} bytes in {found.n_places} places left out, {n_missing} frames"
            f" missing between frame {numbers[0]} and {numbers[-1]}, {n_jumps} jumps of the frame"
            " number",
            need="every packet that the radar sent",
            fix="Record with a faster serial port, or send fewer items (guiMonitor).",
        ),
    )


def _not_read(found: Found) -> tuple[Finding, ...]:
    others = [
        f"{_ITEMS.get(kind, 'unknown')} ({kind}) in {count}"
        for kind, count in sorted(found.kinds.items())
        if kind not in (POINTS, SIDE_INFO, -1)
    ]
    if not others:
        return ()
    more = f" and {len(others) - 12} more" if len(others) > 12 else ""
    return (
        Finding(
            level="note",
            setting="points",
            got=f"other items in {len(found.packets)} packets, not read:"
            f" {', '.join(others[:12])}{more}",
            need=f"points ({POINTS}) and their side information ({SIDE_INFO})",
            fix="Nothing is to be done.",
        ),
    )


def _no_velocity() -> Finding:
    return Finding(
        level="warning",
        setting="points",
        got="velocities as numbers of Doppler bins, as before SDK 3: they are not given",
        need="the radar, which says how wide a bin is",
        fix="Give the radar: --radar FILE (radar=FILE in Python).",
    )


def _nothing(path: Path, n_damaged: int, n_bytes: int) -> RecordingError:
    return RecordingError(
        path,
        got=f"without a whole packet: {n_damaged} magic words in {n_bytes} bytes, with nothing"
        " after them that fits",
        need="the bytes of a TI radar's data port, with packets of points",
        fix="Record the data port, not the one of the commands, at its own baud rate.",
    )
