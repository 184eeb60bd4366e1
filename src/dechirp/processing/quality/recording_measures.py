"""Quality measures of all frames of a recording, and quantities derived from them."""

from functools import cached_property

import numpy as np
import xarray as xr

from dechirp.core.units import is_absolute
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar


@frozen_dataclass
class RecordingMeasures:
    """Measures of all frames, and the radar of the recording."""

    measures: xr.Dataset
    radar: Radar

    def values_of_measure(self, name: str) -> np.ndarray:
        """Return the values of a measure, frames first."""
        return np.asarray(self.measures[name].values)

    @property
    def has_complex_samples(self) -> bool:
        """True if samples have two parts."""
        return bool(self.measures.attrs["is_complex"])

    @property
    def has_absolute_units(self) -> bool:
        """True if samples are in W**0.5."""
        return is_absolute(self.measures.attrs["units"])

    @cached_property
    def is_normalised_to_full_scale(self) -> bool:
        """True if 1 is the end of the converter's range: no value is beyond it."""
        level = self.values_of_measure("level")
        largest = np.max(np.abs(level), initial=0.0, where=np.isfinite(level))
        return not self.has_absolute_units and bool(largest <= 1)

    @cached_property
    def frame_numbers(self) -> np.ndarray:
        """Frame numbers (frame,), counted from the first frame of the recording."""
        n_frames = self.measures.sizes["frame"]
        if "frame" not in self.measures.coords:
            return np.arange(n_frames)
        n_intervals = self.radar.frame.n_intervals
        period_s = self.radar.frame.frame_start_s(n_intervals) / n_intervals
        return np.rint(self.measures["frame"].values / period_s).astype(np.int64)

    @cached_property
    def mask_of_frames_with_samples(self) -> np.ndarray:
        """Mask (frame,) of frames with a chirp that was not lost."""
        return self.values_of_measure("n_numbers") > 0

    @cached_property
    def constant_receiver_mask_by_frame(self) -> np.ndarray:
        """Mask (frame, rx) of constant samples."""
        level = self.values_of_measure("level")
        return (
            np.all(level[..., 0, 0] == level[..., 1, 0], axis=2)
            & self.mask_of_frames_with_samples[:, None]
        )

    @cached_property
    def stuck_receiver_mask(self) -> np.ndarray:
        """Mask (rx,) of receivers whose samples never change within a frame."""
        always = np.all(
            self.constant_receiver_mask_by_frame | ~self.mask_of_frames_with_samples[:, None],
            axis=0,
        )
        return np.asarray(always & self.mask_of_frames_with_samples.any())

    @cached_property
    def silent_frame_mask(self) -> np.ndarray:
        """Mask (frame,) of frames with constant samples in all receivers."""
        return np.asarray(self.constant_receiver_mask_by_frame.all(axis=1))

    @cached_property
    def receiver_power_about_mean(self) -> np.ndarray:
        """Mean square about the mean of each frame, over frames with samples, (rx,)."""
        power = self.values_of_measure("power").sum(axis=2)
        return (
            power[self.mask_of_frames_with_samples].mean(axis=0)
            if self.mask_of_frames_with_samples.any()
            else power[:0].sum(axis=0)
        )
