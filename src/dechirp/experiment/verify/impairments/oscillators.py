"""Oscillators that are not what they should be: phase noise, loops, ramps that bend or drift."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import j0, j1

from dechirp.core.units import decibels, from_decibels
from dechirp.echoes.impairments.phase_noise import PhaseNoise
from dechirp.echoes.impairments.pll import Pll
from dechirp.echoes.impairments.polynomial_nonlinearity import PolynomialNonlinearity
from dechirp.echoes.impairments.sinusoidal_nonlinearity import SinusoidalNonlinearity
from dechirp.echoes.impairments.slope_drift import SlopeDrift
from dechirp.experiment.verify.impairments.bench import (
    N_SAMPLES,
    RAMP_S,
    RATE_HZ,
    SLOPE_HZ_PER_S,
    beat_hz,
    delay_s,
    radar,
    samples,
    slope_of_phase,
    still,
    times_s,
    tone_w,
)
from dechirp.experiment.verify.impairments.measurement import Measured, Measurement, Quantity

_AT_M = 40.0
_MASK_HZ = (1e5, 1e6, 3e6)
_MASK_DB = (-90.0, -96.0, -110.0)
_BANDS_HZ = ((4e5, 1.2e6), (1.4e6, 2.8e6), (3.2e6, 4.6e6))


def _mask(offset_hz: np.ndarray) -> np.ndarray:
    """Straight in decibels over the logarithm of the offset."""
    return from_decibels(np.interp(np.log(offset_hz), np.log(_MASK_HZ), _MASK_DB))


def _phase_noise(rng: np.random.Generator) -> Sequence[Measured]:
    """Density of what is beside the carrier in each band, over 1 Hz."""
    by = radar(256)
    noise = PhaseNoise(
        offset_hz=_MASK_HZ, level_per_hz=tuple(float(from_decibels(one)) for one in _MASK_DB)
    )
    echo = samples(still(_AT_M), by=by)[0, :, 0]
    skirt = samples(still(_AT_M), noise, by=by, rng=rng)[0, :, 0] / echo - 1
    weights = np.hanning(N_SAMPLES + 1)[:-1]
    density = np.mean(abs(np.fft.fft(skirt * weights)) ** 2, axis=0)
    density /= RATE_HZ * np.sum(weights**2)
    offset_hz = abs(np.fft.fftfreq(N_SAMPLES, 1 / RATE_HZ))
    found = []
    for low_hz, high_hz in _BANDS_HZ:
        band = (offset_hz >= low_hz) & (offset_hz < high_hz)
        left = 4 * np.sin(np.pi * offset_hz[band] * delay_s(_AT_M)) ** 2
        formula = np.mean(_mask(offset_hz[band]) * left)
        found.append((float(decibels(density[band].mean())), float(decibels(formula))))
    return found


_GAIN_CHANGE, _LOOP_HZ = -0.4, 0.5e6


def _pll(rng: np.random.Generator) -> Sequence[Measured]:
    """Frequency error of the settled loop, from the phase that it leaves an echo."""
    loop = Pll(natural_frequency_hz=_LOOP_HZ, gain_change=(_GAIN_CHANGE,))
    scene = still(_AT_M)
    ratio = (samples(scene, loop) / samples(scene))[0, :, 0, times_s() > 20e-6]
    left_hz = np.angle(np.mean(ratio)) / (2 * np.pi * delay_s(_AT_M))
    # The tuning curve is B (u + c u^2 / 2) / (1 + c / 2), u = t / T.
    curvature = SLOPE_HZ_PER_S / RAMP_S * _GAIN_CHANGE / (1 + _GAIN_CHANGE / 2)
    return ((float(left_hz), curvature / (2 * np.pi * _LOOP_HZ) ** 2),)


_ERROR_HZ = 400e3


def _polynomial(rng: np.random.Generator) -> Sequence[Measured]:
    """What an error of the slope, and a parabola, do to the beat frequency."""
    scene = still(_AT_M)
    clean = samples(scene)[0, 0, 0]
    found = []
    for order in (1, 2):
        bent = PolynomialNonlinearity(error_hz=(*[0.0] * order, _ERROR_HZ))
        highest, *_ = slope_of_phase(samples(scene, bent)[0, 0, 0] / clean, order)
        formula = order * _ERROR_HZ / RAMP_S**order * delay_s(_AT_M)
        found.append((highest * order / (2 * np.pi), formula))
    return found


_DEVIATION_HZ, _RIPPLE_BINS = 300e3, 40


def _sinusoidal(rng: np.random.Generator) -> Sequence[Measured]:
    """Paired echoes over the echo."""
    rate_hz = _RIPPLE_BINS * RATE_HZ / N_SAMPLES
    ripple = SinusoidalNonlinearity(deviation_hz=_DEVIATION_HZ, rate_hz=rate_hz)
    found = samples(still(_AT_M), ripple)[0, 0, 0]
    beta = 2 * _DEVIATION_HZ / rate_hz * np.sin(np.pi * rate_hz * delay_s(_AT_M))
    formula_db = float(2 * decibels(abs(j1(beta) / j0(beta))))
    middle_hz = beat_hz(_AT_M)
    echo = tone_w(found, middle_hz)
    return [
        (float(decibels(tone_w(found, middle_hz + side * rate_hz) / echo)), formula_db)
        for side in (-1, 1)
    ]


_DRIFT_PER_S = 8e-4


def _slope_drift(rng: np.random.Generator) -> Sequence[Measured]:
    """Range that an echo gains each second."""
    by = replace(radar(8), frame=replace(radar(8).frame, period_s=1.0))
    drift = SlopeDrift(relative_drift=_DRIFT_PER_S)
    found = samples(still(_AT_M), drift, by=by, n_frames=4)[:, 0, 0]
    clean = samples(still(_AT_M), by=by)[0, 0, 0]
    beats_hz = [slope_of_phase(row / clean)[0] / (2 * np.pi) for row in found]
    range_m = by.frame.chirp.range_m(1.0) * np.array(beats_hz)
    return ((float(np.mean(np.diff(range_m))), _AT_M * _DRIFT_PER_S),)


MEASUREMENTS = (
    Measurement(
        kind="phase-noise",
        claim="The skirts of an echo are the mask of the oscillator times 4 sin²(π f τ).",
        quantities=tuple(
            Quantity(
                name=f"in 1 Hz, {low / 1e6:.1f} to {high / 1e6:.1f} MHz from an echo at 40 m"
                + (", the floor of the mask" if low > _MASK_HZ[-1] else ""),
                unit="dB",
                within=0.25,
            )
            for low, high in _BANDS_HZ
        ),
        measure=_phase_noise,
        n_trials=32,
    ),
    Measurement(
        kind="pll",
        claim="A settled loop leaves the curvature of the tuning curve over its natural frequency"
        " squared.",
        quantities=(Quantity(name="frequency error late in the ramp", unit="Hz", within=300.0),),
        measure=_pll,
    ),
    Measurement(
        kind="polynomial-nonlinearity",
        claim="The beat frequency moves by the delay times the derivative of the error.",
        quantities=(
            Quantity(name="error of the slope: shift of the beat", unit="Hz", within=10.0),
            Quantity(name="parabola: sweep of the beat", unit="Hz/s", within=1e6),
        ),
        measure=_polynomial,
    ),
    Measurement(
        kind="sinusoidal-nonlinearity",
        claim="A ripple on the ramp makes paired echoes at J1(β)/J0(β) of the echo.",
        quantities=(
            Quantity(name="pair below the echo", unit="dB", within=0.1),
            Quantity(name="pair above the echo", unit="dB", within=0.1),
        ),
        measure=_sinusoidal,
    ),
    Measurement(
        kind="slope-drift",
        claim="A slope that drifts moves an echo by its range times the drift.",
        quantities=(Quantity(name="range gained in a second", unit="m", within=1e-4),),
        measure=_slope_drift,
    ),
)
