"""Tracks from the detections of all frames."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from dechirp.core.checks import numbers, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.memory import must_fit
from dechirp.process.columns import must_be
from dechirp.tracking.live import LiveTracker, Track
from dechirp.tracking.measured import Measured, rows_of, usable
from dechirp.tracking.tracker import Tracker

STATE = ("x", "vx", "y", "vy")

History = dict[int, list[tuple[int, Track]]]
"""Of each track, by its number: the frames in which it was, and as what."""


def track(
    found: xr.Dataset,
    times_s: ArrayLike,
    tracker: Tracker | None = None,
    *,
    first: int = 0,
    velocity_span_m_per_s: float | None = None,
) -> xr.Dataset:
    """Tracks of targets, from their detections in each frame.

    Parameters
    ----------
    found : Dataset over `detection` or `cluster`
        As `detect` gives them. At most one row of a target in a frame: cluster bodies first. Rows
        without azimuth, range or their errors are not used.
    times_s : array (n_frames,)
        Of the middle of each frame, in which `found` may have rows or none. They go forward; a
        frame that is missing is a longer step.
    tracker : Tracker, optional
        Settings; the default ones without it.
    first : int
        Number of the first frame, as in the column `frame`.
    velocity_span_m_per_s : float, optional
        As `LiveTracker` takes it.

    Returns
    -------
    Dataset over (track, frame)
        Tracks that were confirmed, in the order in which they started: `x y` (m), `vx vy` (m/s) in
        coordinates of the radar in that frame, `covariance` (track, frame, state, other_state),
        `status` ("tentative", "confirmed", "" where there is none), NaN where a track is not.

    Raises
    ------
    InvalidSetting
        If times do not go forward, rows are of other frames, columns are missing, Stone Soup is
        not installed, or the settings can never confirm a track: too few frames, or false alarms
        so dense that a miss is always likelier.
    NotEnoughMemory
        If the tracks, or a frame's pairs of tracks and detections, would not fit.

    Warns
    -----
    PhysicsWarning
        If rows were left out.

    Notes
    -----
    Targets are taken to move straight on in the plane, and their velocity is seen from the radar:
    a radar that drives straight does not matter, one that turns or brakes is felt as acceleration
    of all targets, which `process_noise_m2_per_s3` must cover.

    Association fails where targets are within about a standard error of each other in range,
    azimuth and velocity at once, for many frames. Joint association then draws their tracks
    together (coalescence), and when they part again each may go with either; nearest association
    swaps them from frame to frame. Two targets side by side for 3 s, at 50 m with an azimuth error
    of 0.5 m and 10 false alarms a frame: one standard error apart or less, both methods held 7 to
    9 of 20 pairs; two apart, nearest held 5 and joint 16; four apart, nearest held 19. A target
    whose echo merges with another's for `drop_after` frames is lost by either.

    Where more than 8 tracks are linked by detections in several gates, joint probabilities are
    those of loopy belief propagation: up to 0.1 off, but exact sums would take minutes.

    The extended filter is too sure in the first frames of a track, when a wide guess of the
    velocity is turned by the error of the azimuth (mean NEES 6.4 instead of 4 in frame 3 of
    the example `crossing-tracks`; unscented 3.8). Either is too sure where a target's spread
    across, (range x azimuth error)^2 / (2 range), exceeds the error of its range: raise
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
    must_be("tracker", tracker, Tracker, fix="Give Tracker(), its settings.")
    over = rows_of(found, "frame")
    times = numbers("times_s", times_s).reshape(-1)
    whole("first", first, at_least=0)
    tracker.must_confirm_within(len(times))
    live = LiveTracker(tracker, velocity_span_m_per_s=velocity_span_m_per_s)
    good = usable(found)
    _warn_unusable(int(np.sum(~good)), len(good), over)
    every = live.measured(found)
    place = _places(found, first, len(times))[good]
    if len(place):
        tracker.must_outweigh_false_alarms(_usual_errors(every, tracker))
    history: History = {}
    for frame, time_s in enumerate(times):
        now = live.advance(every.some(place == frame), time_s)
        for one in now:
            history.setdefault(one.number, []).append((frame, one))
        _forget(history, {one.number for one in now})
    return _table(history, times, first)


def _forget(history: History, alive: set[int]) -> None:
    """Take out tracks that ended before they were confirmed: most, where alarms are false."""
    for number in [number for number in history if number not in alive]:
        if not _is_confirmed(history[number]):
            del history[number]


def _is_confirmed(steps: Sequence[tuple[int, Track]]) -> bool:
    return steps[-1][1].status == "confirmed"


def _places(found: xr.Dataset, first: int, n_frames: int) -> np.ndarray:
    """Place in the list of times of each row's frame."""
    frame = found["frame"].values
    place = frame - first
    wrong = frame[~((place >= 0) & (place < n_frames) & (place == np.floor(place)))]
    if len(wrong):
        raise InvalidSetting(
            "found.frame",
            got=wrong[0],
            need=f"a number from {first} to {first + n_frames - 1}, for which there are times",
            fix="Give the time of each frame, and the number of the first.",
        )
    return place


def _usual_errors(every: Measured, tracker: Tracker) -> np.ndarray:
    """Medians of the standard errors of azimuth, range and rate."""
    azimuth, range_m, rate = np.sqrt(every.variance).T
    told = rate[np.isfinite(rate)]
    # A rate that tells nothing is as likely as a false alarm's.
    extent = tracker.false_alarms.velocity_extent_m_per_s / np.sqrt(2 * np.pi)
    return np.array(
        [np.median(azimuth), np.median(range_m), np.median(told) if len(told) else extent]
    )


def _warn_unusable(n_bad: int, n: int, over: str) -> None:
    if n_bad:
        finding = Finding(
            level="warning",
            setting="tracker",
            got=f"{n_bad} of {n} {over}s without a range, an azimuth or their errors, left out",
            need="range and azimuth, with standard errors, of what is tracked",
            fix="Choose a direction estimator in chain.angle, and an array that tells azimuth.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)


def _table(history: History, times_s: np.ndarray, first: int) -> xr.Dataset:
    """Tracks that were ever confirmed, over frames."""
    confirmed = [history[number] for number in sorted(history) if _is_confirmed(history[number])]
    shape = (len(confirmed), len(times_s))
    n_bytes = 200 * len(confirmed) * len(times_s)  # 20 floats and nine letters
    must_fit("the tracks", needed_bytes=n_bytes, fix="Track fewer frames at once.")
    state = np.full((*shape, 4), np.nan)
    covariance = np.full((*shape, 4, 4), np.nan)
    status = np.full(shape, "", dtype="<U9")
    for row, steps in enumerate(confirmed):
        for frame, one in steps:
            at = row, frame
            state[at], covariance[at], status[at] = one.state, one.covariance, one.status
    over = ("track", "frame")
    units = {"x": "m", "y": "m", "vx": "m/s", "vy": "m/s"}
    columns = {name: (over, state[..., i], {"units": units[name]}) for i, name in enumerate(STATE)}
    return xr.Dataset(
        {
            **columns,
            "covariance": ((*over, "state", "other_state"), covariance),
            "status": (over, status),
        },
        coords={
            "track": np.arange(len(confirmed)),
            "frame": np.arange(first, first + len(times_s)),
            "time": ("frame", times_s, {"units": "s"}),
            "state": list(STATE),
            "other_state": list(STATE),
        },
    )
