"""Measurements of receiver noise: thermal, white, coloured, aperture jitter and quantisation."""

from collections.abc import Sequence

import numpy as np

from dechirp.certificate.impairments.measurement import MeasuredPair, Measurement, Quantity
from dechirp.certificate.impairments.reference_radar import (
    EMPTY_SCENE,
    N_SAMPLES,
    RATE_HZ,
    THERMAL_W_PER_HZ,
    beat_frequency_hz,
    equal_power_stationary_scene,
    impairment_radar,
    mean_power_w,
    power_ratio_db,
    simulate_samples,
    to_dbm,
)
from dechirp.core.units import to_decibels
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.simulation.impairments.aperture_jitter import ApertureJitter
from dechirp.simulation.impairments.noise import ColouredNoise, ThermalNoise, WhiteNoise
from dechirp.simulation.impairments.quantisation import Quantisation
from dechirp.theory.windows import window_weights

_RANGE_M = 20.0


def _measure_thermal_noise_power(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    samples = simulate_samples(EMPTY_SCENE, ThermalNoise(), radar=impairment_radar(128), rng=rng)
    return ((to_dbm(mean_power_w(samples)), to_dbm(THERMAL_W_PER_HZ * RATE_HZ)),)


def _measure_white_noise_snr(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    scene, radar = equal_power_stationary_scene(_RANGE_M), impairment_radar(128)
    echo = simulate_samples(scene, radar=radar)
    noise = simulate_samples(scene, WhiteNoise(snr=0.1), radar=radar, rng=rng) - echo
    return ((power_ratio_db(echo, noise), -10.0),)


_CORNERS_HZ, _LEVEL_RATIO = (1e6, 4e6), 100.0
_BANDS_HZ = ((0.3e6, 0.8e6), (2.3e6, 2.7e6), (4.5e6, 9.5e6))


def _measure_coloured_noise_density(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the noise density relative to thermal noise."""
    noise = ColouredNoise(beat_hz=_CORNERS_HZ, level=(1.0, _LEVEL_RATIO))
    weights = window_weights("hann", N_SAMPLES)
    spectra = np.fft.fft(
        simulate_samples(EMPTY_SCENE, noise, radar=impairment_radar(128), rng=rng) * weights
    )
    density = np.mean(abs(spectra) ** 2, axis=(0, 1, 2)) / (RATE_HZ * np.sum(weights**2))
    frequency_hz = np.arange(N_SAMPLES) * RATE_HZ / N_SAMPLES
    results = []
    for low_hz, high_hz in _BANDS_HZ:
        band = (frequency_hz >= low_hz) & (frequency_hz <= high_hz)
        formula_db = np.interp(frequency_hz[band], _CORNERS_HZ, (0.0, 20.0))
        ratio = density[band].mean() / THERMAL_W_PER_HZ
        results.append(
            (float(to_decibels(ratio)), float(to_decibels(np.mean(10 ** (formula_db / 10)))))
        )
    return results


_JITTER_RMS_S = 1e-12


def _measure_aperture_jitter_snr(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the ratio of a low and of a high beat frequency to the jitter noise, dB."""
    results = []
    for range_m in (30.0, 65.0):
        scene, radar = equal_power_stationary_scene(range_m), impairment_radar(64)
        echo = simulate_samples(scene, radar=radar)
        noise = (
            simulate_samples(scene, ApertureJitter(rms_s=_JITTER_RMS_S), radar=radar, rng=rng)
            - echo
        )
        formula_db = -2 * to_decibels(2 * np.pi * beat_frequency_hz(range_m) * _JITTER_RMS_S)
        results.append((power_ratio_db(echo, noise), float(formula_db)))
    return results


_BITS = (8, 12, 16)


def _measure_quantisation_snr(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the ratio of a full-scale echo to the quantisation noise of each converter."""
    # The target moves, so that the chirps differ.
    velocity = float(rng.uniform(3.0, 9.0))
    target = Target(position_m=(_RANGE_M, 0.0, 0.0), velocity_m_per_s=(velocity, 0.0, 0.0))
    scene, radar = Scene(targets=(target,)), impairment_radar(128)
    echo = simulate_samples(scene, radar=radar)
    # Full scale is the strongest sample: the range changes by centimetres.
    full_scale_w = float(np.max(abs(echo)) ** 2)
    return [
        (
            power_ratio_db(
                echo,
                simulate_samples(
                    scene, Quantisation(bits=bits, full_scale_w=full_scale_w), radar=radar
                )
                - echo,
            ),
            6.02 * bits + 1.76,
        )
        for bits in _BITS
    ]


MEASUREMENTS = (
    Measurement(
        kind="thermal-noise",
        claim="Thermal noise has the power k T F of the sample rate.",
        quantities=(
            Quantity(name="power, noise factor 12 dB, 10 MHz", unit="dBm", tolerance=0.02),
        ),
        measure=_measure_thermal_noise_power,
        n_trials=64,
    ),
    Measurement(
        kind="white-noise",
        claim="White noise gives the echo of its target the specified SNR.",
        quantities=(Quantity(name="SNR per sample", unit="dB", tolerance=0.02),),
        measure=_measure_white_noise_snr,
        n_trials=64,
    ),
    Measurement(
        kind="coloured-noise",
        claim="The density of coloured noise is linear in decibels between its points.",
        quantities=tuple(
            Quantity(
                name=f"{low / 1e6:.1f} to {high / 1e6:.1f} MHz, over thermal noise",
                unit="dB",
                tolerance=0.1,
            )
            for low, high in _BANDS_HZ
        ),
        measure=_measure_coloured_noise_density,
        n_trials=64,
    ),
    Measurement(
        kind="aperture-jitter",
        claim="Aperture jitter of s rms adds noise at 20 log(2π f s) dB relative to a tone at f.",
        quantities=(
            Quantity(name="1 ps, echo at 4.0 MHz", unit="dB", tolerance=0.1),
            Quantity(name="1 ps, echo at 8.7 MHz", unit="dB", tolerance=0.1),
        ),
        measure=_measure_aperture_jitter_snr,
        n_trials=64,
    ),
    Measurement(
        kind="quantisation",
        claim="A full-scale echo lies 6.02 dB per bit plus 1.76 dB above the quantisation noise.",
        quantities=tuple(Quantity(name=f"{bits} bits", unit="dB", tolerance=0.2) for bits in _BITS),
        measure=_measure_quantisation_snr,
        n_trials=32,
    ),
)
