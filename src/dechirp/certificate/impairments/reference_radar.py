"""Radar for the measurements of impairments, and functions that evaluate its samples."""

import warnings
from collections.abc import Sequence
from functools import cache

import numpy as np

from dechirp.core.findings import PhysicsWarning
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.simulate import simulate
from dechirp.theory.windows import window_weights

EMPTY_SCENE = Scene()
RX_SPACING_M = 1.9e-3
"""Distance between the receivers, half a wavelength."""
ANTENNA_GAIN = 10.0
TRANSMIT_POWER_W = 0.016
NOISE_FACTOR = 16.0
THERMAL_W_PER_HZ = 1.380649e-23 * 290.0 * NOISE_FACTOR
"""Noise density: Boltzmann's constant times 290 K times the noise factor."""
RATE_HZ = 10e6
N_SAMPLES = 256
SLOPE_HZ_PER_S = 20e12
RAMP_S = 30e-6


@cache
def impairment_radar(n_chirps: int = 16) -> Radar:
    """Return the radar: 77 GHz, range bins of 0.29 m, up to 75 m, two receivers."""
    chirp = Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=SLOPE_HZ_PER_S,
        adc_start_s=2e-6,
        ramp_duration_s=RAMP_S,
        sample_rate_hz=RATE_HZ,
        n_samples=N_SAMPLES,
        sampling="complex",
    )
    return Radar(
        frame=Frame(chirp=chirp, n_chirps=n_chirps, interval_s=35e-6, period_s=0.01),
        array=Array(rx_m=((0.0, 0.0, 0.0), (0.0, RX_SPACING_M, 0.0))),
        hardware=Hardware(
            transmit_power_w=TRANSMIT_POWER_W, antenna_gain=ANTENNA_GAIN, noise_factor=NOISE_FACTOR
        ),
    )


def equal_power_stationary_scene(*ranges_m: float, rcs_m2: float = 1.0) -> Scene:
    """Return stationary targets straight ahead whose echoes have equal power."""
    return Scene(
        targets=tuple(
            Target(
                name=f"at {range_m:g} m",
                position_m=(range_m, 0.0, 0.0),
                rcs_m2=rcs_m2 * (range_m / ranges_m[0]) ** 4,
            )
            for range_m in ranges_m
        )
    )


def simulate_samples(
    scene: Scene,
    *impairments: Impairment,
    radar: Radar | None = None,
    rng: np.random.Generator | None = None,
    n_frames: int = 1,
) -> np.ndarray:
    """Simulate the samples (frame, chirp, rx, sample) of a scene; without impairments, the echoes.

    Warnings are ignored, because the effects that they report are measured here.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)
        cube = simulate(
            scene,
            radar or impairment_radar(),
            impairments=impairments,
            n_frames=n_frames,
            seed=0 if rng is None else int(rng.integers(2**31)),
            dtype=np.complex128,
        )
    return np.asarray(cube.values)


def mean_power_w(values: np.ndarray) -> float:
    """Return the mean power of samples."""
    return float(np.mean(abs(values) ** 2))


def power_ratio_db(values: np.ndarray, others: np.ndarray) -> float:
    """Return the mean power of `values` over that of `others`, in dB."""
    return float(to_decibels(mean_power_w(values) / mean_power_w(others)))


def to_dbm(watts: float) -> float:
    """Convert W to dBm."""
    return float(to_decibels(watts * 1e3))


def round_trip_delay_s(range_m: float) -> float:
    """Return the round-trip delay of a range."""
    return 2 * range_m / SPEED_OF_LIGHT


def sample_times_s() -> np.ndarray:
    """Return the times of the samples since the start of the ramp."""
    return 2e-6 + np.arange(N_SAMPLES) / RATE_HZ


def beat_frequency_hz(range_m: float) -> float:
    """Return the beat frequency of a stationary echo."""
    return SLOPE_HZ_PER_S * round_trip_delay_s(range_m)


def mid_window_frequency_hz() -> float:
    """Return the transmitted frequency in the middle of the sampling window."""
    return 77e9 + SLOPE_HZ_PER_S * (2e-6 + N_SAMPLES / RATE_HZ / 2)


def tone_power_w(values: np.ndarray, frequency_hz: float) -> float:
    """Return the mean power of the tone at a frequency; tones ten bins away do not affect it."""
    weights = window_weights("blackman-harris", N_SAMPLES)
    phasors = np.exp(-2j * np.pi * frequency_hz * np.arange(N_SAMPLES) / RATE_HZ)
    return mean_power_w(values @ (weights * phasors) / weights.sum())


def fit_phase_polynomial(ratio: np.ndarray, order: int = 1) -> Sequence[float]:
    """Fit a polynomial to the phase (rad) over the time since ramp start, highest order first."""
    coefficients: Sequence[float] = np.polyfit(
        sample_times_s(), np.unwrap(np.angle(ratio)), order
    ).tolist()
    return coefficients
