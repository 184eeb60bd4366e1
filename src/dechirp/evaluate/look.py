"""What a trial shows to its scores, and what holds in every trial of a point."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.evaluate.match import Match
from dechirp.process.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Case:
    """What holds in every trial of one point."""

    scene: Scene
    radar: Radar
    chain: Chain
    """Fitted to the radar."""
    truth: xr.Dataset
    """As `scene.truth.truth`, (target, frame), its ratio against the noise that is added."""
    noise_power_w: float
    """In a sample; not finite or 0 where no white noise is added."""
    times_s: np.ndarray
    """Middle of each frame, (n_frames,)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the targets."""
        return self.scene.names


class NoiseMap(NamedTuple):
    """One map of the scenario without its targets."""

    power: np.ndarray
    """(velocity, range), float32, as a detector sees it."""
    n_tested: int
    """Cells in which a detection could be."""
    n_over: int
    """Cells of them over threshold."""
    n_peaks: int
    """Detections: peaks over threshold that no window's sidelobe explains."""


@dataclass(frozen=True, eq=False)
class Look:
    """What one trial shows. What no score of the study needs is None."""

    detections: Mapping[str, np.ndarray]
    """Columns of `process.detect.detect`, each (n_detections,)."""
    match: Match
    """Of each detection: its target, and how far off it is."""
    maps: tuple[np.ndarray, ...] | None = None
    """Power of each frame, (velocity, range), float32."""
    noise: NoiseMap | None = None
    clusters: xr.Dataset | None = None
    tracks: xr.Dataset | None = None
    processing_s: float = np.nan
    """From samples to the last table, all frames together."""
