"""What is kept from frame to frame: tracks, and maps for the micro-Doppler."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.experiment.scenario import called
from dechirp.process.spectrum import Transform
from dechirp.radar.radar import Radar
from dechirp.tracking.live import LiveTracker, Track
from dechirp.tracking.tracker import Tracker

_REACH_M = 2.0  # a body's parts are this near its strongest one: a bicycle is 1.7 m long
_MOST_FRAMES = 200
_MOST_CELLS = 2**22  # 16 MiB of maps


class Kept(NamedTuple):
    """What is kept of a frame."""

    time_s: float
    power: np.ndarray
    """(velocity, range)"""
    strongest: np.ndarray
    """(velocity,) about where a cursor that was not told looked."""
    interval_s: float
    """From chirp to chirp: what velocities are told by."""


class Past:
    """Frames that followed each other in time, none of them left out.

    A frame that comes after no other, as after a rewind, a jump, or the end of the source, begins
    tracks and micro-Doppler anew.
    """

    frames: tuple[Kept, ...]
    """The last ones, oldest first."""

    def __init__(self, tracker: Tracker | None, radar: Radar) -> None:
        self._tracker = tracker
        self._span_m_per_s = 2 * radar.frame.at(0).max_velocity_m_per_s
        self.begin()

    def begin(self) -> None:
        """Forget all."""
        self.frames = ()
        self._live: LiveTracker | None = None
        if self._tracker is not None:
            with called("tracker", instead_of="Tracker"):
                self._live = LiveTracker(self._tracker, velocity_span_m_per_s=self._span_m_per_s)

    def goes_on(self, time_s: float) -> bool:
        """Whether a frame may follow at this time."""
        return not self.frames or time_s > self.frames[-1].time_s

    def tracks(self, rows: xr.Dataset, time_s: float) -> tuple[Track, ...]:
        """Tracks after another frame, of its detections or clusters."""
        return () if self._live is None else self._live.step(rows, time_s)

    def keep(self, power: xr.DataArray, radar: Radar, time_s: float, strongest_m: float) -> None:
        """Keep the map of another frame, of which the oldest are let go."""
        column = power.values[:, _about(strongest_m, power)].sum(axis=1)
        most = max(min(_MOST_FRAMES, _MOST_CELLS // power.size), 1)
        kept = Kept(time_s, power.values, column, radar.frame.only_interval_s)
        self.frames = (*self.frames, kept)[-most:]


def micro_doppler(
    frames: Sequence[Kept], power: xr.DataArray, over_range: Transform, range_m: float | None
) -> xr.DataArray:
    """Power over (time, velocity) within 2 m of a range, as `process.spectrogram` of frames.

    A window is a frame: its chirps tell velocities as finely as can be, and parts of a body
    hardly turn in it. Where no range was told, each frame is looked at where its strongest
    detection is. Of frames of other intervals than the last, `power`, whose velocities are
    others, none is shown.
    """
    alike = [one for one in frames if one.interval_s == frames[-1].interval_s]
    if range_m is None:
        columns = [one.strongest for one in alike]
    else:
        near = _about(range_m, power)
        columns = [one.power[:, near].sum(axis=1) for one in alike]
    # Neighbouring rows share their noise, and an echo: it counts so many times.
    n_times = over_range.noise_bandwidth_bins * over_range.n_bins / over_range.n_points
    times_s = xr.Variable("time", [one.time_s for one in alike], {"units": "s"})
    return xr.DataArray(
        np.array(columns) / np.float32(n_times),
        dims=("time", "velocity"),
        coords={"time": times_s, "velocity": power["velocity"].variable},
        attrs=dict(power.attrs),
    )


def _about(range_m: float, power: xr.DataArray) -> slice:
    """Rows of a map within reach of a range; the nearest, where none is."""
    off_m = abs(power["range"].values - range_m)
    near = np.flatnonzero(off_m <= max(_REACH_M, off_m.min()))
    return slice(int(near[0]), int(near[-1]) + 1)
