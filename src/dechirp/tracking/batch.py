"""Batch tracking: tracks from the detections of all frames."""

import warnings
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.argument_types import check_argument_types
from dechirp.core.checks import check_finite_array, check_integer
from dechirp.core.detection_columns import check_type
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import check_free_memory
from dechirp.tracking.measurements import Measurements, checked_row_axis_name, usable_row_mask
from dechirp.tracking.online import LiveTracker, Track
from dechirp.tracking.tracker import Tracker, warn_of_too_few_frames

STATE = ("x", "vx", "y", "vy")

_AnyTrack = TypeVar("_AnyTrack", bound=Track)

TrackHistory = dict[int, list[tuple[int, _AnyTrack]]]
"""Frames and states of each track, by its number."""


@check_argument_types
def track(
    detections: xr.Dataset,
    times_s: ArrayLike,
    tracker: Tracker | None = None,
    *,
    first: int = 0,
    velocity_span_m_per_s: float | None = None,
) -> xr.Dataset:
    """Track targets from their detections in each frame.

    Parameters
    ----------
    detections : Dataset over `detection` or `cluster`
        At most one row per target and frame: cluster extended targets first. Rows without azimuth,
        range or their errors are ignored.
    times_s : array (n_frames,)
        Middle of each frame, with or without rows of `detections`; increasing. A missing frame is
        a longer step.
    tracker : Tracker, optional
        Settings; defaults if omitted.
    first : int
        Number of the first frame, as in the column `frame`.
    velocity_span_m_per_s : float, optional
        See `LiveTracker`.

    Returns
    -------
    Dataset over (track, frame)
        Confirmed tracks in the order of their start: `x y` (m), `vx vy` (m/s) in coordinates of
        the radar in that frame, `covariance` (track, frame, state, other_state), `status`
        ("tentative", "confirmed", or "" outside the track); NaN outside the track.

    Raises
    ------
    InvalidSetting
        If times do not increase, rows are of other frames, columns are missing, Stone Soup is
        not installed, or false alarms are so dense that a miss is always likelier.
    NotEnoughMemory
        If the tracks, or a frame's pairs of tracks and detections, would not fit.

    Warns
    -----
    PhysicsWarning
        If rows are ignored, or the frames are too few to confirm a track.

    Notes
    -----
    Targets are assumed to move straight on in the plane, with velocities relative to the radar: a
    radar at constant velocity has no effect, one that turns or brakes appears as an acceleration
    of all targets, which `process_noise_m2_per_s3` must cover.

    Association fails where targets are within about a standard error of each other in range,
    azimuth and velocity at once, for many frames. Joint association then draws their tracks
    together (coalescence), and after they separate each may follow either target; nearest
    association swaps them from frame to frame. Two targets side by side for 3 s, at 50 m with
    an azimuth error of 0.5 m and 10 false alarms per frame: one standard error apart or less, both
    methods kept 7 to 9 of 20 pairs; two apart, nearest kept 5 and joint 16; four apart, nearest
    kept 19. A target whose echo merges with another's for `drop_after` frames is lost by both.

    Where more than 8 tracks are linked by detections in several gates, joint probabilities are
    those of loopy belief propagation: up to 0.1 off, but exact sums would take minutes.

    The extended filter is overconfident in the first frames of a track, when a wide prior of the
    velocity is rotated by the error of the azimuth (mean NEES 6.4 instead of 4 in frame 3 of
    the example `crossing-tracks`; unscented 3.8). Both are overconfident where the error across
    the line of sight, (range x azimuth error)^2 / (2 range), exceeds the error of its range: raise
    `target_size_m`.

    References
    ----------
    Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, Wiley, 2001. T. E. Fortmann, Y. Bar-Shalom, M. Scheffe, IEEE J. Oceanic
    Engineering 8(3), 1983 (joint association). P. Horridge, S. Maskell, FUSION 2006 (how
    Stone Soup sums hypotheses). J. L. Williams, R. A. Lau, IEEE Trans. AES 50(4), 2014 (loopy
    belief propagation).
    """
    tracker = Tracker() if tracker is None else tracker
    check_type("tracker", tracker, Tracker, fix="give Tracker(), its settings")
    axis = checked_row_axis_name(detections, "frame")
    times = check_finite_array("times_s", times_s, may_be_empty=True).reshape(-1)
    check_integer("first", first, at_least=0)
    warn_of_too_few_frames("tracker", tracker.confirm_after, len(times))
    live_tracker = LiveTracker(tracker, velocity_span_m_per_s=velocity_span_m_per_s)
    rows = usable_row_mask(detections)
    warn_of_ignored_rows(int(np.sum(~rows)), len(rows), axis)
    measurements = live_tracker.usable_rows_to_measurements(detections)
    frame_index = frame_index_per_row(detections, first, len(times))[rows]
    check_false_alarm_density(measurements, tracker)
    history: TrackHistory[Track] = {}
    for frame, time_s in enumerate(times):
        tracks = live_tracker.step_with_measurements(
            measurements.select_measurements(frame_index == frame), time_s
        )
        for live_track in tracks:
            history.setdefault(live_track.number, []).append((frame, live_track))
        drop_ended_unconfirmed_tracks(history, {live_track.number for live_track in tracks})
    return confirmed_tracks_to_dataset(history, times, first)


def drop_ended_unconfirmed_tracks(
    history: TrackHistory[_AnyTrack], live_track_numbers: set[int]
) -> None:
    """Drop tracks that ended before they were confirmed: most of those from false alarms."""
    for number in [number for number in history if number not in live_track_numbers]:
        if not _is_track_confirmed(history[number]):
            del history[number]


def _is_track_confirmed(frames_and_states: Sequence[tuple[int, _AnyTrack]]) -> bool:
    return frames_and_states[-1][1].status == "confirmed"


def confirmed_histories(
    history: TrackHistory[_AnyTrack],
) -> list[list[tuple[int, _AnyTrack]]]:
    """Return frames and states of confirmed tracks, in the order of their start."""
    return [history[number] for number in sorted(history) if _is_track_confirmed(history[number])]


def frame_index_per_row(
    detections: xr.Dataset, first_frame: int, n_frames: int, *, table: str = "detections"
) -> np.ndarray:
    """Return the index of each row's frame in the list of times."""
    frame = detections["frame"].values
    index = frame - first_frame
    invalid = frame[~((index >= 0) & (index < n_frames) & (index == np.floor(index)))]
    if len(invalid):
        raise InvalidSetting(
            f"{table}.frame",
            value=invalid[0],
            expected=f"a number from {first_frame} to {first_frame + n_frames - 1}, for which there"
            " are times",
            fix="pass the time of each frame, and the number of the first",
        )
    return index


def check_false_alarm_density(measurements: Measurements, tracker: Tracker) -> None:
    """Raise `InvalidSetting` if false alarms are so dense that a miss is always likelier."""
    if len(measurements.z):
        tracker.check_false_alarm_density(_median_measurement_errors(measurements, tracker))


def _median_measurement_errors(measurements: Measurements, tracker: Tracker) -> np.ndarray:
    """Medians of the standard errors of azimuth, range and rate."""
    azimuth, range_m, rate = np.sqrt(measurements.variance).T
    known_rate = rate[np.isfinite(rate)]
    # An unknown rate is as likely as that of a false alarm.
    extent = tracker.false_alarms.velocity_span_m_per_s / np.sqrt(2 * np.pi)
    return np.array(
        [
            np.median(azimuth),
            np.median(range_m),
            np.median(known_rate) if len(known_rate) else extent,
        ]
    )


def warn_of_ignored_rows(n_ignored: int, n_rows: int, row_axis: str) -> None:
    """Warn of rows without range, azimuth or their errors."""
    if n_ignored:
        finding = Finding(
            level="warning",
            setting="tracker",
            value=f"{n_ignored} of {n_rows} {row_axis}s without range, azimuth or their errors,"
            " ignored",
            expected="range and azimuth with standard errors",
            fix="choose a direction estimator in chain.angle, and an array that resolves azimuth",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)


def confirmed_tracks_to_dataset(
    history: TrackHistory[_AnyTrack], times_s: np.ndarray, first_frame: int
) -> xr.Dataset:
    """Convert confirmed tracks to a dataset over tracks and frames."""
    confirmed = confirmed_histories(history)
    shape = (len(confirmed), len(times_s))
    n_bytes = 200 * len(confirmed) * len(times_s)  # 20 floats and nine letters
    check_free_memory("the tracks", needed_bytes=n_bytes, fix="track fewer frames at once")
    state = np.full((*shape, 4), np.nan)
    covariance = np.full((*shape, 4, 4), np.nan)
    status = np.full(shape, "", dtype="<U9")
    for row, steps in enumerate(confirmed):
        for frame, live_track in steps:
            cell = row, frame
            state[cell], covariance[cell], status[cell] = (
                live_track.state,
                live_track.covariance,
                live_track.status,
            )
    dims = ("track", "frame")
    units = {"x": "m", "y": "m", "vx": "m/s", "vy": "m/s"}
    columns = {name: (dims, state[..., i], {"units": units[name]}) for i, name in enumerate(STATE)}
    return xr.Dataset(
        {
            **columns,
            "covariance": ((*dims, "state", "other_state"), covariance),
            "status": (dims, status),
        },
        coords={
            "track": np.arange(len(confirmed)),
            "frame": np.arange(first_frame, first_frame + len(times_s)),
            "time": ("frame", times_s, {"units": "s"}),
            "state": list(STATE),
            "other_state": list(STATE),
        },
    )
