"""Fusion of several radars: common tracks from the detections of all, in one frame of reference."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import (
    check_finite_array,
    check_instances,
    check_integer_fields,
    check_positive_fields,
)
from dechirp.core.detection_columns import check_type
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.tracking.batch import (
    TrackHistory,
    check_false_alarm_density,
    confirmed_tracks_to_dataset,
    drop_ended_unconfirmed_tracks,
    frame_index_per_row,
    warn_of_ignored_rows,
)
from dechirp.tracking.measurements import (
    Measurements,
    checked_row_axis_name,
    usable_row_mask,
    usable_rows_to_measurements,
)
from dechirp.tracking.online import LiveTracker, Track
from dechirp.tracking.poses import RadarPose, RadarView
from dechirp.tracking.tracker import Tracker, warn_of_too_few_frames


@frozen_dataclass
class RadarDetections:
    """Detections of one of several radars in all its frames, with its poses."""

    name: str
    """Unique name of the radar."""
    detections: xr.Dataset
    """Over `detection` or `cluster`, in the coordinates of the radar, as for `track`."""
    times_s: tuple[float, ...]
    """Middle of each frame on the clock of all radars, increasing."""
    poses: RadarPose | tuple[RadarPose, ...] = RadarPose()
    """Pose of the radar, or one for each frame if it moves in the frame of reference."""
    half_angle_rad: float = math.pi
    """Field of view to each side of boresight: only targets within it can be missed."""
    max_range_m: float = math.inf
    """Largest range of the field of view."""
    first: int = 0
    """Number of the first frame, as in the column `frame`."""
    velocity_span_m_per_s: float | None = None
    """Unambiguous velocity span, see `LiveTracker`."""

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name):
            raise InvalidSetting(
                "RadarDetections.name",
                value=repr(self.name),
                expected="a text that names the radar",
                fix="give the place of the radar, such as front-left",
            )
        checked_row_axis_name(self.detections, "frame")
        times_s = check_finite_array(
            "RadarDetections.times_s", self.times_s, may_be_empty=True
        ).reshape(-1)
        object.__setattr__(self, "times_s", tuple(times_s.tolist()))
        if not np.all(np.diff(times_s) > 0):
            raise InvalidSetting(
                "RadarDetections.times_s",
                value=f"times of {self.name} that do not increase",
                expected="the middle of each frame, each later than the one before",
                fix="sort the frames by time; give each once",
            )
        if not isinstance(self.poses, RadarPose):
            fix = "give one RadarPose, or one for each frame"
            poses = check_instances("RadarDetections.poses", self.poses, RadarPose, fix=fix)
            object.__setattr__(self, "poses", poses)
            if len(poses) != times_s.size:
                raise InvalidSetting(
                    "RadarDetections.poses",
                    value=f"{len(poses)} poses of {self.name}, for {times_s.size} frames",
                    expected="one pose, or one for each frame",
                    fix=fix,
                )
        check_positive_fields(self, "half_angle_rad", at_most=math.pi)
        if self.max_range_m != math.inf:
            check_positive_fields(self, "max_range_m")
        check_integer_fields(self, "first", at_least=0)
        if self.velocity_span_m_per_s is not None:
            check_positive_fields(self, "velocity_span_m_per_s")

    def view(self, frame: int) -> RadarView:
        """Return the view of a frame, counted from 0."""
        pose = self.poses if isinstance(self.poses, RadarPose) else self.poses[frame]
        return RadarView(
            pose=pose, half_angle_rad=self.half_angle_rad, max_range_m=self.max_range_m
        )


class _Frame(NamedTuple):
    """Frame of one of the radars."""

    time_s: float
    radar: int
    number: int
    """Counted from 0."""


@check_argument_types
def fuse_detections(
    radars: Sequence[RadarDetections], tracker: Tracker | None = None
) -> xr.Dataset:
    """Track targets from the detections of several radars, in one frame of reference.

    The frames of all radars are processed in the order of their times, each with the pose of its
    radar; those of equal times in the order of `radars`. The frame of reference is that of the
    poses: axes fixed to the vehicle with the constant poses of its radars, or the ground with poses
    and velocities that change from frame to frame. Clocks and poses are taken as exact.

    Parameters
    ----------
    radars : sequence of RadarDetections
    tracker : Tracker, optional
        Settings; its false alarms are those of one radar, in coordinates of that radar.

    Returns
    -------
    Dataset over (track, frame)
        As of `track`, with a column for each frame of each radar, numbered from 0 in the order of
        their times. In addition over frame: `radar`, its name, and `radar_frame`, its number.

    Raises
    ------
    InvalidSetting
        If there is no radar, two have one name, or as `track`.

    Warns
    -----
    PhysicsWarning
        If rows are ignored, or the frames are too few to confirm a track.

    Notes
    -----
    A frame without a detection of a target counts as a miss only if the target is in the field of
    view of its radar. All measurements are fused with their own standard errors, so independent
    radars give the errors of the posterior Cramer-Rao bound of both together. With a target size,
    tracks follow the centres of bodies, and their errors include the offset of the echoes.

    References
    ----------
    Y. Bar-Shalom, P. K. Willett, X. Tian, Tracking and Data Fusion, YBS, 2011 (centralised fusion).
    P. Tichavsky, C. H. Muravchik, A. Nehorai, IEEE Trans. Signal Processing 46(5), 1998 (bound).
    """
    tracker = Tracker() if tracker is None else tracker
    check_type("tracker", tracker, Tracker, fix="give Tracker(), its settings")
    radars = check_instances("radars", radars, RadarDetections, fix="give a list of them")
    _check_names(radars)
    tables = [_rows_by_frame(radar, tracker) for radar in radars]
    frames = sorted(
        _Frame(time_s, number, frame)
        for number, radar in enumerate(radars)
        for frame, time_s in enumerate(radar.times_s)
    )
    warn_of_too_few_frames("tracker", tracker.confirm_after, len(frames))
    live_tracker = LiveTracker(tracker)
    history: TrackHistory[Track] = {}
    for column, frame in enumerate(frames):
        measurements, frame_index = tables[frame.radar]
        tracks = live_tracker.step_with_view(
            measurements.select_measurements(frame_index == frame.number),
            frame.time_s,
            radars[frame.radar].view(frame.number),
            len(radars),
        )
        for live_track in tracks:
            history.setdefault(live_track.number, []).append((column, live_track))
        drop_ended_unconfirmed_tracks(history, {live_track.number for live_track in tracks})
    times_s = np.array([frame.time_s for frame in frames])
    return confirmed_tracks_to_dataset(history, times_s, 0).assign_coords(
        radar=("frame", np.array([radars[frame.radar].name for frame in frames], dtype=str)),
        radar_frame=("frame", [radars[frame.radar].first + frame.number for frame in frames]),
    )


def _check_names(radars: Sequence[RadarDetections]) -> None:
    if not radars:
        raise InvalidSetting(
            "radars", value="empty", expected="at least one radar", fix="give RadarDetections"
        )
    for name, count in Counter(radar.name for radar in radars).items():
        if count > 1:
            raise InvalidSetting(
                "radars",
                value=f"{count} radars named {name}",
                expected="a name of its own for each radar",
                fix="rename one of them",
            )


def _rows_by_frame(radar: RadarDetections, tracker: Tracker) -> tuple[Measurements, np.ndarray]:
    """Return the usable rows of a radar as measurements, and the index of the frame of each."""
    rows = usable_row_mask(radar.detections)
    axis = checked_row_axis_name(radar.detections, "frame")
    warn_of_ignored_rows(int(np.sum(~rows)), len(rows), axis)
    measurements = usable_rows_to_measurements(
        radar.detections,
        target_size_m=tracker.target_size_m,
        velocity_span_m_per_s=radar.velocity_span_m_per_s,
    )
    frame_index = frame_index_per_row(radar.detections, radar.first, len(radar.times_s))[rows]
    check_false_alarm_density(measurements, tracker)
    return measurements, frame_index
