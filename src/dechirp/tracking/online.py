"""Online tracking: predicts, associates, confirms, drops and starts tracks frame by frame."""

from collections.abc import Sequence
from importlib import import_module
from typing import Literal

import numpy as np
import scipy
import xarray as xr

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_number
from dechirp.core.detection_columns import check_type
from dechirp.core.errors import InvalidSetting
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.tracking.kalman_filter import (
    N_BODY_STATES,
    BodyOffsets,
    StateEstimates,
    near_side_offsets_m,
)
from dechirp.tracking.measurements import (
    Measurements,
    checked_row_axis_name,
    usable_rows_to_measurements,
)
from dechirp.tracking.poses import AT_ORIGIN, RadarPose, RadarView
from dechirp.tracking.separation import is_within_separation
from dechirp.tracking.track_update import (
    MAX_TURN_RATE_RAD_PER_S,
    predict_associate_and_update,
)
from dechirp.tracking.tracker import Tracker


def initial_track_means_and_covariances(
    measurements: Measurements, speed_std_m_per_s: float, pose: RadarPose = AT_ORIGIN
) -> tuple[np.ndarray, np.ndarray]:
    """Compute means (n, 4) and covariances (n, 4, 4) of x, vx, y, vy, of echoes.

    Along the line of sight from range and range rate; across it from the azimuth and an unknown
    velocity. A speed v across and an azimuth error d change the rate by v d, which adds to its
    error; that of the radar correlates it with the position. An ambiguous rate is ignored if 4
    standard deviations of speed exceed half a span.
    """
    azimuth, range_m, rate = measurements.z.T
    azimuth = azimuth + pose.yaw_rad
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    radar_vx, radar_vy = pose.velocity_m_per_s
    radar_radial, radar_across = cos * radar_vx + sin * radar_vy, cos * radar_vy - sin * radar_vx
    azimuth_variance, range_variance, rate_variance = measurements.variance.T
    has_rate = np.isfinite(rate) & (4 * speed_std_m_per_s < measurements.span_m_per_s / 2)
    speed_variance = speed_std_m_per_s**2
    radial_speed = np.where(has_rate, rate + radar_radial, 0.0)
    span = np.where(np.isfinite(measurements.span_m_per_s), measurements.span_m_per_s, 0.0)
    radial_speed -= span * np.round(radial_speed / measurements.span_m_per_s)
    radial_variance = np.where(
        has_rate,
        rate_variance + (speed_variance + radar_across**2) * azimuth_variance,
        speed_variance,
    )
    # x vx y vy from radial and tangential position and speed.
    rotation = np.zeros((len(range_m), 4, 4))
    rotation[:, [0, 1, 2, 3], [0, 1, 2, 3]] = cos[:, None]
    rotation[:, [0, 1], [2, 3]], rotation[:, [2, 3], [0, 1]] = -sin[:, None], sin[:, None]
    zeros = np.zeros_like(range_m)
    mean = np.stack([range_m, radial_speed, zeros, zeros], axis=-1)
    variance = np.stack(
        [
            range_variance,
            radial_variance,
            range_m**2 * azimuth_variance,
            np.full_like(range_m, speed_variance),
        ],
        axis=-1,
    )
    local = np.zeros((len(range_m), 4, 4))
    local[:, range(4), range(4)] = variance
    local[:, 1, 2] = local[:, 2, 1] = np.where(
        has_rate, range_m * radar_across * azimuth_variance, 0.0
    )
    # The echo of a body that turns has another velocity than its centre.
    local[:, 1, 1] += np.where(
        has_rate, MAX_TURN_RATE_RAD_PER_S**2 * measurements.size_m2[:, 1], 0.0
    )
    origin = np.array([pose.position_m[0], 0.0, pose.position_m[1], 0.0])
    return (
        np.einsum("nij,nj->ni", rotation, mean) + origin,
        rotation @ local @ rotation.swapaxes(1, 2),
    )


def add_offset_states(
    means: np.ndarray, covariances: np.ndarray, offsets: BodyOffsets
) -> tuple[np.ndarray, np.ndarray]:
    """Return means (n, 6) and covariances of the centres of bodies from those of their echoes.

    The offsets are independent of the errors of the echoes.
    """
    to_centre = np.eye(N_BODY_STATES)
    to_centre[[0, 2], [4, 5]] = -1.0
    padded = np.zeros((len(means), N_BODY_STATES, N_BODY_STATES))
    padded[:, :4, :4] = covariances
    padded[:, 4:, 4:] = offsets.covariance_m2
    means = np.concatenate([means, offsets.mean_m], axis=1)
    return means @ to_centre.T, to_centre @ padded @ to_centre.T


def body_covariances_m2(measurements: Measurements, pose: RadarPose = AT_ORIGIN) -> np.ndarray:
    """Return the covariances of echoes about the centres of their bodies, along x and y."""
    angle = measurements.z[:, 0] + pose.yaw_rad
    cos, sin = np.cos(angle), np.sin(angle)
    axes = np.stack([cos, -sin, sin, cos], axis=-1).reshape(-1, 2, 2)
    return (axes * measurements.size_m2[:, None]) @ axes.swapaxes(1, 2)


_MIN_SHARE = 0.5  # probability from which a detection belongs to a track, and a track is detected
_MAX_TIME_S = 1e9
_SIZE_TIME_S = 2.0  # in which parts of a body that are hidden are forgotten


@frozen_dataclass
class Track:
    """Estimate of a target after a frame."""

    number: int
    """Number from 0 in the order of track starts, false tracks included."""
    state: tuple[float, float, float, float]
    """x, vx, y, vy, in m and m/s, coordinates of the radar; of several radars those of their
    poses."""
    covariance: tuple[tuple[float, ...], ...]
    """4 by 4."""
    status: Literal["tentative", "confirmed"]
    age: int
    """Frames since the first one in which it was in view."""


class LiveTracker:
    """Tracker that is updated frame by frame.

    Confirmed tracks are associated first, tentative ones with the remaining detections; those that
    then remain start new tracks. So false alarms do not compete with known targets. A detection
    with errors so large that its gate contains the radar, or all azimuths, starts no track.

    Parameters
    ----------
    tracker : Tracker
    velocity_span_m_per_s : float, optional
        Unambiguous velocity span, twice `Frame.max_velocity_m_per_s`: rates of detections whose
        `ambiguity_number` is NaN are used modulo the span if their track resolves it, and else
        ignored. By default they are used as they are.

    Raises
    ------
    InvalidSetting
        If Stone Soup is not installed.
    """

    @check_argument_types
    def __init__(self, tracker: Tracker, *, velocity_span_m_per_s: float | None = None) -> None:
        check_type("tracker", tracker, Tracker, fix="give Tracker(), its settings")
        if velocity_span_m_per_s is not None:
            check_number("velocity_span_m_per_s", velocity_span_m_per_s, above=0)
        self._tracker = tracker
        self._span_m_per_s = velocity_span_m_per_s
        _check_stone_soup_is_installed()
        self._tracks: list[_LiveTrack] = []
        self._n_started = 0
        self._time_s: float | None = None

    def step(self, detections: xr.Dataset, time_s: float) -> tuple[Track, ...]:
        """Update the tracks with the detections of a frame.

        Parameters
        ----------
        detections : Dataset over `detection` or `cluster`
            Detections of one frame, possibly none. Rows without range, azimuth or their errors
            are ignored.
        time_s : float
            Middle of the frame, later than the frame before; steps may differ.

        Raises
        ------
        InvalidSetting
            If the time does not increase, or columns are missing; the tracks are unchanged.
        NotEnoughMemory
            If the pairs of tracks and detections would not fit.
        """
        return self.step_with_measurements(self.usable_rows_to_measurements(detections), time_s)

    def usable_rows_to_measurements(self, detections: xr.Dataset) -> Measurements:
        """Convert the usable rows of a table to measurements."""
        checked_row_axis_name(detections)  # raises if the table cannot be tracked
        return usable_rows_to_measurements(
            detections,
            target_size_m=self._tracker.target_size_m,
            velocity_span_m_per_s=self._span_m_per_s,
        )

    def step_with_measurements(
        self, measurements: Measurements, time_s: float
    ) -> tuple[Track, ...]:
        """Update the tracks like `step`, with measurements."""
        passed_s, self._time_s = interval_since_frame_before(time_s, self._time_s)
        return self._step_over_interval(measurements, passed_s, RadarView(), 1)

    def step_with_view(
        self, measurements: Measurements, time_s: float, view: RadarView, n_radars: int
    ) -> tuple[Track, ...]:
        """Update the tracks with measurements of one of several radars.

        Frames of different radars may have the same time. A frame without a detection counts as a
        miss only of tracks in its view; tracks end as well without a detection in any of
        `drop_after` (or the frames of `confirm_after`, if more) of each radar.
        """
        passed_s = 0.0
        if time_s != self._time_s:
            passed_s, self._time_s = interval_since_frame_before(time_s, self._time_s)
        return self._step_over_interval(measurements, passed_s, view, n_radars)

    def _step_over_interval(
        self, measurements: Measurements, passed_s: float, view: RadarView, n_radars: int
    ) -> tuple[Track, ...]:
        confirmed = [item for item in self._tracks if item.status == "confirmed"]
        tentative = [item for item in self._tracks if item.status == "tentative"]
        for tracks in (confirmed, tentative):
            measurements = self._update_tracks_and_select_unassociated(
                tracks, passed_s, measurements, view
            )
        longest_gap = max(self._tracker.drop_after, self._tracker.confirm_after[1])
        self._tracks = [
            live_track
            for live_track in self._tracks
            if live_track.is_alive(
                confirm_after=self._tracker.confirm_after, drop_after=self._tracker.drop_after
            )
            and live_track.frames_since_hit < n_radars * longest_gap
        ]
        measurements = self._select_located(measurements)
        self._start_tracks(self._select_separate(measurements, view.pose), view.pose)
        self._drop_second_tracks(confirmed)
        return tuple(live_track.to_track() for live_track in self._tracks)

    def _update_tracks_and_select_unassociated(
        self,
        tracks: Sequence["_LiveTrack"],
        passed_s: float,
        measurements: Measurements,
        view: RadarView,
    ) -> Measurements:
        """Update some tracks, and return the measurements that belong to none of them."""
        if not tracks:
            return measurements
        states = _stack_states(tracks)
        sizes_m2 = None
        if self._tracker.target_size_m:
            sizes_m2 = np.array([live_track.size_m2 for live_track in tracks])
        step = predict_associate_and_update(
            self._tracker, states, passed_s, measurements, view.pose, sizes_m2
        )
        if sizes_m2 is not None and len(measurements.z):
            _update_sizes(
                tracks, step.shares, body_covariances_m2(measurements, view.pose), passed_s
            )
        hit_mask = (step.shares.sum(axis=1) >= _MIN_SHARE).tolist()
        for live_track, mean, covariance, is_hit in zip(
            tracks, *step.states, hit_mask, strict=True
        ):
            live_track.mean, live_track.covariance = mean, covariance
            if is_hit or view.contains(float(mean[0]), float(mean[2])):
                live_track.count_frame(is_hit=is_hit, confirm_after=self._tracker.confirm_after)
            else:
                live_track.frames_since_hit += 1
        return measurements.select_measurements(step.shares.sum(axis=0) < _MIN_SHARE)

    def _select_separate(self, measurements: Measurements, pose: RadarPose) -> Measurements:
        """Return the measurements that are not within the separation of a confirmed track."""
        azimuth, range_m, _ = measurements.z.T
        angle = azimuth + pose.yaw_rad
        positions_m = pose.position_m + range_m[:, None] * np.stack(
            [np.cos(angle), np.sin(angle)], axis=-1
        )
        confirmed = [item for item in self._tracks if item.status == "confirmed"]
        return measurements.select_measurements(~self._is_near(positions_m, confirmed))

    def _drop_second_tracks(self, confirmed: Sequence["_LiveTrack"]) -> None:
        """Drop tracks that are newly confirmed, within the separation of a confirmed one.

        Before the first confirmation each part of a target starts a track.
        """
        kept = [item for item in self._tracks if item in confirmed]
        for item in self._tracks:
            is_new = item.status == "confirmed" and item not in confirmed
            if is_new and not self._is_near(item.mean[None, [0, 2]], kept)[0]:
                kept.append(item)
        self._tracks = [item for item in self._tracks if item in kept or item.status == "tentative"]

    def _is_near(self, positions_m: np.ndarray, tracks: Sequence["_LiveTrack"]) -> np.ndarray:
        """Return True for positions (n, 2) within the separation of any of the tracks, (n,)."""
        along_m, across_m = self._tracker.min_separation_m
        if not (along_m and tracks):
            return np.zeros(len(positions_m), dtype=bool)
        return is_within_separation(positions_m, _stack_states(tracks), along_m, across_m)

    def _select_located(self, measurements: Measurements) -> Measurements:
        """Return the measurements whose gate excludes the radar and is below a full turn.

        Others have errors as large as their coordinates, so Cartesian states cannot represent them,
        and their gate contains the detections of other targets. The size of a target is no error.
        """
        half_width = np.sqrt(scipy.special.chdtri(3, 1 - self._tracker.gate_probability))
        azimuth_std, range_std, _ = np.sqrt(measurements.variance).T
        range_m = measurements.z[:, 1]
        is_located = (half_width * range_std < range_m) & (half_width * azimuth_std < np.pi)
        return measurements.select_measurements(is_located)

    def _start_tracks(self, measurements: Measurements, pose: RadarPose) -> None:
        means, covariances = initial_track_means_and_covariances(
            measurements, self._tracker.speed_std_m_per_s, pose
        )
        sizes_m2 = body_covariances_m2(measurements, pose)
        if self._tracker.target_size_m:
            near_m = near_side_offsets_m(means, pose, self._tracker.target_size_m)
            offsets = BodyOffsets(near_m, sizes_m2)
            means, covariances = add_offset_states(means, covariances, offsets)
        for mean, covariance, size_m2 in zip(means, covariances, sizes_m2, strict=True):
            live_track = _LiveTrack(self._n_started, mean, covariance, size_m2)
            live_track.confirm_if_enough_hits(self._tracker.confirm_after)
            self._tracks.append(live_track)
            self._n_started += 1


def interval_since_frame_before(time_s: float, last_time_s: float | None) -> tuple[float, float]:
    """Return the interval since the frame before, 0 for the first one, and the checked time.

    Raises
    ------
    InvalidSetting
        If the time does not increase.
    """
    now_s = check_number("time_s", time_s, at_least=-_MAX_TIME_S, at_most=_MAX_TIME_S)
    if last_time_s is not None and not now_s > last_time_s:
        raise InvalidSetting(
            "time_s",
            value=f"{format_si(now_s, 's', 9)}, after a frame at {format_si(last_time_s, 's', 9)}",
            expected="later than the frame before",
            fix="pass frames in the order of their times, each once; drop late ones",
        )
    return (0.0 if last_time_s is None else now_s - last_time_s), now_s


class TrackStatus:
    """Status of a live track, from its counts of detections."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.status: Literal["tentative", "confirmed"] = "tentative"
        self.age = 0
        self.hits = 1
        self.misses = 0
        """Consecutive misses."""
        self.frames_since_hit = 0
        """Frames without a detection, also out of view."""

    def count_frame(self, *, is_hit: bool, confirm_after: tuple[int, int]) -> None:
        """Count a frame after the first one."""
        self.age += 1
        self.hits += is_hit
        self.misses = 0 if is_hit else self.misses + 1
        self.frames_since_hit = 0 if is_hit else self.frames_since_hit + 1
        self.confirm_if_enough_hits(confirm_after)

    def confirm_if_enough_hits(self, confirm_after: tuple[int, int]) -> None:
        """Confirm a track with enough detections."""
        if self.hits >= confirm_after[0]:
            self.status = "confirmed"

    def is_alive(self, *, confirm_after: tuple[int, int], drop_after: int) -> bool:
        """Return whether the track goes on."""
        if self.status == "confirmed":
            return self.misses < drop_after
        hits, frames = confirm_after
        return self.hits + frames - 1 - self.age >= hits  # confirmation is still possible


class _LiveTrack(TrackStatus):
    """Live track: state and status."""

    def __init__(
        self, number: int, mean: np.ndarray, covariance: np.ndarray, size_m2: np.ndarray
    ) -> None:
        super().__init__(number)
        self.mean, self.covariance = mean, covariance
        self.size_m2 = size_m2
        """Covariance of the echo about the centre of a body, along x and y."""

    def to_track(self) -> Track:
        return Track(
            number=self.number,
            state=tuple(self.mean[:4].tolist()),
            covariance=tuple(map(tuple, self.covariance[:4, :4].tolist())),
            status=self.status,
            age=self.age,
        )


def _stack_states(tracks: Sequence["_LiveTrack"]) -> StateEstimates:
    return StateEstimates(
        np.array([live_track.mean for live_track in tracks]),
        np.array([live_track.covariance for live_track in tracks]),
    )


def _update_sizes(
    tracks: Sequence["_LiveTrack"],
    shares: np.ndarray,
    measured_m2: np.ndarray,
    passed_s: float,
) -> None:
    """Update the sizes of tracks with those of their likeliest measurements.

    A larger one replaces the size at once; smaller ones, in which parts of a body are hidden, fade
    it.
    """
    for live_track, share in zip(tracks, shares, strict=True):
        if share.max() < _MIN_SHARE:
            continue
        size_m2 = measured_m2[share.argmax()]
        weight = 1 - np.exp(-passed_s / _SIZE_TIME_S)
        if np.trace(size_m2) > np.trace(live_track.size_m2):
            weight = 1.0
        live_track.size_m2 = live_track.size_m2 + weight * (size_m2 - live_track.size_m2)


def _check_stone_soup_is_installed() -> None:
    try:
        import_module("dechirp.tracking.stone_soup")
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "stonesoup":
            raise
        raise InvalidSetting(
            "Tracker",
            value="a tracker without Stone Soup installed",
            expected="Stone Soup, for its association",
            fix="run pip install 'dechirp[track]'",
        ) from None
