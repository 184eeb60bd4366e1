"""Trials of the reference radar and its processing chain with one target in noise."""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr

from dechirp.core.conventions import CUBE_AXES
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.units import SPEED_OF_LIGHT, from_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.scenario import reference
from dechirp.processing.chain import Chain
from dechirp.processing.detect import detect
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.truth import truth
from dechirp.simulation.simulate import simulate_ideal_echoes
from dechirp.theory.windows import Window


@frozen_dataclass
class TrialCondition:
    """Window and SNR with which the noisy frames of a trial are processed."""

    window: Window
    """Window of the range and of the Doppler transform."""
    snr_db: tuple[float, ...]
    """SNR per sample; the trials take the values in turn."""


def window_label(window: Window) -> str:
    """Return the name of a window in checks and curves."""
    return f"{'Hann' if window == 'hann' else window} windows"


class TargetMotion(NamedTuple):
    """Range and radial velocity of a target."""

    range_m: float
    velocity_m_per_s: float


REFERENCE_TARGET = TargetMotion(50.0, 10.0)
"""Motion of the reference target at the start of the frame."""
RCS_M2 = 10.0
QUIET_SNR_DB = -10.0
"""SNR per sample at which noise does not limit detection."""

TRIAL_COLUMNS = ("snr_db", "hit", "range_error_m", "velocity_error_m_per_s")


@cache
def reference_radar() -> Radar:
    """Return the radar of the reference scenario."""
    radar = reference().radar
    assert radar is not None
    return radar


@cache
def unit_power_echo(range_m: float, velocity_m_per_s: float) -> xr.DataArray:
    """Return the noise-free echo of a target straight ahead with a mean sample power of 1."""
    echo = simulate_ideal_echoes(target_scene(range_m, velocity_m_per_s), reference_radar())
    return (echo / np.sqrt(np.mean(abs(echo.values) ** 2))).astype(np.complex64)


def target_scene(range_m: float, velocity_m_per_s: float) -> Scene:
    """Return a scene with the car of the reference scenario straight ahead."""
    target = Target(
        position_m=(range_m, 0.0, 0.0), velocity_m_per_s=(velocity_m_per_s, 0.0, 0.0), rcs_m2=RCS_M2
    )
    return Scene(targets=(target,))


@cache
def reference_echo_zero_before_arrival() -> np.ndarray:
    """Return the echo of the reference target with zeros before its arrival, (chirp, 1, sample).

    The mean power of all samples is 1.
    """
    samples = np.array(unit_power_echo(*REFERENCE_TARGET).values[0])
    delay_s = 2 * REFERENCE_TARGET.range_m / SPEED_OF_LIGHT
    samples[..., : round(delay_s * reference_radar().frame.chirp.sample_rate_hz)] = 0
    return np.asarray(samples / np.float32(np.sqrt(np.mean(abs(samples) ** 2))))


@lru_cache(maxsize=64)  # 1 ms, for each frame of a lesson
def motion_at_mid_frame(start: TargetMotion) -> TargetMotion:
    """Return range and velocity at mid-frame, to which estimates refer."""
    values = truth(target_scene(*start), reference_radar()).isel(frame=0, target=0)
    return TargetMotion(float(values.range), float(values.velocity))


def complex_white_noise(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Return complex noise of unit power, complex64."""
    samples = np.zeros(shape, np.complex64)
    add_white_noise(samples, 1.0, rng)
    return samples


def run_target_trials(
    rng: np.random.Generator,
    n_trials: int,
    *,
    range_m: float,
    velocity_m_per_s: float,
    conditions: Sequence[TrialCondition],
) -> np.ndarray:
    """Process a target in noise and return hits and errors, (n_trials, conditions, columns).

    The columns are `TRIAL_COLUMNS`. All conditions of a trial use the same noise. A hit lies within
    one resolution cell of the truth on both axes; the errors are those of the strongest hit, NaN
    without one.
    """
    echo = unit_power_echo(range_m, velocity_m_per_s)
    motion = motion_at_mid_frame(TargetMotion(range_m, velocity_m_per_s))
    cell_m = reference_radar().frame.chirp.range_resolution_m
    cell_m_per_s = reference_radar().frame.velocity_resolution_m_per_s
    trials = np.full((n_trials, len(conditions), len(TRIAL_COLUMNS)), np.nan)
    cube = xr.DataArray(np.empty_like(echo.values), dims=CUBE_AXES)
    for trial in range(n_trials):
        noise = complex_white_noise(rng, echo.shape)
        for index, condition in enumerate(conditions):
            snr_db = condition.snr_db[trial % len(condition.snr_db)]
            amplitude = np.float32(np.sqrt(from_decibels(snr_db)))
            np.multiply(echo.values, amplitude, out=cube.values)
            cube.values += noise
            chain = Chain(range_window=condition.window, doppler_window=condition.window)
            detections = detect(cube, reference_radar(), chain)
            range_error_m = detections.range.values - motion.range_m
            velocity_error_m_per_s = detections.velocity.values - motion.velocity_m_per_s
            hits = np.flatnonzero(
                (abs(range_error_m) <= cell_m) & (abs(velocity_error_m_per_s) <= cell_m_per_s)
            )
            trials[trial, index, :2] = snr_db, hits.size > 0
            if hits.size:
                trials[trial, index, 2:] = range_error_m[hits[0]], velocity_error_m_per_s[hits[0]]
    return trials


def trial_column(trials: np.ndarray, name: str) -> np.ndarray:
    """Return one column of trials (..., columns), by its name in `TRIAL_COLUMNS`."""
    return trials[..., TRIAL_COLUMNS.index(name)]
