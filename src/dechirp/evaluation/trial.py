"""Context and results of a trial, from which scores are computed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.evaluation.association import Association
from dechirp.processing.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class TrialContext:
    """Scene, radar, chain and truth of all trials of one point."""

    scene: Scene
    radar: Radar
    chain: Chain
    """Fitted to the radar."""
    truth: xr.Dataset
    """From `scene.truth.truth`, (target, frame), with the ratio to the added noise."""
    noise_power_w: float
    """Noise power of a sample; not finite or 0 without white noise."""
    times_s: np.ndarray
    """Middle of each frame, (n_frames,)."""

    @property
    def target_names(self) -> tuple[str, ...]:
        """Names of the targets."""
        return self.scene.names


class NoiseMap(NamedTuple):
    """Map of the scenario without its targets."""

    power: np.ndarray
    """(velocity, range), float32, as the detector reads it."""
    n_tested: int
    """Number of tested cells."""
    n_over: int
    """Number of tested cells over threshold."""
    n_peaks: int
    """Number of detections: peaks over threshold that are not sidelobes."""


@dataclass(frozen=True, eq=False)
class TrialResult:
    """Result of one trial. Results that no score of the study needs are None."""

    detections: Mapping[str, np.ndarray]
    """Columns of `processing.detect.detect`, each (n_detections,)."""
    association: Association
    """Target of each detection, and its errors."""
    maps: tuple[np.ndarray, ...] | None = None
    """Power of each frame, (velocity, range), float32."""
    noise: NoiseMap | None = None
    clusters: xr.Dataset | None = None
    tracks: xr.Dataset | None = None
    processing_s: float = np.nan
    """Time from samples to the last table, for all frames."""
