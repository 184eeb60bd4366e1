"""One frame as the page shows it: everything that follows from its samples. No page in here."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.findings import Finding
from dechirp.process.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.tracking.live import Track


class Cursor(NamedTuple):
    """Where all views look."""

    range_m: float
    velocity_m_per_s: float


class Cut(NamedTuple):
    """Cells of the map along one axis through the cursor, and what they have to exceed."""

    at: np.ndarray
    """m along range, m/s along velocity."""
    power: np.ndarray
    threshold: np.ndarray
    """Infinite where nothing is searched for."""


class Beat(NamedTuple):
    """What the first receiver hears: samples, and what is in them over range."""

    time_s: np.ndarray
    """(sample,) since the start of the ramp."""
    samples: np.ndarray
    """(sample,) of the first chirp."""
    range_m: np.ndarray
    """(range,)"""
    power: np.ndarray
    """(range,) of the first chirp: the spectrum of its samples."""
    profile: np.ndarray
    """(range,) mean over chirps: the range profile."""


@dataclass(frozen=True, eq=False)
class Moment:
    """What is seen in one frame."""

    step: int
    """Counted from the last rewind: what noise is drawn by."""
    number: int
    """Of the frame."""
    n_frames: int
    """Of the source: a scene or a recording, which goes round."""
    time_s: float
    """Of its middle."""
    radar: Radar
    """As it is in this frame."""
    chain: Chain
    """Fitted to the radar."""
    cursor: Cursor
    """Where it looks: at the strongest detection, or the strongest cell, unless it was told."""
    samples: xr.DataArray
    """(chirp, rx, sample)"""
    beat: Beat
    power: xr.DataArray
    """Range-Doppler map, (velocity, range), as the detector sees it."""
    cut_over_range: Cut
    cut_over_velocity: Cut
    azimuth_power: xr.DataArray | None
    """Range-azimuth map, (azimuth, range); None where the array tells no azimuth."""
    micro_doppler: xr.DataArray
    """Power about the range of the cursor over (time, velocity): a column is a frame, from the
    last rewind or jump on."""
    detections: xr.Dataset
    """With `cluster` and `motion` where those are asked for."""
    clusters: xr.Dataset | None
    tracks: tuple[Track, ...]
    """Told from the last rewind or jump on; none where nobody asked for them."""
    truth: xr.Dataset | None
    """Over `target` and `frame`, of this one alone; None for a recording."""
    findings: tuple[Finding, ...]
    """On the settings or the recording, and on this frame."""
    took_s: float
    """From the first sample to the last table."""
