"""Noise that receivers add: thermal, as asked for, coloured, of late samples, of few bits."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.units import decibels
from dechirp.echoes.impairments.coloured_noise import ColouredNoise
from dechirp.echoes.impairments.jitter import Jitter
from dechirp.echoes.impairments.quantisation import Quantisation
from dechirp.echoes.impairments.thermal_noise import ThermalNoise
from dechirp.echoes.impairments.white_noise import WhiteNoise
from dechirp.experiment.verify.impairments.bench import (
    N_SAMPLES,
    NOTHING,
    RATE_HZ,
    THERMAL_W_PER_HZ,
    beat_hz,
    dbm,
    level_db,
    power_w,
    radar,
    samples,
    still,
)
from dechirp.experiment.verify.impairments.measurement import Measured, Measurement, Quantity
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.theory.windows import taper

_AT_M = 20.0


def _thermal(rng: np.random.Generator) -> Sequence[Measured]:
    found = samples(NOTHING, ThermalNoise(), by=radar(128), rng=rng)
    return ((dbm(power_w(found)), dbm(THERMAL_W_PER_HZ * RATE_HZ)),)


def _white(rng: np.random.Generator) -> Sequence[Measured]:
    scene, by = still(_AT_M), radar(128)
    echo = samples(scene, by=by)
    noise = samples(scene, WhiteNoise(snr=0.1), by=by, rng=rng) - echo
    return ((level_db(echo, noise), -10.0),)


_CORNERS_HZ, _RISE = (1e6, 4e6), 100.0
_BANDS_HZ = ((0.3e6, 0.8e6), (2.3e6, 2.7e6), (4.5e6, 9.5e6))


def _coloured(rng: np.random.Generator) -> Sequence[Measured]:
    """Density over that of thermal noise."""
    noise = ColouredNoise(beat_hz=_CORNERS_HZ, level=(1.0, _RISE))
    weights = taper("hann", N_SAMPLES)
    lines = np.fft.fft(samples(NOTHING, noise, by=radar(128), rng=rng) * weights)
    density = np.mean(abs(lines) ** 2, axis=(0, 1, 2)) / (RATE_HZ * np.sum(weights**2))
    at_hz = np.arange(N_SAMPLES) * RATE_HZ / N_SAMPLES
    found = []
    for low_hz, high_hz in _BANDS_HZ:
        band = (at_hz >= low_hz) & (at_hz <= high_hz)
        formula_db = np.interp(at_hz[band], _CORNERS_HZ, (0.0, 20.0))
        over = density[band].mean() / THERMAL_W_PER_HZ
        found.append((float(decibels(over)), float(decibels(np.mean(10 ** (formula_db / 10))))))
    return found


_LATE_S = 1e-12


def _jitter(rng: np.random.Generator) -> Sequence[Measured]:
    """Ratio of a slow echo and of a fast one to what is added, dB."""
    found = []
    for range_m in (30.0, 65.0):
        scene, by = still(range_m), radar(64)
        echo = samples(scene, by=by)
        added = samples(scene, Jitter(rms_s=_LATE_S), by=by, rng=rng) - echo
        formula_db = -2 * decibels(2 * np.pi * beat_hz(range_m) * _LATE_S)
        found.append((level_db(echo, added), float(formula_db)))
    return found


_BITS = (8, 12, 16)


def _quantisation(rng: np.random.Generator) -> Sequence[Measured]:
    """Ratio of an echo of full scale to the noise of each converter."""
    # It moves, so that chirps differ.
    velocity = float(rng.uniform(3.0, 9.0))
    target = Target(position_m=(_AT_M, 0.0, 0.0), velocity_m_per_s=(velocity, 0.0, 0.0))
    scene, by = Scene(targets=(target,)), radar(128)
    echo = samples(scene, by=by)
    # Full scale of the strongest sample: it comes nearer or goes farther off by centimetres.
    full_scale_w = float(np.max(abs(echo)) ** 2)
    return [
        (
            level_db(
                echo,
                samples(scene, Quantisation(bits=bits, full_scale_w=full_scale_w), by=by) - echo,
            ),
            6.02 * bits + 1.76,
        )
        for bits in _BITS
    ]


MEASUREMENTS = (
    Measurement(
        kind="thermal-noise",
        claim="Thermal noise has the power k T F of the sample rate.",
        quantities=(Quantity(name="power, noise factor 12 dB, 10 MHz", unit="dBm", within=0.02),),
        measure=_thermal,
        n_trials=64,
    ),
    Measurement(
        kind="white-noise",
        claim="Noise lies over the echo of its target by the ratio that is asked for.",
        quantities=(Quantity(name="echo over noise, in each sample", unit="dB", within=0.02),),
        measure=_white,
        n_trials=64,
    ),
    Measurement(
        kind="coloured-noise",
        claim="The density of coloured noise is straight in decibels between its points.",
        quantities=tuple(
            Quantity(
                name=f"{low / 1e6:.1f} to {high / 1e6:.1f} MHz, over thermal noise",
                unit="dB",
                within=0.1,
            )
            for low, high in _BANDS_HZ
        ),
        measure=_coloured,
        n_trials=64,
    ),
    Measurement(
        kind="jitter",
        claim="Samples taken late, by s rms, add noise 20 log(2π f s) below a tone at f.",
        quantities=(
            Quantity(name="1 ps, echo at 4.0 MHz", unit="dB", within=0.1),
            Quantity(name="1 ps, echo at 8.7 MHz", unit="dB", within=0.1),
        ),
        measure=_jitter,
        n_trials=64,
    ),
    Measurement(
        kind="quantisation",
        claim="An echo of full scale lies 6.02 dB a bit and 1.76 dB over the noise of rounding.",
        quantities=tuple(Quantity(name=f"{bits} bits", unit="dB", within=0.2) for bits in _BITS),
        measure=_quantisation,
        n_trials=32,
    ),
)
