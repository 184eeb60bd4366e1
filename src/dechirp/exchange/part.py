"""A part of a recording as a recording of its own, whose first frame is number 0."""

from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.formats.recording import Recording
from dechirp.radar.radar import Radar


def counted_from_0(recording: Recording) -> Recording:
    """The same frames, as if none had come before them.

    A file tells no number of its first frame: times of frames and of tables are then since the
    first one that is there, and intervals that differ from frame to frame begin with its own.
    """
    first, contents, n_frames = (
        recording.frame_numbers.start,
        recording.contents,
        recording.n_frames,
    )
    if first == 0 and n_frames == contents.n_frames:
        return recording
    decode, radar = contents.decode, contents.radar
    start_s = 0.0 if radar is None else radar.frame.start_s(first)

    def decode_later(number: int, out: np.ndarray) -> None:
        assert decode is not None
        decode(first + number, out)

    cut = replace(
        contents,
        radar=None if radar is None else _begun_at(radar, first),
        n_frames=n_frames,
        decode=None if decode is None else decode_later,
        gaps=None if contents.gaps is None else contents.gaps[first : first + n_frames],
        points=None if recording.points is None else _since(recording.points, first, start_s),
        tables={name: _since(one, first, start_s) for name, one in recording.tables.items()},
    )
    return replace(recording, contents=cut, frame_numbers=range(n_frames))


def _begun_at(radar: Radar, first: int) -> Radar:
    """The radar, whose first frame is the one of that number."""
    intervals_s = radar.frame.interval_s
    if not isinstance(intervals_s, tuple):
        return radar
    place = first % len(intervals_s)
    turned = intervals_s[place:] + intervals_s[:place]
    return replace(radar, frame=replace(radar.frame, interval_s=turned))


def _since(table: xr.Dataset, first: int, start_s: float) -> xr.Dataset:
    """A table whose numbers and times of frames are counted from that one."""
    if "frame" not in table.variables:
        return table
    shifts = {"frame": first, "time": start_s}
    return table.assign(
        {
            name: table.variables[name].copy(data=table.variables[name].values - shift)
            for name, shift in shifts.items()
            if name in table.variables
        }
    )
