"""What single precision costs, step by step: each step as it runs beside double precision.

Every function gives one number of the table in docs/guide/limits.md, on the same input for both.
"""

import mpmath
import numpy as np

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.processing.angle.aperture import FieldOfView
from dechirp.processing.angle.bartlett import Bartlett
from dechirp.processing.cfar.base import MapNoise
from dechirp.processing.cfar.window_means import window_means
from dechirp.processing.direction_finding import direction_aperture
from dechirp.processing.peak_interpolation import interpolate_peaks
from dechirp.processing.refine import refine_tones
from dechirp.processing.spectrum import Transform, amplitude_weights, mean_power, split_spectrum
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.kernels.direct import add_echoes
from small_radars import echoes, small

N_CHIRPS, N_SAMPLES = 128, 256
AXES = [Transform(window="blackman-harris", n_points=n, n_bins=n) for n in (N_SAMPLES, N_CHIRPS)]
TONE = (0.3713, 1.2345)
"""Radians per chirp and per sample, between bins."""


def noise(shape, seed=1) -> np.ndarray:
    """Circular noise of power 2, rounded to single precision: the input of both."""
    rng = np.random.default_rng(seed)
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)


def tone(slow=TONE[0], fast=TONE[1]) -> np.ndarray:
    """A tone without noise, (chirp, channel, sample), rounded to single precision."""
    phase = slow * np.arange(N_CHIRPS)[:, None, None] + fast * np.arange(N_SAMPLES)
    return np.exp(1j * phase).astype(np.complex64)


def in_double(samples) -> np.ndarray:
    """Spectrum (velocity, channel, range) in double precision, from the same samples."""
    fast, slow = (one.weights / one.weights.sum() for one in AXES)
    tapered = samples.astype(np.complex128) * slow[:, None, None] * fast
    return np.fft.fftshift(np.fft.fft(np.fft.fft(tapered, axis=2), axis=0), axes=0)


def spectrum(samples) -> np.ndarray:
    """The same as it is computed."""
    parts = split_spectrum(samples, "complex", *AXES)
    return parts[:, :, 0] + 1j * parts[:, :, 1].astype(np.complex128)


def rms(values) -> float:
    return float(np.sqrt(np.mean(abs(np.asarray(values)) ** 2)))


def crowd() -> dc.Scene:
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


def echo_samples() -> float:
    """Samples of echoes summed in double and rounded once, over their rms."""
    radar, scene = small(), crowd()
    engine = dc.Engine(kernel="direct")
    single = dc.simulate(scene, radar, impairments=(), engine=engine).values
    double = echoes(scene, radar, engine=engine)
    return rms(single - double) / rms(double)


def echo_engine() -> float:
    """Echoes as `auto` sums them in single precision, over their rms."""
    radar, scene = small(), crowd()
    double = echoes(scene, radar, engine=dc.Engine(kernel="direct"))
    return rms(dc.simulate(scene, radar, impairments=()).values - double) / rms(double)


def echo_phase(range_m=100.0, start_s=10.0) -> float:
    """Phase in rad at 77 GHz of an echo at some range, some seconds after mid-frame."""
    speed = 7.7
    sent = Transmission(
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
    add_echoes(out, Scatterers(path_m, np.ones(1), np.ones((1, 1)), np.ones((1, 1))), sent)
    worst = 0.0
    with mpmath.workdps(50):
        for n in (0, 100, 255):
            t = mpmath.mpf(n) / mpmath.mpf(10e6)
            at = mpmath.mpf(path_m[0, 0, 0]) + mpmath.mpf(speed) * (mpmath.mpf(start_s) + t)
            tau = 2 * at / SPEED_OF_LIGHT
            cycles = 77e9 * tau + 20e12 * tau * (t - tau / 2)
            off = np.angle(out[0, 0, n] * complex(mpmath.expjpi(-2 * cycles)))
            worst = max(worst, abs(float(off)))
    return worst


def window() -> float:
    """Amplitude that rounded weights put anywhere outside, over that of the tone."""
    exact = AXES[0].weights / AXES[0].weights.sum()
    rounded = amplitude_weights(AXES[0], "complex").astype(float)
    return float(abs(np.fft.fft(rounded - exact, 16 * N_SAMPLES)).max())


def transforms() -> float:
    """Both transforms of noise, window and all, rms over rms."""
    samples = noise((N_CHIRPS, 1, N_SAMPLES))
    exact = in_double(samples)
    return rms(spectrum(samples) - exact) / rms(exact)


def floor() -> float:
    """Largest amplitude that rounding leaves in any cell, over that of the only tone."""
    worst = 0.0
    for slow, fast in (TONE, (0.0, 0.8), (-1.9, 2.6), (2 * np.pi * 9 / 128, 2 * np.pi * 50 / 256)):
        exact = in_double(tone(slow, fast))
        worst = max(worst, abs(spectrum(tone(slow, fast)) - exact).max() / abs(exact).max())
    return float(worst)


def power() -> float:
    """Powers of eight channels, squared and summed: error over the power of the mean cell."""
    samples = noise((N_CHIRPS, 8, N_SAMPLES))
    exact = (abs(in_double(samples)) ** 2).mean(axis=1)
    return rms(mean_power(samples, "complex", *AXES) - exact) / float(exact.mean())


def means(target_db: float | None = None) -> float:
    """Largest error of a mean over a ring, relative; beside a target over the noise."""
    cells = np.random.default_rng(2).exponential(size=(64, 200)).astype(np.float32)
    if target_db is not None:
        cells[20, [50, 51, 90]] = 10 ** (target_db / 10)
    found = window_means(cells, np.ones(200, np.float32), 6, 4, 2, 2).astype(float)
    box = np.zeros(cells.shape)
    for dv in range(-6, 7):
        for dr in range(-8, 9):
            if max(abs(dv) - 2, abs(dr) - 2) > 0:
                box += np.roll(cells.astype(float), (-dv, -dr), axis=(0, 1))
    exact = box / (13 * 17 - 25)
    inner = slice(8, -8)  # at the ends of the range the box is another
    return float(abs(found[:, inner] / exact[:, inner] - 1).max())


def longest_sum() -> float:
    """Mean of a ring of 2^20 cells, the most that anybody would take, relative."""
    cells = np.random.default_rng(2).exponential(size=(1025, 1027)).astype(np.float32)
    found = window_means(cells, np.ones(1027, np.float32), 511, 511, 1, 1)
    # About range 512 the box holds ranges 0 to 1024, and all velocities.
    guard = cells[:, 511:514].sum(axis=1, dtype=float)
    guard = guard + np.roll(guard, 1) + np.roll(guard, -1)
    exact = (cells[:, :1025].sum(dtype=float) - guard) / (1025**2 - 9)
    return float(abs(found[:, 512] / exact - 1).max())


def bins() -> float:
    """Place of a peak between bins, in bins."""
    exact = abs(in_double(tone())[:, 0]) ** 2
    rounded = mean_power(tone(), "complex", *AXES)
    transforms = MapNoise(range_transform=AXES[0], doppler_transform=AXES[1])
    cell = np.array([np.unravel_index(exact.argmax(), exact.shape)])
    at = [np.ravel(interpolate_peaks(one, cell, transforms)) for one in (rounded, exact)]
    return float((abs(at[0] - at[1]) / (2 * np.pi) * (N_CHIRPS, N_SAMPLES)).max())


def frequency() -> float:
    """Refined frequency of a tone, over its Cramer-Rao bound at 60 dB."""
    start = [np.array([f + 0.1 * 2 * np.pi / n]) for f, n in zip(TONE, (128, 256), strict=True)]
    tones = refine_tones(tone(), *start, np.array([1e-6]))
    off = np.array([tones.slow[0], tones.fast[0]]) - TONE
    bound = np.sqrt(6 / 1e6) / np.array([N_CHIRPS, N_SAMPLES])
    return float((abs(off) / bound).max())


def azimuth() -> float:
    """Azimuth by beams of single precision, over its Cramer-Rao bound at 40 dB."""
    radar = small(n_rx=8)
    aperture = direction_aperture(radar, FieldOfView())
    true = 0.3217
    x = aperture.steering_vectors(true)
    found = Bartlett().find_directions(x.reshape(1, 1, -1), aperture, np.array([1e-4]))
    across = aperture.positions[:, 1] - aperture.positions[:, 1].mean()  # in wavelengths
    bound = 1 / (2 * np.pi * np.cos(true) * np.sqrt(2e4 * (across**2).sum()))
    return abs(float(np.ravel(found.azimuth_rad)[0]) - true) / bound


def phase() -> float:
    """Phase of slow time, rad."""
    radar = small(n_rx=1)
    range_m = 20.0
    scene = dc.Scene(targets=[dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(1, 0, 0))])
    cube = dc.simulate(scene, radar, impairments=(), engine=dc.Engine(kernel="direct"))
    trace = dc.slow_time.slow_time(cube, radar, range_m).values[:, 0].astype(np.complex128)
    chirp = radar.frame.chirp
    n = np.arange(chirp.n_samples) - (chirp.n_samples - 1) / 2
    still = np.exp(-2j * np.pi * chirp.beat_frequency_hz(range_m) / chirp.sample_rate_hz * n)
    weights = Transform(window="hann", n_points=n.size, n_bins=n.size).weights
    exact = echoes(scene, radar, engine=dc.Engine(kernel="direct"))[0, :, 0] @ (still * weights)
    return float(abs(np.angle(trace * exact.conj())).max())


STEPS = {
    "echoes, one by one": echo_samples,
    "echoes, `auto`": echo_engine,
    "phase of an echo, 100 m, 10 s on": echo_phase,
    "phase of an echo, 1000 km": lambda: echo_phase(1e6, 0.0),
    "window": window,
    "transforms": transforms,
    "transforms, beside a tone": floor,
    "power": power,
    "means of rings": means,
    "means of rings, target of 120 dB": lambda: means(120),
    "means of rings, target of 140 dB": lambda: means(140),
    "mean of 2^20 cells": longest_sum,
    "peaks between bins": bins,
    "refined frequency": frequency,
    "azimuth by beams": azimuth,
    "phase of slow time": phase,
}
"""Rows of the table, in order."""
