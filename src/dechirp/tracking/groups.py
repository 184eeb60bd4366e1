"""Tracks of extended objects, each seen as a group of points: frame by frame, or all at once."""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_integer, check_number
from dechirp.core.detection_columns import check_type
from dechirp.core.values import frozen_dataclass
from dechirp.tracking.batch import (
    TrackHistory,
    confirmed_histories,
    confirmed_tracks_to_dataset,
    drop_ended_unconfirmed_tracks,
    frame_index_per_row,
)
from dechirp.tracking.group_filter import (
    Groups,
    associate_points,
    estimate_extents,
    predict_groups,
    start_groups,
    update_groups,
)
from dechirp.tracking.group_points import (
    GroupPoints,
    check_point_table,
    empty_group_points,
    usable_point_mask,
    usable_rows_to_group_points,
)
from dechirp.tracking.group_tracker import GroupTracker
from dechirp.tracking.motion_models import TURN_RATE, VX, VY, X, Y
from dechirp.tracking.online import Track, TrackStatus, interval_since_frame_before
from dechirp.tracking.point_clusters import (
    find_new_groups,
    is_compact_and_separate,
    release_split_points,
)
from dechirp.tracking.tracker import warn_of_too_few_frames

__all__ = ["GroupTrack", "GroupTracker", "LiveGroupTracker", "track_groups"]

_STATE = [X, VX, Y, VY]


@frozen_dataclass
class GroupTrack(Track):
    """Estimate of an extended object after a frame; the state is that of its centre."""

    turn_rate_rad_per_s: float
    """Positive to the left."""
    extent_m2: tuple[tuple[float, ...], ...]
    """2 by 2: covariance of points about the centre, along x and y. An ellipse that points fill
    evenly has half axes of twice the roots of the eigenvalues."""
    n_points: int
    """Points of the object in the frame."""

    @property
    def length_m(self) -> float:
        """Longer axis of the ellipse that points of this extent fill evenly."""
        return float(_ellipse_axes_m(np.array(self.extent_m2))[1])

    @property
    def width_m(self) -> float:
        """Shorter axis of that ellipse."""
        return float(_ellipse_axes_m(np.array(self.extent_m2))[0])


class LiveGroupTracker:
    """Tracker of extended objects that is updated frame by frame.

    Each point belongs to the tracks in whose gates it is, by probability; clusters of the remaining
    points start new tracks.

    Parameters
    ----------
    tracker : GroupTracker
    velocity_span_m_per_s : float, optional
        Unambiguous velocity span, as of `LiveTracker`.
    """

    @check_argument_types
    def __init__(
        self, tracker: GroupTracker, *, velocity_span_m_per_s: float | None = None
    ) -> None:
        check_type("tracker", tracker, GroupTracker, fix="give GroupTracker(), its settings")
        if velocity_span_m_per_s is not None:
            check_number("velocity_span_m_per_s", velocity_span_m_per_s, above=0)
        self._tracker = tracker
        self._span_m_per_s = velocity_span_m_per_s
        self._groups = start_groups(empty_group_points(), np.empty(0, int), tracker)
        self._statuses: list[_GroupStatus] = []
        self._n_started = 0
        self._time_s: float | None = None

    def step(self, points: xr.Dataset, time_s: float) -> tuple[GroupTrack, ...]:
        """Update the tracks with the points of a frame.

        Parameters
        ----------
        points : Dataset
            Points of one frame, possibly none: `range`, `azimuth` and `velocity`; `elevation`,
            `ambiguity_number` and standard errors are used where given. Rows without range or
            azimuth are ignored.
        time_s : float
            Middle of the frame, later than the frame before; steps may differ.

        Raises
        ------
        InvalidSetting
            If the time does not increase, columns are missing, or a range, azimuth or standard
            error is impossible; the tracks are unchanged.
        NotEnoughMemory
            If the pairs of points, or of tracks and points, would not fit.
        """
        return self.step_with_points(self.usable_rows_to_points(points), time_s)

    def usable_rows_to_points(self, points: xr.Dataset) -> GroupPoints:
        """Convert the usable rows of a table to points in the plane."""
        check_point_table(points)
        return usable_rows_to_group_points(points, self._tracker, self._span_m_per_s)

    def step_with_points(self, points: GroupPoints, time_s: float) -> tuple[GroupTrack, ...]:
        """Update the tracks like `step`, with points in the plane."""
        interval_s, self._time_s = interval_since_frame_before(time_s, self._time_s)
        predicted = predict_groups(self._groups, interval_s, self._tracker)
        share = associate_points(predicted, points, self._tracker)
        index = np.where(share.any(axis=0), share.argmax(axis=0) if len(share) else -1, -1)
        index = release_split_points(points, index, self._tracker)
        is_assigned = index >= 0
        counts = np.bincount(index[is_assigned], minlength=len(self._statuses))
        updated = update_groups(
            predicted, points.select_points(is_assigned), share[:, is_assigned], self._tracker
        )
        is_still = (counts == 0) & self._is_slow()
        self._count_frame(points, index, is_still, interval_s)
        groups = self._hold_still_groups(updated, is_still)
        is_kept = np.array([status.is_kept(self._tracker) for status in self._statuses], bool)
        self._statuses = [status for status in self._statuses if status.is_kept(self._tracker)]
        new_groups, new_counts = self._start_tracks(points.select_points(~is_assigned))
        self._groups = groups.select_groups(is_kept).append_groups(new_groups)
        return self._to_tracks(np.concatenate([counts[is_kept], new_counts]))

    def _is_slow(self) -> np.ndarray:
        mean, _ = self._groups.combined_states()
        slow: np.ndarray = np.hypot(mean[:, VX], mean[:, VY]) < self._tracker.still_speed_m_per_s
        return slow

    def _count_frame(
        self, points: GroupPoints, index: np.ndarray, is_still: np.ndarray, interval_s: float
    ) -> None:
        """Count a frame for the status of each track.

        A tentative track needs points that could start it, apart from those of earlier tracks: a
        second track on one object is never confirmed.
        """
        tracker = self._tracker
        for group, status in enumerate(self._statuses):
            if status.status == "confirmed" and is_still[group]:
                status.count_held_frame(interval_s)
                continue
            is_hit = (
                bool(np.any(index == group))
                if status.status == "confirmed"
                else is_compact_and_separate(points, index, group, tracker)
            )
            status.held_s = 0.0
            status.count_frame(is_hit=is_hit, confirm_after=tracker.confirm_after)

    def _hold_still_groups(self, updated: Groups, is_still: np.ndarray) -> Groups:
        """Keep objects in place that stand still without points."""
        standing = self._groups.mean.copy()
        standing[..., [VX, VY]] = 0.0
        return updated._replace(
            mean=np.where(is_still[:, None, None], standing, updated.mean),
            covariance=np.where(
                is_still[:, None, None, None], self._groups.covariance, updated.covariance
            ),
        )

    def _start_tracks(self, points: GroupPoints) -> tuple[Groups, np.ndarray]:
        """Start tracks from clusters of points; return them with their numbers of points."""
        cluster = find_new_groups(points, self._tracker)
        is_clustered = cluster >= 0
        counts = np.bincount(cluster[is_clustered])
        for _ in counts:
            status = _GroupStatus(self._n_started)
            status.confirm_if_enough_hits(self._tracker.confirm_after)
            self._statuses.append(status)
            self._n_started += 1
        rows = points.select_points(is_clustered)
        return start_groups(rows, cluster[is_clustered], self._tracker), counts

    def _to_tracks(self, counts: np.ndarray) -> tuple[GroupTrack, ...]:
        mean, covariance = self._groups.combined_states()
        extent = estimate_extents(self._groups, self._tracker)
        columns = zip(
            self._statuses,
            mean[:, _STATE].tolist(),
            covariance[:, np.array(_STATE)[:, None], _STATE].tolist(),
            mean[:, TURN_RATE].tolist(),
            extent.tolist(),
            counts.tolist(),
            strict=True,
        )
        return tuple(
            GroupTrack(
                number=status.number,
                state=tuple(state),
                covariance=tuple(map(tuple, state_covariance)),
                turn_rate_rad_per_s=turn_rate,
                extent_m2=tuple(map(tuple, group_extent)),
                n_points=n_points,
                status=status.status,
                age=status.age,
            )
            for status, state, state_covariance, turn_rate, group_extent, n_points in columns
        )


class _GroupStatus(TrackStatus):
    """Status of a live track, which may be held without points."""

    held_s = 0.0
    """Time for which the object has stood still without points."""

    def count_held_frame(self, interval_s: float) -> None:
        """Count a frame in which the object stands still without points."""
        self.age += 1
        self.held_s += interval_s

    def is_kept(self, tracker: GroupTracker) -> bool:
        """Return whether the track goes on."""
        return self.held_s <= tracker.hold_time_s and self.is_alive(
            confirm_after=tracker.confirm_after, drop_after=tracker.drop_after
        )


@check_argument_types
def track_groups(
    points: xr.Dataset,
    times_s: ArrayLike,
    tracker: GroupTracker | None = None,
    *,
    first: int = 0,
    velocity_span_m_per_s: float | None = None,
) -> xr.Dataset:
    """Track extended objects, such as people and cars, from their points in each frame.

    Parameters
    ----------
    points : Dataset over points
        `frame`, `range`, `azimuth` and `velocity`, as `Recording.points` or `detect` give them;
        `elevation`, `ambiguity_number` and standard errors are used where given. Rows without
        range or azimuth are ignored.
    times_s : array (n_frames,)
        Middle of each frame, with or without points; increasing. A missing frame is a longer step.
    tracker : GroupTracker, optional
        Settings; defaults if omitted.
    first : int
        Number of the first frame, as in the column `frame`.
    velocity_span_m_per_s : float, optional
        Unambiguous velocity span, as of `LiveTracker`.

    Returns
    -------
    Dataset over (track, frame)
        As of `track`; and `turn_rate` (rad/s), `extent` (track, frame, axis, other_axis), the
        covariance of points about the centre in m^2, `length` and `width` (m), the axes of the
        ellipse that points of this covariance fill evenly, and `n_points`. The number of objects
        in each frame is `(tracks.status == "confirmed").sum("track")`.

    Raises
    ------
    InvalidSetting
        If times do not increase, points are of other frames, columns are missing, or a range,
        azimuth or standard error is impossible.
    NotEnoughMemory
        If the tracks, or a frame's pairs of points, would not fit.

    Notes
    -----
    Objects that come closer than their gates share their points by probability. Two objects that
    appear closer than about twice their size are one track, until a gap between their points lasts.

    References
    ----------
    M. Feldmann et al., IEEE Trans. Signal Processing 59(4), 2011 (extents).
    H. A. P. Blom, Y. Bar-Shalom, IEEE Trans. Automatic Control 33(8), 1988 (motion models).
    """
    tracker = GroupTracker() if tracker is None else tracker
    live_tracker = LiveGroupTracker(tracker, velocity_span_m_per_s=velocity_span_m_per_s)
    check_point_table(points, "frame")
    times = check_finite_array("times_s", times_s, may_be_empty=True).reshape(-1)
    check_integer("first", first, at_least=0)
    frame_index = frame_index_per_row(points, first, len(times), table="points")[
        usable_point_mask(points)
    ]
    warn_of_too_few_frames("group_tracker", tracker.confirm_after, len(times))
    all_points = live_tracker.usable_rows_to_points(points)
    history: TrackHistory[GroupTrack] = {}
    for frame, time_s in enumerate(times):
        tracks = live_tracker.step_with_points(
            all_points.select_points(frame_index == frame), time_s
        )
        for live_track in tracks:
            history.setdefault(live_track.number, []).append((frame, live_track))
        drop_ended_unconfirmed_tracks(history, {live_track.number for live_track in tracks})
    return _add_extents(confirmed_tracks_to_dataset(history, times, first), history)


def _add_extents(tracks: xr.Dataset, history: TrackHistory[GroupTrack]) -> xr.Dataset:
    """Add the columns of extended objects to tracks."""
    shape = (tracks.sizes["track"], tracks.sizes["frame"])
    turn_rate, extent = np.full(shape, np.nan), np.full((*shape, 2, 2), np.nan)
    n_points = np.zeros(shape, int)
    for row, steps in enumerate(confirmed_histories(history)):
        for frame, group in steps:
            cell = row, frame
            turn_rate[cell], extent[cell] = group.turn_rate_rad_per_s, group.extent_m2
            n_points[cell] = group.n_points
    width, length = np.moveaxis(_ellipse_axes_m(extent), -1, 0)
    dims = ("track", "frame")
    axes = ["x", "y"]
    return tracks.assign(
        turn_rate=(dims, turn_rate, {"units": "rad/s"}),
        extent=((*dims, "axis", "other_axis"), extent, {"units": "m^2"}),
        length=(dims, length, {"units": "m"}),
        width=(dims, width, {"units": "m"}),
        n_points=(dims, n_points),
    ).assign_coords(axis=axes, other_axis=axes)


def _ellipse_axes_m(extent_m2: np.ndarray) -> np.ndarray:
    """Compute the axes of ellipses (..., 2) from extents (..., 2, 2), the shorter first.

    An evenly filled ellipse has the variance of a sixteenth of its squared axes.
    """
    return 4 * np.sqrt(_eigenvalues(extent_m2))


def _eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """Compute the eigenvalues of symmetric 2 by 2 matrices (..., 2, 2), the smaller first."""
    xx, xy, yy = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    mean, difference = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return np.stack([np.maximum(mean - difference, 0.0), mean + difference], axis=-1)
