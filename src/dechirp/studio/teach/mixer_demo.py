"""Frames of a moving target received with two mixers (I/Q) and with one."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from dechirp.certificate.reference_trials import (
    QUIET_SNR_DB,
    REFERENCE_TARGET,
    reference_radar,
    target_scene,
)
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.units import from_decibels
from dechirp.processing.cfar.base import Cells, Cfar, TrainingWindow
from dechirp.processing.cfar.cell_averaging import CellAveraging
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map, threshold_map
from dechirp.processing.spectrum import noise_gain, range_profiles
from dechirp.radar.chirp import Sampling
from dechirp.radar.radar import Radar
from dechirp.simulation.simulate import simulate_ideal_echoes

RAMP, NO_RAMP = "150 MHz", "none: a carrier"
SLOWEST_HZ_PER_S = 1.0
"""Smallest valid slope of a chirp; in 7 µs it rises by 7 µHz."""
GUARDS = {"none": 0, "2 cells": 2, "4 cells": 4}


@dataclass(frozen=True)
class MixerSettings:
    """Target velocity, ramp, guard cells and false-alarm probability."""

    velocity_m_per_s: float
    ramp: str
    guard: str
    false_alarms: str
    """False-alarm probability as text, chosen from a list."""
    n_chirps: float
    play: str

    @property
    def chain(self) -> Chain:
        """Windows and detector of the reference scenario with those guard cells."""
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
        """Return the reference radar with that ramp and one mixer (real) or two (complex)."""
        frame = reference_radar().frame
        chirp = replace(frame.chirp, sampling=sampling)
        if self.ramp == NO_RAMP:
            chirp = replace(chirp, slope_hz_per_s=SLOWEST_HZ_PER_S)
        return replace(
            reference_radar(), frame=replace(frame, chirp=chirp, n_chirps=int(self.n_chirps))
        )


@dataclass(frozen=True, eq=False)
class MixerFrame:
    """Frame of one kind of mixer."""

    power: np.ndarray
    """Power (velocity, column) relative to the mean noise power of a cell."""
    velocity_m_per_s: np.ndarray
    column: int
    """Column of the target."""
    phase_turns: np.ndarray
    """Phase (chirp,) of the column of the target, in turns."""
    threshold: np.ndarray | None
    """Threshold (velocity, column); None before the frame is complete."""
    n_false_alarms: int
    """Cells above the threshold away from the target."""
    n_tested: int


@dataclass(frozen=True, eq=False)
class MixerComparison:
    """Same target received with two mixers and with one."""

    settings: MixerSettings
    two_mixers: MixerFrame
    one_mixer: MixerFrame
    training_window: TrainingWindow


def simulate_noisy_frame(
    settings: MixerSettings, sampling: Sampling, frame_number: int
) -> xr.DataArray:
    """Simulate a frame (chirp, rx, sample) of the target in noise of mean power 1."""
    radar = settings.radar(sampling)
    clean = simulate_ideal_echoes(
        target_scene(REFERENCE_TARGET.range_m, settings.velocity_m_per_s), radar
    ).isel(frame=0)
    single = np.complex64 if sampling == "complex" else np.float32
    # With one mixer on a carrier the power depends on the phase: use the power of two mixers.
    two_mixer_radar = radar if sampling == "complex" else settings.radar("complex")
    power = np.mean(
        abs(
            simulate_ideal_echoes(
                target_scene(REFERENCE_TARGET.range_m, 0.0), two_mixer_radar
            ).values
        )
        ** 2
    )
    amplitude = np.sqrt(float(from_decibels(QUIET_SNR_DB)) / power)
    cube = (clean * amplitude).astype(single)
    cube.values = np.ascontiguousarray(cube.values)
    add_white_noise(cube.values, 1.0, np.random.default_rng((2, frame_number)))
    return cube


def compute_map_and_phases(
    settings: MixerSettings, sampling: Sampling, frame_number: int
) -> MixerFrame:
    """Compute the frame of one kind of mixer."""
    radar, cube = settings.radar(sampling), simulate_noisy_frame(settings, sampling, frame_number)
    # Training cells of two mixers: finding the rows with circular noise of one mixer takes 0.15 s.
    frame, chain = radar.frame, settings.chain.fit_to_radar(settings.radar("complex"))
    map_ = power_map(cube, radar, chain)
    noise = chain.map_noise_statistics(radar)
    mean = noise_gain(noise.range_transform, noise.doppler_transform, frame.chirp)
    # Only the complete frame of two mixers is searched for detections.
    is_complete = frame.n_chirps == reference_radar().frame.n_chirps and sampling == "complex"
    threshold = threshold_map(map_, radar, chain).values if is_complete else None
    beat_hz = frame.chirp.beat_frequency_hz(REFERENCE_TARGET.range_m)
    target_column = round(beat_hz / frame.chirp.sample_rate_hz * frame.chirp.n_samples)
    profiles = range_profiles(cube, frame.chirp, noise.range_transform).values[:, 0, target_column]
    n_over = 0
    if threshold is not None:
        is_over = map_.values > threshold
        # The skirts of a carrier wrap around the end of the axis.
        is_over[:, np.arange(target_column - 5, target_column + 6) % is_over.shape[1]] = False
        n_over = int(np.count_nonzero(is_over))
    return MixerFrame(
        power=map_.values / mean,
        velocity_m_per_s=map_.velocity.values,
        column=target_column,
        phase_turns=np.angle(profiles) / (2 * np.pi),
        threshold=None if threshold is None else threshold / mean,
        n_false_alarms=n_over,
        n_tested=map_.size,
    )


def compute_iq_and_single_mixer_frames(
    settings: MixerSettings, frame_number: int
) -> MixerComparison:
    """Compute the frames of both kinds of mixer with the same noise seed."""
    return MixerComparison(
        settings=settings,
        two_mixers=compute_map_and_phases(settings, "complex", frame_number),
        one_mixer=compute_map_and_phases(settings, "real", frame_number),
        training_window=settings.chain.fit_to_radar(settings.radar("complex")).cfar.training_window,
    )
