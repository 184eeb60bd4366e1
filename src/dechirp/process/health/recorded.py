"""The measures of a recording, as its judges ask for them."""

from functools import cached_property

import numpy as np
import xarray as xr

from dechirp.core.values import value
from dechirp.radar.radar import Radar


@value
class Recorded:
    """Measures of all frames, and the radar that made them."""

    measures: xr.Dataset
    radar: Radar

    def of(self, name: str) -> np.ndarray:
        """Values of a measure, frames first."""
        return np.asarray(self.measures[name].values)

    @property
    def is_complex(self) -> bool:
        """Whether samples have two parts."""
        return bool(self.measures.attrs["is_complex"])

    @property
    def has_full_scale(self) -> bool:
        """Whether 1 is the end of the converter's range."""
        return self.measures.attrs["units"] == "full scale"

    @cached_property
    def frame_numbers(self) -> np.ndarray:
        """(frame,), counted from the first of the recording, also where that was not read."""
        frames = self.measures.sizes["frame"]
        if "frame" not in self.measures.coords:
            return np.arange(frames)
        n_intervals = self.radar.frame.n_intervals
        period_s = self.radar.frame.start_s(n_intervals) / n_intervals
        return np.rint(self.measures["frame"].values / period_s).astype(np.int64)

    @cached_property
    def arrived(self) -> np.ndarray:
        """(frame,), True where any chirp was not lost."""
        return self.of("n_numbers") > 0

    @cached_property
    def constant(self) -> np.ndarray:
        """(frame, rx), True where all samples are the same."""
        level = self.of("level")
        return np.all(level[..., 0, 0] == level[..., 1, 0], axis=2) & self.arrived[:, None]

    @cached_property
    def stuck(self) -> np.ndarray:
        """(rx,), True where samples never change within a frame."""
        always = np.all(self.constant | ~self.arrived[:, None], axis=0)
        return np.asarray(always & self.arrived.any())

    @cached_property
    def silent(self) -> np.ndarray:
        """(frame,), True where no receiver has anything but the same number."""
        return np.asarray(self.constant.all(axis=1))

    @cached_property
    def rest_power(self) -> np.ndarray:
        """(rx,), mean square about the mean of each frame, over frames that arrived."""
        power = self.of("power").sum(axis=2)
        return power[self.arrived].mean(axis=0) if self.arrived.any() else power[:0].sum(axis=0)
