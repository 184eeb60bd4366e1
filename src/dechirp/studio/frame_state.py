"""State of one frame: everything that the page shows of it, without widgets.

Results that only a few frames need during playback are computed on demand.
"""

from dataclasses import dataclass
from functools import cached_property

import xarray as xr

from dechirp.core.findings import Finding
from dechirp.core.threads import limit_threads
from dechirp.processing.angle_maps import range_azimuth_map
from dechirp.processing.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.studio.cursor import (
    BeatSignal,
    Cursor,
    MapCut,
    first_receiver_beat_and_spectrum,
    nearest_cell_indices,
    power_and_threshold_cuts,
)
from dechirp.studio.history import HistoryEntry, micro_doppler_map
from dechirp.tracking.online import Track


@dataclass(frozen=True, eq=False)
class FrameState:
    """Processed frame with cursor, detections, tracks and truth."""

    step: int
    """Step since the last rewind; determines the noise."""
    number: int
    """Number of the frame."""
    n_frames: int
    """Number of frames of the source, which repeats."""
    time_s: float
    """Time of the middle of the frame."""
    radar: Radar
    """Radar with the interval of this frame."""
    chain: Chain
    """Processing chain fitted to the radar."""
    cursor: Cursor
    """Cursor of the user, else the detection that it follows, first the strongest one."""
    has_user_cursor: bool
    """True if the user placed the cursor."""
    samples: xr.DataArray
    """(chirp, rx, sample)"""
    power: xr.DataArray
    """Range-Doppler map, (velocity, range), as the detector reads it."""
    resolves_azimuth: bool
    """True if the array has an azimuth resolution."""
    history: tuple[HistoryEntry, ...]
    """This frame and earlier ones since the last rewind or jump."""
    detections: xr.Dataset
    """Detections with `cluster` and `motion` if enabled."""
    clusters: xr.Dataset | None
    tracks: tuple[Track, ...]
    """Tracks since the last rewind or jump; empty without a tracker."""
    truth: xr.Dataset | None
    """Truth over `target` and `frame` of this frame, without SNR; None for a recording."""
    scene: Scene | None
    """Scene of this frame, at the times of the truth; None for a recording."""
    findings: tuple[Finding, ...]
    """Findings on the settings or the recording, and on the frames shown so far, in the terms of
    the page."""

    @cached_property
    def azimuth_power(self) -> xr.DataArray | None:
        """Range-azimuth map, (azimuth, range); None if the array has no azimuth resolution."""
        if not self.resolves_azimuth:
            return None
        with limit_threads(1):  # the other one computes the next frame
            return range_azimuth_map(self.samples, self.radar, self.chain)

    @cached_property
    def beat_and_spectrum(self) -> BeatSignal:
        """Samples and range spectrum of the first receiver."""
        return first_receiver_beat_and_spectrum(self.samples, self.radar, self.chain)

    @cached_property
    def cuts_through_cursor(self) -> tuple[MapCut, MapCut]:
        """Cuts through the cursor along range and along velocity."""
        return power_and_threshold_cuts(
            self.power, self.radar, self.chain, nearest_cell_indices(self.power, self.cursor)
        )

    @cached_property
    def micro_doppler(self) -> xr.DataArray:
        """Power near the range of the cursor over (time, velocity), one column per frame."""
        transform = self.chain.range_transform(self.radar.frame.chirp)
        range_m = self.cursor.range_m if self.has_user_cursor else None
        return micro_doppler_map(self.history, self.power, transform, range_m)
