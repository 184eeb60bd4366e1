"""What lesson 3 shows: frames of a moving target, as two mixers and as one take them."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from dechirp.core.normal import add_white_noise
from dechirp.core.units import from_decibels
from dechirp.echoes.echo import clean_echoes
from dechirp.experiment.verify.looks import QUIET_SNR_DB, REFERENCE, radar, scene
from dechirp.process.cfar.base import Cells, Cfar, Ring
from dechirp.process.cfar.cell_averaging import CellAveraging
from dechirp.process.chain import Chain
from dechirp.process.maps import power_map, threshold_map
from dechirp.process.spectrum import noise_gain, range_profiles
from dechirp.radar.chirp import Sampling
from dechirp.radar.radar import Radar

RAMP, NO_RAMP = "150 MHz", "none: a carrier"
SLOWEST_HZ_PER_S = 1.0
"""The smallest slope that a chirp may have; in 7 µs it rises by 7 µHz."""
GUARDS = {"none": 0, "2 cells": 2, "4 cells": 4}


@dataclass(frozen=True)
class Settings:
    """A target, a ramp or none, and how the map is made and searched."""

    velocity_m_per_s: float
    ramp: str
    guard: str
    false_alarms: str
    """Their probability in a cell, as a text: it is chosen from a list."""
    n_chirps: float
    play: str

    @property
    def chain(self) -> Chain:
        """Windows and detector of the reference scenario, with those guard cells."""
        n_guard = GUARDS[self.guard]
        return Chain(
            cfar=Cfar(
                estimator=CellAveraging(),
                n_guard=Cells(range=n_guard, velocity=n_guard),
                false_alarm_probability=float(self.false_alarms),
            ),
            angle=None,
        )

    def radar(self, sampling: Sampling) -> Radar:
        """The reference radar with that ramp, of one mixer (real) or two (complex)."""
        frame = radar().frame
        chirp = replace(frame.chirp, sampling=sampling)
        if self.ramp == NO_RAMP:
            chirp = replace(chirp, slope_hz_per_s=SLOWEST_HZ_PER_S)
        return replace(radar(), frame=replace(frame, chirp=chirp, n_chirps=int(self.n_chirps)))


@dataclass(frozen=True, eq=False)
class Mixed:
    """A frame of one kind of mixer."""

    power: np.ndarray
    """Over the mean power of the noise in a cell, (velocity, column)."""
    velocity_m_per_s: np.ndarray
    column: int
    """Where the target beats."""
    turns: np.ndarray
    """Phase of the target's column from chirp to chirp, in turns, (chirp,)."""
    threshold: np.ndarray | None
    """As the power; none before the frame is whole."""
    n_over: int
    """Cells over it in the whole map, away from the target."""
    n_tested: int


@dataclass(frozen=True, eq=False)
class Seen:
    """The same target through two mixers and through one."""

    at: Settings
    two: Mixed
    one: Mixed
    ring: Ring


def noisy(at: Settings, sampling: Sampling, number: int) -> xr.DataArray:
    """One frame of the target in noise, (chirp, rx, sample); of noise the mean power is 1."""
    by = at.radar(sampling)
    clean = clean_echoes(scene(REFERENCE.range_m, at.velocity_m_per_s), by).isel(frame=0)
    single = np.complex64 if sampling == "complex" else np.float32
    # Of one mixer on a carrier the power depends on the phase: that of two mixers is taken.
    two = by if sampling == "complex" else at.radar("complex")
    power = np.mean(abs(clean_echoes(scene(REFERENCE.range_m, 0.0), two).values) ** 2)
    amplitude = np.sqrt(float(from_decibels(QUIET_SNR_DB)) / power)
    cube = (clean * amplitude).astype(single)
    cube.values = np.ascontiguousarray(cube.values)
    add_white_noise(cube.values, 1.0, np.random.default_rng((2, number)))
    return cube


def mixed(at: Settings, sampling: Sampling, number: int) -> Mixed:
    """What one kind of mixer makes of a frame."""
    by, cube = at.radar(sampling), noisy(at, sampling, number)
    # Training cells for two mixers: the rows where noise of one is circular take 0.15 s to find.
    frame, chain = by.frame, at.chain.fitted(at.radar("complex"))
    map_ = power_map(cube, by, chain)
    noise = chain.noise(by)
    mean = noise_gain(noise.over_range, noise.over_velocity, frame.chirp)
    # Sums of many cells to be searched are the same for both; only that of two mixers is.
    whole = frame.n_chirps == radar().frame.n_chirps and sampling == "complex"
    threshold = threshold_map(map_, by, chain).values if whole else None
    beat_hz = frame.chirp.beat_frequency_hz(REFERENCE.range_m)
    at_column = round(beat_hz / frame.chirp.sample_rate_hz * frame.chirp.n_samples)
    profiles = range_profiles(cube, frame.chirp, noise.over_range).values[:, 0, at_column]
    n_over = 0
    if threshold is not None:
        over = map_.values > threshold
        # A carrier's skirts go round the end of the axis.
        over[:, np.arange(at_column - 5, at_column + 6) % over.shape[1]] = False
        n_over = int(np.count_nonzero(over))
    return Mixed(
        power=map_.values / mean,
        velocity_m_per_s=map_.velocity.values,
        column=at_column,
        turns=np.angle(profiles) / (2 * np.pi),
        threshold=None if threshold is None else threshold / mean,
        n_over=n_over,
        n_tested=map_.size,
    )


def seen(at: Settings, number: int) -> Seen:
    """Both mixers, with noise of the same seed."""
    return Seen(
        at=at,
        two=mixed(at, "complex", number),
        one=mixed(at, "real", number),
        ring=at.chain.fitted(at.radar("complex")).cfar.ring,
    )
