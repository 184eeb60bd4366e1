"""Measurements of oscillator impairments: phase noise, PLL, non-linear ramps and slope drift."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from dechirp.certificate.impairments.measurement import MeasuredPair, Measurement, Quantity
from dechirp.certificate.impairments.reference_radar import (
    N_SAMPLES,
    RAMP_S,
    RATE_HZ,
    SLOPE_HZ_PER_S,
    beat_frequency_hz,
    equal_power_stationary_scene,
    fit_phase_polynomial,
    impairment_radar,
    mean_power_w,
    round_trip_delay_s,
    sample_times_s,
    simulate_samples,
    tone_power_w,
)
from dechirp.core.units import from_decibels, to_decibels
from dechirp.simulation.impairments.phase_noise import PhaseNoise
from dechirp.simulation.impairments.pll import Pll
from dechirp.simulation.impairments.sweep_nonlinearity import (
    PolynomialNonlinearity,
    SinusoidalNonlinearity,
    SlopeDrift,
)

_RANGE_M = 40.0
_MASK_HZ = (1e5, 1e6, 3e6)
_MASK_DB = (-90.0, -96.0, -110.0)
# Far from the middle of the band: its skirt reaches beyond half the sample rate.
_NOISY_RANGE_M = 65.0
# In the last 2 % of the map, whose first cells contain sidelobes of the noise beside the echo.
_LAST_RANGE_M = 73.5
_FIRST_CELLS = ((0, 2), (3, 8), (9, 40))
_BANDS_HZ = ((-8.4e6, -5.2e6), (-4.6e6, -3.2e6), (-2.8e6, -1.4e6), (-1.2e6, -4e5), (4e5, 1.2e6))


def _phase_noise_mask_per_hz(offset_hz: np.ndarray) -> np.ndarray:
    """Interpolate the mask linearly in dB over the logarithm of the offset."""
    return from_decibels(np.interp(np.log(offset_hz), np.log(_MASK_HZ), _MASK_DB))


def _expected_density(range_m: float, n_points: int = 32) -> np.ndarray:
    """Integrate the skirt of an echo over the passed band, weighted by the window of each cell.

    Cells at either end contain noise of the other end, as far as their main lobes and sidelobes
    extend.
    """
    weights = np.hanning(N_SAMPLES + 1)[:-1]
    samples, beats = np.arange(N_SAMPLES), np.arange(N_SAMPLES) * RATE_HZ / N_SAMPLES
    density = np.zeros(N_SAMPLES)
    for fraction in (np.arange(n_points) + 0.5) / n_points:
        offset_hz = beats + fraction * RATE_HZ / N_SAMPLES - beat_frequency_hz(range_m)
        skirt = _phase_noise_mask_per_hz(abs(offset_hz))
        skirt *= 4 * np.sin(np.pi * offset_hz * round_trip_delay_s(range_m)) ** 2
        line = weights * np.exp(2j * np.pi * fraction * samples / N_SAMPLES)
        lobe = abs(np.fft.fft(line)) ** 2
        density += np.fft.ifft(np.fft.fft(lobe) * np.fft.fft(skirt)).real
    return density / (n_points * N_SAMPLES * np.sum(weights**2))


def _measure_phase_noise_density(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the noise density in bands of the beat spectrum, relative to the echo, in 1 Hz."""
    noise = PhaseNoise(
        offset_hz=_MASK_HZ, level_per_hz=tuple(float(from_decibels(level)) for level in _MASK_DB)
    )
    radar, weights = impairment_radar(256), np.hanning(N_SAMPLES + 1)[:-1]

    def measure_and_expect(range_m: float) -> np.ndarray:
        scene = equal_power_stationary_scene(range_m)
        echo = simulate_samples(scene, radar=radar)[0, :, 0]
        noisy_echo = simulate_samples(scene, noise, radar=radar, rng=rng)[0, :, 0]
        density = np.mean(abs(np.fft.fft((noisy_echo - echo) * weights)) ** 2, axis=0)
        density /= RATE_HZ * np.sum(weights**2) * mean_power_w(echo)
        return np.stack([density, _expected_density(range_m)])

    offset_hz = np.arange(N_SAMPLES) * RATE_HZ / N_SAMPLES - beat_frequency_hz(_NOISY_RANGE_M)
    densities = measure_and_expect(_NOISY_RANGE_M)
    bands = [
        densities[:, (offset_hz >= low_hz) & (offset_hz < high_hz)] for low_hz, high_hz in _BANDS_HZ
    ]
    densities = measure_and_expect(_LAST_RANGE_M)
    bands += [densities[:, first : last + 1] for first, last in _FIRST_CELLS]
    levels_db = [to_decibels(band.mean(axis=1)) for band in bands]
    return [(float(measured), float(formula)) for measured, formula in levels_db]


_GAIN_CHANGE, _LOOP_HZ = -0.4, 0.5e6


def _measure_pll_frequency_error(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the frequency error of the settled loop from the phase error of an echo."""
    loop = Pll(natural_frequency_hz=_LOOP_HZ, gain_change=(_GAIN_CHANGE,))
    scene = equal_power_stationary_scene(_RANGE_M)
    ratio = (simulate_samples(scene, loop) / simulate_samples(scene))[
        0, :, 0, sample_times_s() > 20e-6
    ]
    residual_hz = np.angle(np.mean(ratio)) / (2 * np.pi * round_trip_delay_s(_RANGE_M))
    # The tuning curve is B (u + c u^2 / 2) / (1 + c / 2), u = t / T.
    curvature = SLOPE_HZ_PER_S / RAMP_S * _GAIN_CHANGE / (1 + _GAIN_CHANGE / 2)
    return ((float(residual_hz), curvature / (2 * np.pi * _LOOP_HZ) ** 2),)


_ERROR_HZ = 400e3


def _measure_beat_shift_by_polynomial_ramp_error(
    rng: np.random.Generator,
) -> Sequence[MeasuredPair]:
    """Measure the beat-frequency shift by a slope error and the sweep by a quadratic error."""
    scene = equal_power_stationary_scene(_RANGE_M)
    clean = simulate_samples(scene)[0, 0, 0]
    results = []
    for order in (1, 2):
        nonlinearity = PolynomialNonlinearity(error_hz=(*[0.0] * order, _ERROR_HZ))
        leading_coefficient, *_ = fit_phase_polynomial(
            simulate_samples(scene, nonlinearity)[0, 0, 0] / clean, order
        )
        formula = order * _ERROR_HZ / RAMP_S**order * round_trip_delay_s(_RANGE_M)
        results.append((leading_coefficient * order / (2 * np.pi), formula))
    return results


_DEVIATION_HZ, _RIPPLE_BINS = 300e3, 40


def _measure_paired_echoes_by_sinusoidal_ramp_error(
    rng: np.random.Generator,
) -> Sequence[MeasuredPair]:
    """Measure the paired echoes relative to the echo."""
    rate_hz = _RIPPLE_BINS * RATE_HZ / N_SAMPLES
    ripple = SinusoidalNonlinearity(deviation_hz=_DEVIATION_HZ, rate_hz=rate_hz)
    results = simulate_samples(equal_power_stationary_scene(_RANGE_M), ripple)[0, 0, 0]
    beta = 2 * _DEVIATION_HZ / rate_hz * np.sin(np.pi * rate_hz * round_trip_delay_s(_RANGE_M))
    formula_db = float(2 * to_decibels(abs(scipy.special.j1(beta) / scipy.special.j0(beta))))
    middle_hz = beat_frequency_hz(_RANGE_M)
    echo = tone_power_w(results, middle_hz)
    return [
        (float(to_decibels(tone_power_w(results, middle_hz + side * rate_hz) / echo)), formula_db)
        for side in (-1, 1)
    ]


_DRIFT_PER_S = 8e-4


def _measure_range_drift_by_slope_drift(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the range drift of an echo per second."""
    radar = replace(impairment_radar(8), frame=replace(impairment_radar(8).frame, period_s=1.0))
    drift = SlopeDrift(relative_drift=_DRIFT_PER_S)
    results = simulate_samples(
        equal_power_stationary_scene(_RANGE_M), drift, radar=radar, n_frames=4
    )[:, 0, 0]
    clean = simulate_samples(equal_power_stationary_scene(_RANGE_M), radar=radar)[0, 0, 0]
    beats_hz = [fit_phase_polynomial(row / clean)[0] / (2 * np.pi) for row in results]
    range_m = radar.frame.chirp.range_m(1.0) * np.array(beats_hz)
    return ((float(np.mean(np.diff(range_m))), _RANGE_M * _DRIFT_PER_S),)


MEASUREMENTS = (
    Measurement(
        kind="phase-noise",
        claim="The phase-noise density beside an echo is the oscillator mask times 4 sin²(π f τ),"
        " averaged over the window of the map.",
        quantities=tuple(
            Quantity(
                name=f"density in 1 Hz, {min(abs(low), abs(high)) / 1e6:.1f} to"
                f" {max(abs(low), abs(high)) / 1e6:.1f} MHz {'below' if low < 0 else 'above'} an"
                f" echo at {_NOISY_RANGE_M:.0f} m"
                + (", beyond half the sample rate" if low < -RATE_HZ / 2 else ""),
                unit="dB",
                tolerance=0.25,
            )
            for low, high in _BANDS_HZ
        )
        + tuple(
            Quantity(
                name=f"density in 1 Hz, range cells {first} to {last}, of an echo at"
                f" {_LAST_RANGE_M} m in the last 2 % of the map",
                unit="dB",
                tolerance=0.5,
            )
            for first, last in _FIRST_CELLS
        ),
        measure=_measure_phase_noise_density,
        n_trials=32,
    ),
    Measurement(
        kind="pll",
        claim="The residual frequency error of a settled loop is the curvature of the tuning curve"
        " over the square of the natural angular frequency.",
        quantities=(Quantity(name="frequency error late in the ramp", unit="Hz", tolerance=300.0),),
        measure=_measure_pll_frequency_error,
    ),
    Measurement(
        kind="polynomial-nonlinearity",
        claim="The beat frequency shifts by the delay times the derivative of the frequency error.",
        quantities=(
            Quantity(name="slope error: shift of the beat frequency", unit="Hz", tolerance=10.0),
            Quantity(
                name="quadratic error: sweep of the beat frequency", unit="Hz/s", tolerance=1e6
            ),
        ),
        measure=_measure_beat_shift_by_polynomial_ramp_error,
    ),
    Measurement(
        kind="sinusoidal-nonlinearity",
        claim="A sinusoidal ramp error produces paired echoes of J1(β)/J0(β) relative to the echo.",
        quantities=(
            Quantity(name="paired echo below the echo", unit="dB", tolerance=0.1),
            Quantity(name="paired echo above the echo", unit="dB", tolerance=0.1),
        ),
        measure=_measure_paired_echoes_by_sinusoidal_ramp_error,
    ),
    Measurement(
        kind="slope-drift",
        claim="A slope drift shifts the range of an echo by the range times the relative drift.",
        quantities=(Quantity(name="range drift in one second", unit="m", tolerance=1e-4),),
        measure=_measure_range_drift_by_slope_drift,
    ),
)
