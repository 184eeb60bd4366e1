"""The radar that impairments are measured with, and what reads its samples."""

import warnings
from collections.abc import Sequence
from functools import cache

import numpy as np

from dechirp.core.findings import PhysicsWarning
from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.echoes.echo import simulate
from dechirp.echoes.impairments.base import Impairment
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.frame import Frame
from dechirp.radar.hardware import Hardware
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.theory.windows import taper

NOTHING = Scene()
APART_M = 1.9e-3
"""Between the receivers, half a wavelength."""
GAIN = 10.0
TRANSMIT_W = 0.016
NOISE_FACTOR = 16.0
THERMAL_W_PER_HZ = 1.380649e-23 * 290.0 * NOISE_FACTOR
"""Boltzmann's constant, room temperature and the noise factor, written out."""
RATE_HZ = 10e6
N_SAMPLES = 256
SLOPE_HZ_PER_S = 20e12
RAMP_S = 30e-6


@cache
def radar(n_chirps: int = 16) -> Radar:
    """77 GHz, 0.29 m a bin, 75 m, two receivers."""
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
        array=Array(rx_m=((0.0, 0.0, 0.0), (0.0, APART_M, 0.0))),
        hardware=Hardware(
            transmit_power_w=TRANSMIT_W, antenna_gain=GAIN, noise_factor=NOISE_FACTOR
        ),
    )


def still(*ranges_m: float, rcs_m2: float = 1.0) -> Scene:
    """Targets at rest, straight ahead, whose echoes are as strong as each other's."""
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


def samples(
    scene: Scene,
    *impairments: Impairment,
    by: Radar | None = None,
    rng: np.random.Generator | None = None,
    n_frames: int = 1,
) -> np.ndarray:
    """Samples (frame, chirp, rx, sample) of a scene; without impairments, of echoes alone.

    What an impairment warns of is what is measured here.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PhysicsWarning)
        cube = simulate(
            scene,
            by or radar(),
            impairments=impairments,
            n_frames=n_frames,
            seed=0 if rng is None else int(rng.integers(2**31)),
            dtype=np.complex128,
        )
    return np.asarray(cube.values)


def power_w(values: np.ndarray) -> float:
    """Mean power."""
    return float(np.mean(abs(values) ** 2))


def level_db(values: np.ndarray, others: np.ndarray) -> float:
    """Mean power over that of others."""
    return float(decibels(power_w(values) / power_w(others)))


def dbm(watts: float) -> float:
    """Power over a milliwatt."""
    return float(decibels(watts * 1e3))


def delay_s(range_m: float) -> float:
    """There and back."""
    return 2 * range_m / SPEED_OF_LIGHT


def times_s() -> np.ndarray:
    """Of the samples, since the start of the ramp."""
    return 2e-6 + np.arange(N_SAMPLES) / RATE_HZ


def beat_hz(range_m: float) -> float:
    """Of an echo from that range at rest."""
    return SLOPE_HZ_PER_S * delay_s(range_m)


def mid_window_hz() -> float:
    """Frequency that is sent in the middle of the samples."""
    return 77e9 + SLOPE_HZ_PER_S * (2e-6 + N_SAMPLES / RATE_HZ / 2)


def tone_w(values: np.ndarray, frequency_hz: float) -> float:
    """Mean power of the tone at a frequency, which others ten bins off do not touch."""
    weights = taper("blackman-harris", N_SAMPLES)
    turns = np.exp(-2j * np.pi * frequency_hz * np.arange(N_SAMPLES) / RATE_HZ)
    return power_w(values @ (weights * turns) / weights.sum())


def slope_of_phase(ratio: np.ndarray, order: int = 1) -> Sequence[float]:
    """Polynomial of the phase over the time since the start of the ramp, rad, highest first."""
    found: Sequence[float] = np.polyfit(times_s(), np.unwrap(np.angle(ratio)), order).tolist()
    return found
