"""Tracks as frames arrive: predicted, associated, confirmed, dropped and started."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import xarray as xr

from dechirp.core.checks import number
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.process.columns import must_be
from dechirp.tracking.measured import Measured, measured, rows_of
from dechirp.tracking.start import first_states
from dechirp.tracking.tracker import Tracker

if TYPE_CHECKING:
    from dechirp.tracking.stone_soup import Belief, StoneSoup

_MINE = 0.5  # from this probability on, a detection is of a track, and a track is detected
_LONGEST_S = 1e9


@value
class Track:
    """A target as it is believed to be after a frame."""

    number: int
    """Counted from 0 in the order in which tracks start, false ones included."""
    state: tuple[float, float, float, float]
    """x, vx, y, vy, in m and m/s, coordinates of the radar."""
    covariance: tuple[tuple[float, ...], ...]
    """4 by 4."""
    status: Literal["tentative", "confirmed"]
    age: int
    """Frames since its first."""


class LiveTracker:
    """Tracks that are kept from frame to frame.

    Confirmed tracks are associated first; tentative ones with what those leave, and what is left
    then starts new ones. So false alarms do not compete with targets that are known.

    Parameters
    ----------
    tracker : Tracker
    velocity_span_m_per_s : float, optional
        Span of unambiguous velocity, twice `Frame.max_velocity_m_per_s`: rates of detections
        whose `fold` is NaN are taken up to a multiple of it, where their track tells which, and
        else left out. Without it, they are taken as they are.

    Raises
    ------
    InvalidSetting
        If Stone Soup is not installed.
    """

    def __init__(self, tracker: Tracker, *, velocity_span_m_per_s: float | None = None) -> None:
        must_be("tracker", tracker, Tracker, fix="Give Tracker(), its settings.")
        if velocity_span_m_per_s is not None:
            number("velocity_span_m_per_s", velocity_span_m_per_s, above=0)
        self._tracker = tracker
        self._span_m_per_s = velocity_span_m_per_s
        self._filters = _filters(tracker)
        self._held: list[_Held] = []
        self._n_started = 0
        self._time_s: float | None = None

    def step(self, found: xr.Dataset, time_s: float) -> tuple[Track, ...]:
        """Tracks after a frame.

        Parameters
        ----------
        found : Dataset over `detection` or `cluster`
            Those of one frame; none is a frame as well. Rows without range, azimuth or their
            errors are not used.
        time_s : float
            Of the frame's middle, later than that of the frame before; by how much is free.

        Raises
        ------
        InvalidSetting
            If the time does not go forward, or columns are missing; the tracks stay as they were.
        NotEnoughMemory
            If there are so many tracks and detections that their pairs would not fit.
        """
        return self.advance(self.measured(found), time_s)

    def measured(self, found: xr.Dataset) -> Measured:
        """What the tracker takes of a table: its usable rows, in the plane."""
        rows_of(found)  # raises where it is no table to track
        return measured(
            found,
            target_size_m=self._tracker.target_size_m,
            velocity_span_m_per_s=self._span_m_per_s,
        )

    def advance(self, frame: Measured, time_s: float) -> tuple[Track, ...]:
        """Tracks after a frame, as `step`, of what it measured."""
        now_s = number("time_s", time_s, at_least=-_LONGEST_S, at_most=_LONGEST_S)
        if self._time_s is not None and not now_s > self._time_s:
            raise InvalidSetting(
                "time_s",
                got=f"{now_s:.9g} s, after a frame at {self._time_s:.9g} s",
                need="later than the frame before",
                fix="Give frames in the order of their times, each once; leave late ones out.",
            )
        passed_s = 0.0 if self._time_s is None else now_s - self._time_s
        self._time_s = now_s
        for status in ("confirmed", "tentative"):
            some = [one for one in self._held if one.status == status]
            frame = self._followed(some, passed_s, frame)
        self._held = [one for one in self._held if one.lives(self._tracker)]
        self._start(frame)
        return tuple(one.told() for one in self._held)

    def _followed(self, some: Sequence["_Held"], passed_s: float, frame: Measured) -> Measured:
        """Detections that are left when some tracks have taken theirs."""
        step = self._filters.step([one.belief for one in some], passed_s, frame)
        for one, belief, shares in zip(some, step.beliefs, step.shares, strict=True):
            one.goes_on(belief, is_hit=shares.sum() >= _MINE, tracker=self._tracker)
        return frame.some(step.shares.sum(axis=0) < _MINE)

    def _start(self, frame: Measured) -> None:
        from dechirp.tracking.stone_soup import Belief

        means, covariances = first_states(frame, self._tracker.speed_std_m_per_s)
        for mean, covariance in zip(means, covariances, strict=True):
            held = _Held(self._n_started, Belief(mean, covariance))
            held.confirm(self._tracker)
            self._held.append(held)
            self._n_started += 1


class _Held:
    """A track that is kept: its state, and what becomes of it."""

    def __init__(self, number: int, belief: "Belief") -> None:
        self.number = number
        self.belief = belief
        self.status: Literal["tentative", "confirmed"] = "tentative"
        self.age = 0
        self.hits = 1
        self.misses = 0
        """In a row."""

    def goes_on(self, belief: "Belief", *, is_hit: bool, tracker: Tracker) -> None:
        self.belief = belief
        self.age += 1
        self.hits += is_hit
        self.misses = 0 if is_hit else self.misses + 1
        self.confirm(tracker)

    def confirm(self, tracker: Tracker) -> None:
        if self.hits >= tracker.confirm_after[0]:
            self.status = "confirmed"

    def lives(self, tracker: Tracker) -> bool:
        if self.status == "confirmed":
            return self.misses < tracker.drop_after
        hits, frames = tracker.confirm_after
        return self.hits + frames - 1 - self.age >= hits  # it can still be confirmed

    def told(self) -> Track:
        return Track(
            number=self.number,
            state=tuple(self.belief.mean.tolist()),
            covariance=tuple(map(tuple, self.belief.covariance.tolist())),
            status=self.status,
            age=self.age,
        )


def _filters(tracker: Tracker) -> "StoneSoup":
    try:
        from dechirp.tracking.stone_soup import StoneSoup
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "stonesoup":
            raise
        raise InvalidSetting(
            "Tracker",
            got="a tracker, while Stone Soup is not installed",
            need="Stone Soup, for its filters and association",
            fix="Run pip install 'dechirp[track]'.",
        ) from None
    return StoneSoup(tracker)
