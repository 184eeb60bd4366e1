"""Error of single precision, step by step, relative to the same step in double precision.

Every function returns one number of the table in docs/guide/limits.md, from the same input for
both precisions.
"""

import mpmath
import numpy as np

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.angle.aperture import FieldOfView
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.cfar.window_means import scaled_window_means
from dechirp.processing.direction_finding import checked_direction_aperture
from dechirp.processing.peak_interpolation import interpolate_peak_frequencies
from dechirp.processing.refine import refine_tones
from dechirp.processing.spectrum import (
    Transform,
    amplitude_range_weights,
    mean_range_doppler_power,
    range_doppler_real_and_imaginary,
)
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.direct import add_echoes
from small_radars import simulate_echoes, small_radar

N_CHIRPS, N_SAMPLES = 128, 256
AXES = [Transform(window="blackman-harris", n_points=n, n_bins=n) for n in (N_SAMPLES, N_CHIRPS)]
TONE = (0.3713, 1.2345)
"""Radians per chirp and per sample, between bins."""


def random_noise(shape, seed=1) -> np.ndarray:
    """Return circular noise of power 2, rounded to single precision: the input of both."""
    rng = np.random.default_rng(seed)
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)


def make_tone(slow=TONE[0], fast=TONE[1]) -> np.ndarray:
    """Return a tone without noise, (chirp, channel, sample), rounded to single precision."""
    phase = slow * np.arange(N_CHIRPS)[:, None, None] + fast * np.arange(N_SAMPLES)
    return np.exp(1j * phase).astype(np.complex64)


def double_precision_spectrum(samples) -> np.ndarray:
    """Return the spectrum (velocity, channel, range) in double precision."""
    fast, slow = (axis.weights / axis.weights.sum() for axis in AXES)
    tapered = samples.astype(np.complex128) * slow[:, None, None] * fast
    return np.fft.fftshift(np.fft.fft(np.fft.fft(tapered, axis=2), axis=0), axes=0)


def single_precision_spectrum(samples) -> np.ndarray:
    """Return the spectrum as the package computes it."""
    parts = range_doppler_real_and_imaginary(samples, "complex", *AXES)
    return parts[:, :, 0] + 1j * parts[:, :, 1].astype(np.complex128)


def root_mean_square(values) -> float:
    return float(np.sqrt(np.mean(abs(np.asarray(values)) ** 2)))


def twelve_target_scene() -> dc.Scene:
    rng = np.random.default_rng(3)
    return dc.Scene(
        targets=[
            dc.Target(
                position_m=(float(r), float(y), 0), velocity_m_per_s=(float(v), 0, 0), rcs_m2=10
            )
            for r, y, v in zip(
                rng.uniform(10, 60, 12), rng.uniform(-5, 5, 12), rng.uniform(-9, 9, 12), strict=True
            )
        ]
    )


def echo_sample_error() -> float:
    """Return the error of echoes summed in double and rounded once, relative to their RMS."""
    radar, scene = small_radar(), twelve_target_scene()
    engine = dc.Engine(kernel="direct")
    single = dc.simulate(scene, radar, impairments=(), engine=engine).values
    double = simulate_echoes(scene, radar, engine=engine)
    return root_mean_square(single - double) / root_mean_square(double)


def echo_kernel_error() -> float:
    """Return the error of the kernel `auto` in single precision, relative to the RMS."""
    radar, scene = small_radar(), twelve_target_scene()
    double = simulate_echoes(scene, radar, engine=dc.Engine(kernel="direct"))
    return root_mean_square(
        dc.simulate(scene, radar, impairments=()).values - double
    ) / root_mean_square(double)


def echo_phase_error(range_m=100.0, start_s=10.0) -> float:
    """Return the phase error in rad at 77 GHz of an echo some seconds after mid-frame."""
    speed = 7.7
    transmission = Transmission(
        starts_s=np.array([start_s]),
        weights=np.ones((1, 1)),
        tx_m=np.zeros((1, 3)),
        rx_m=np.zeros((1, 3)),
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=0.0,
        sample_rate_hz=10e6,
    )
    path_m = np.zeros((2, 1, 3))
    path_m[:, 0, 0] = range_m - speed * start_s, speed
    out = np.zeros((1, 1, 256), np.complex128)
    add_echoes(out, Scatterers(path_m, np.ones(1), np.ones((1, 1)), np.ones((1, 1))), transmission)
    worst = 0.0
    with mpmath.workdps(50):
        for n in (0, 100, 255):
            t = mpmath.mpf(n) / mpmath.mpf(10e6)
            range_at_time = mpmath.mpf(path_m[0, 0, 0]) + mpmath.mpf(speed) * (
                mpmath.mpf(start_s) + t
            )
            tau = 2 * range_at_time / SPEED_OF_LIGHT
            cycles = 77e9 * tau + 20e12 * tau * (t - tau / 2)
            error = np.angle(out[0, 0, n] * complex(mpmath.expjpi(-2 * cycles)))
            worst = max(worst, abs(float(error)))
    return worst


def window_error() -> float:
    """Return the largest spectral amplitude that rounded weights add, relative to a tone."""
    exact = AXES[0].weights / AXES[0].weights.sum()
    rounded = amplitude_range_weights(AXES[0], "complex").astype(float)
    return float(abs(np.fft.fft(rounded - exact, 16 * N_SAMPLES)).max())


def transform_error() -> float:
    """Return the RMS error of both windowed transforms of noise, relative to the RMS."""
    samples = random_noise((N_CHIRPS, 1, N_SAMPLES))
    exact = double_precision_spectrum(samples)
    return root_mean_square(single_precision_spectrum(samples) - exact) / root_mean_square(exact)


def rounding_floor() -> float:
    """Return the largest amplitude error of any cell, relative to the amplitude of the tone."""
    worst = 0.0
    for slow, fast in (TONE, (0.0, 0.8), (-1.9, 2.6), (2 * np.pi * 9 / 128, 2 * np.pi * 50 / 256)):
        exact = double_precision_spectrum(make_tone(slow, fast))
        worst = max(
            worst,
            abs(single_precision_spectrum(make_tone(slow, fast)) - exact).max() / abs(exact).max(),
        )
    return float(worst)


def channel_power_error() -> float:
    """Return the error of the mean power of eight channels, relative to the mean cell."""
    samples = random_noise((N_CHIRPS, 8, N_SAMPLES))
    exact = (abs(double_precision_spectrum(samples)) ** 2).mean(axis=1)
    return root_mean_square(mean_range_doppler_power(samples, "complex", *AXES) - exact) / float(
        exact.mean()
    )


def training_mean_error(target_db: float | None = None) -> float:
    """Return the largest relative error of a training mean, also beside a strong target."""
    cells = np.random.default_rng(2).exponential(size=(64, 200)).astype(np.float32)
    if target_db is not None:
        cells[20, [50, 51, 90]] = 10 ** (target_db / 10)
    means = scaled_window_means(cells, np.ones(200, np.float32), 6, 4, 2, 2).astype(float)
    box = np.zeros(cells.shape)
    for dv in range(-6, 7):
        for dr in range(-8, 9):
            if max(abs(dv) - 2, abs(dr) - 2) > 0:
                box += np.roll(cells.astype(float), (-dv, -dr), axis=(0, 1))
    exact = box / (13 * 17 - 25)
    inner = slice(8, -8)  # at the ends of the range axis the training window is shifted
    return float(abs(means[:, inner] / exact[:, inner] - 1).max())


def longest_training_sum_error() -> float:
    """Return the relative error of a training mean over 2^20 cells, a generous upper limit."""
    cells = np.random.default_rng(2).exponential(size=(1025, 1027)).astype(np.float32)
    means = scaled_window_means(cells, np.ones(1027, np.float32), 511, 511, 1, 1)
    # Around range 512 the window contains ranges 0 to 1024, and all velocities.
    guard = cells[:, 511:514].sum(axis=1, dtype=float)
    guard = guard + np.roll(guard, 1) + np.roll(guard, -1)
    exact = (cells[:, :1025].sum(dtype=float) - guard) / (1025**2 - 9)
    return float(abs(means[:, 512] / exact - 1).max())


def peak_position_error() -> float:
    """Return the error of a peak position between bins, in bins."""
    exact = abs(double_precision_spectrum(make_tone())[:, 0]) ** 2
    rounded = mean_range_doppler_power(make_tone(), "complex", *AXES)
    transforms = MapNoise(range_transform=AXES[0], doppler_transform=AXES[1])
    cell = np.array([np.unravel_index(exact.argmax(), exact.shape)])
    positions = [
        np.ravel(interpolate_peak_frequencies(power, cell, transforms))
        for power in (rounded, exact)
    ]
    return float((abs(positions[0] - positions[1]) / (2 * np.pi) * (N_CHIRPS, N_SAMPLES)).max())


def frequency_error() -> float:
    """Return the error of a refined frequency, relative to its Cramer-Rao bound at 60 dB."""
    start = [np.array([f + 0.1 * 2 * np.pi / n]) for f, n in zip(TONE, (128, 256), strict=True)]
    tones = refine_tones(make_tone(), *start, np.array([1e-6]))
    error = np.array([tones.slow[0], tones.fast[0]]) - TONE
    bound = np.sqrt(6 / 1e6) / np.array([N_CHIRPS, N_SAMPLES])
    return float((abs(error) / bound).max())


def azimuth_error() -> float:
    """Return the azimuth error of beams, relative to the Cramer-Rao bound at 40 dB."""
    radar = small_radar(n_rx=8)
    aperture = checked_direction_aperture(radar, FieldOfView())
    true = 0.3217
    x = aperture.steering_vectors(true)
    sources = Bartlett().find_directions(x.reshape(1, 1, -1), aperture, np.array([1e-4]))
    offsets = aperture.positions[:, 1] - aperture.positions[:, 1].mean()  # in wavelengths
    bound = 1 / (2 * np.pi * np.cos(true) * np.sqrt(2e4 * (offsets**2).sum()))
    return abs(float(np.ravel(sources.azimuth_rad)[0]) - true) / bound


def slow_time_phase_error() -> float:
    """Return the phase error of slow time in rad."""
    radar = small_radar(n_rx=1)
    range_m = 20.0
    scene = dc.Scene(targets=[dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(1, 0, 0))])
    cube = dc.simulate(scene, radar, impairments=(), engine=dc.Engine(kernel="direct"))
    trace = dc.slow_time.slow_time(cube, radar, range_m).values[:, 0].astype(np.complex128)
    chirp = radar.frame.chirp
    n = np.arange(chirp.n_samples) - (chirp.n_samples - 1) / 2
    still = np.exp(-2j * np.pi * chirp.beat_frequency_hz(range_m) / chirp.sample_rate_hz * n)
    weights = Transform(window="hann", n_points=n.size, n_bins=n.size).weights
    exact = simulate_echoes(scene, radar, engine=dc.Engine(kernel="direct"))[0, :, 0] @ (
        still * weights
    )
    return float(abs(np.angle(trace * exact.conj())).max())


STEPS = {
    "echoes, kernel `direct`": echo_sample_error,
    "echoes, kernel `auto`": echo_kernel_error,
    "phase of an echo from 100 m, after 10 s": echo_phase_error,
    "phase of an echo from 1000 km": lambda: echo_phase_error(1e6, 0.0),
    "window": window_error,
    "transforms of noise": transform_error,
    "transforms of a tone": rounding_floor,
    "power": channel_power_error,
    "training-window means": training_mean_error,
    "training-window means beside a target of 120 dB": lambda: training_mean_error(120),
    "training-window means beside a target of 140 dB": lambda: training_mean_error(140),
    "mean of 2^20 cells": longest_training_sum_error,
    "peak positions between bins": peak_position_error,
    "refined frequency": frequency_error,
    "azimuth by beams": azimuth_error,
    "phase of slow time": slow_time_phase_error,
}
"""Rows of the table, in order."""
