"""Selected frames as a recording of their own, whose first frame is number 0."""

from dataclasses import replace

import numpy as np
import xarray as xr

from dechirp.radar.radar import Radar
from dechirp.recordings.recording import Recording


def renumber_frames_from_zero(recording: Recording) -> Recording:
    """Return the same frames, numbered and timed from the first selected one.

    Files do not store the number of their first frame, so frame and table times are relative to it,
    and frame intervals that differ start with its own.
    """
    first, contents, n_frames = (
        recording.frame_numbers.start,
        recording.contents,
        recording.n_frames,
    )
    if first == 0 and n_frames == contents.n_frames:
        return recording
    decode, radar = contents.decode, contents.radar
    start_s = 0.0 if radar is None else radar.frame.frame_start_s(first)
    starts_s = contents.frame_starts_s
    if starts_s is not None:
        start_s = float(starts_s[first])

    def decode_later(number: int, out: np.ndarray) -> None:
        assert decode is not None
        decode(first + number, out)

    subset = replace(
        contents,
        radar=None if radar is None else _rotate_frame_intervals(radar, first),
        n_frames=n_frames,
        decode=None if decode is None else decode_later,
        decode_frames=None,
        gaps=None if contents.gaps is None else contents.gaps[first : first + n_frames],
        start_offsets=None
        if contents.start_offsets is None
        else contents.start_offsets[first : first + n_frames],
        frame_starts_s=None if starts_s is None else starts_s[first : first + n_frames] - start_s,
        points=None
        if recording.points is None
        else _shift_frame_and_time_columns(recording.points, first, start_s),
        tables={
            name: _shift_frame_and_time_columns(table, first, start_s)
            for name, table in recording.tables.items()
        },
    )
    return replace(recording, contents=subset, frame_numbers=range(n_frames))


def _rotate_frame_intervals(radar: Radar, first_frame: int) -> Radar:
    """Return the radar with frame intervals that start at this frame."""
    intervals_s = radar.frame.interval_s
    if not isinstance(intervals_s, tuple):
        return radar
    start = first_frame % len(intervals_s)
    rotated = intervals_s[start:] + intervals_s[:start]
    return replace(radar, frame=replace(radar.frame, interval_s=rotated))


def _shift_frame_and_time_columns(
    table: xr.Dataset, first_frame: int, start_s: float
) -> xr.Dataset:
    """Subtract this number and time from the frame columns of a table."""
    if "frame" not in table.variables:
        return table
    shifts = {"frame": first_frame, "time": start_s}
    return table.assign(
        {
            name: table.variables[name].copy(data=table.variables[name].values - shift)
            for name, shift in shifts.items()
            if name in table.variables
        }
    )
