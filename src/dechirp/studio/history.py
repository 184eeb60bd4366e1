"""History of successive frames: tracks, and maps for the micro-Doppler view."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.experiments.object_stage import start_live_tracker
from dechirp.experiments.scenario import Scenario
from dechirp.processing.spectrum import Transform
from dechirp.radar.radar import Radar
from dechirp.tracking.online import Track

# parts of a body lie within this distance of its strongest one; a bicycle is 1.7 m long
_HALF_WIDTH_M = 2.0
_MAX_FRAMES = 200
_MAX_CELLS = 2**22  # 16 MiB of maps


class HistoryEntry(NamedTuple):
    """Map and strongest rows of one frame."""

    time_s: float
    power: np.ndarray
    """(velocity, range)"""
    strongest: np.ndarray
    """(velocity,) near the strongest detection."""
    interval_s: float
    """Chirp interval, which determines the velocity axis."""


class FrameHistory:
    """Consecutive frames with their tracks.

    A frame that does not follow the previous one, as after a rewind, a jump or the end of the
    source, restarts tracks and micro-Doppler.
    """

    frames: tuple[HistoryEntry, ...]
    """Most recent frames, oldest first."""

    def __init__(self, scenario: Scenario, radar: Radar) -> None:
        self._scenario, self._radar = scenario, radar
        self.reset()

    def reset(self) -> None:
        """Discard all frames and tracks."""
        self.frames = ()
        self._live_tracker = start_live_tracker(self._scenario, self._radar)

    def is_after_last_frame(self, time_s: float) -> bool:
        """Return True if a frame at this time can follow the last one."""
        return not self.frames or time_s > self.frames[-1].time_s

    def update_tracks(self, detections_or_clusters: xr.Dataset, time_s: float) -> tuple[Track, ...]:
        """Update the tracks with the detections or clusters of a frame and return them."""
        return (
            ()
            if self._live_tracker is None
            else self._live_tracker.step(detections_or_clusters, time_s)
        )

    def store_frame_map(
        self, power: xr.DataArray, radar: Radar, time_s: float, strongest_range_m: float
    ) -> None:
        """Store the map of a frame and discard the oldest ones."""
        column = power.values[:, _range_cells_near(strongest_range_m, power)].sum(axis=1)
        max_frames = max(min(_MAX_FRAMES, _MAX_CELLS // power.size), 1)
        entry = HistoryEntry(time_s, power.values, column, radar.frame.single_interval_s)
        self.frames = (*self.frames, entry)[-max_frames:]


def micro_doppler_map(
    frames: Sequence[HistoryEntry],
    power: xr.DataArray,
    range_transform: Transform,
    range_m: float | None,
) -> xr.DataArray:
    """Return the power over (time, velocity) within 2 m of a range.

    One frame is one window of a spectrogram, see `processing.spectrogram`: it has the full velocity
    resolution, and parts of a body hardly turn in it. Without a range, each frame is evaluated near
    its strongest detection. Frames whose chirp interval differs from the last, `power`, have other
    velocities and are omitted.
    """
    entries = [entry for entry in frames if entry.interval_s == frames[-1].interval_s]
    if range_m is None:
        columns = [entry.strongest for entry in entries]
    else:
        rows = _range_cells_near(range_m, power)
        columns = [entry.power[:, rows].sum(axis=1) for entry in entries]
    # Neighbouring rows share noise and echoes: each counts this many times in the sum.
    n_times = (
        range_transform.noise_bandwidth_bins * range_transform.n_bins / range_transform.n_points
    )
    times_s = xr.Variable("time", [entry.time_s for entry in entries], {"units": "s"})
    return xr.DataArray(
        np.array(columns) / np.float32(n_times),
        dims=("time", "velocity"),
        coords={"time": times_s, "velocity": power["velocity"].variable},
        attrs=dict(power.attrs),
    )


def _range_cells_near(range_m: float, power: xr.DataArray) -> slice:
    """Return the rows of a map within 2 m of a range, at least the nearest one."""
    distance_m = abs(power["range"].values - range_m)
    rows = np.flatnonzero(distance_m <= max(_HALF_WIDTH_M, distance_m.min()))
    return slice(int(rows[0]), int(rows[-1]) + 1)
