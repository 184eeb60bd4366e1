"""Totals over the frames of a run, beside their detections."""

import numpy as np

from dechirp.processing.frame import FrameResult
from dechirp.processing.mitigation.apply import RemovedEcho


class FrameTotals:
    """Totals over the frames of a run beside their detections, and the map of the first frame."""

    def __init__(self) -> None:
        self.times_s: list[float] = []
        """Middle of each frame."""
        self.removed: list[tuple[RemovedEcho, ...]] = []
        """Power that mitigation removed from each frame; empty without mitigation."""
        self.n_crowded = 0
        """Frames with more peaks than are kept."""
        self.masked_ranges_m: list[float] = []
        """Ranges of detections without directions since the sidelobes of other echoes dominate
        them."""
        self.n_unknown_angles = 0
        """Sources with an angle that their amplitudes do not determine."""
        self.channel_phase_rms_rad: list[float] = []
        """RMS error of the phases of the channels in each frame, see `FrameResult`."""
        self.first_power: tuple[np.ndarray, ...] = ()
        """Map of the first frame, see `FrameResult.power`."""

    def add_frame_result(self, frame: FrameResult) -> None:
        """Add the result of the next frame."""
        if not self.times_s:
            # Copied: the map may be a view of a larger array.
            self.first_power = tuple(power.copy() for power in frame.power)
        self.times_s.append(frame.time_s)
        if frame.removed:
            self.removed.append(frame.removed)
        self.n_crowded += frame.n_dropped_peaks > 0
        self.masked_ranges_m.extend(frame.masked_ranges_m.tolist())
        self.n_unknown_angles += frame.n_unknown_angles
        self.channel_phase_rms_rad.append(frame.channel_phase_rms_rad)
