"""Measurements of attenuation by air, rain and fog, of rain backscatter and of the radome."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dechirp.certificate.impairments.measurement import MeasuredPair, Measurement, Quantity
from dechirp.certificate.impairments.reference_radar import (
    ANTENNA_GAIN,
    EMPTY_SCENE,
    N_SAMPLES,
    TRANSMIT_POWER_W,
    equal_power_stationary_scene,
    impairment_radar,
    mid_window_frequency_hz,
    power_ratio_db,
    simulate_samples,
)
from dechirp.certificate.impairments.weather_references import (
    evaluate_film_loss,
    evaluate_fog_db_per_km,
    evaluate_rain_reflectivity_per_m,
    interpolate_gas_table_db_per_km,
    interpolate_rain_table_db_per_km,
)
from dechirp.core.units import to_decibels
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.fog_attenuation import FogAttenuation
from dechirp.simulation.impairments.gas_attenuation import GasAttenuation
from dechirp.simulation.impairments.radome import Radome
from dechirp.simulation.impairments.rain_attenuation import RainAttenuation
from dechirp.simulation.impairments.rain_backscatter import RainBackscatter
from dechirp.theory.windows import window_weights

_RANGE_M = 70.0
_RAIN_RATE_MM_PER_H = 25.0
_RAIN_RATE_M_PER_S = _RAIN_RATE_MM_PER_H * 1e-3 / 3600
_FOG_WATER_KG_PER_M3 = 5e-4
_WATER_TEMPERATURE_K = 283.15
_FILM_THICKNESS_M = 0.1e-3


def _echo_loss_db(*impairments: Impairment) -> float:
    """Return the loss of an echo from 70 m by impairments."""
    scene = equal_power_stationary_scene(_RANGE_M)
    return -power_ratio_db(simulate_samples(scene, *impairments), simulate_samples(scene))


def _measure_echo_loss_by_gas(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    return (
        (
            _echo_loss_db(GasAttenuation()),
            interpolate_gas_table_db_per_km(mid_window_frequency_hz()) * 2 * _RANGE_M / 1e3,
        ),
    )


def _measure_echo_loss_by_rain(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    formula = interpolate_rain_table_db_per_km(mid_window_frequency_hz(), _RAIN_RATE_MM_PER_H)
    return (
        (
            _echo_loss_db(RainAttenuation(rate_m_per_s=_RAIN_RATE_M_PER_S)),
            formula * 2 * _RANGE_M / 1e3,
        ),
    )


def _measure_echo_loss_by_fog(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    formula = evaluate_fog_db_per_km(
        mid_window_frequency_hz(), _FOG_WATER_KG_PER_M3 * 1e3, _WATER_TEMPERATURE_K
    )
    return (
        (
            _echo_loss_db(
                FogAttenuation(
                    water_kg_per_m3=_FOG_WATER_KG_PER_M3, temperature_k=_WATER_TEMPERATURE_K
                )
            ),
            formula * 2 * _RANGE_M / 1e3,
        ),
    )


def _measure_echo_loss_by_radome(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    film_db = float(
        to_decibels(
            evaluate_film_loss(mid_window_frequency_hz(), _FILM_THICKNESS_M, _WATER_TEMPERATURE_K)
        )
    )
    return (
        (
            _echo_loss_db(Radome(film_m=_FILM_THICKNESS_M, temperature_k=_WATER_TEMPERATURE_K)),
            2 * film_db,
        ),
        (_echo_loss_db(Radome(loss=2.0)), float(to_decibels(2.0))),
    )


_RANGE_INTERVALS_M = ((8.0, 16.0), (16.0, 32.0), (32.0, 64.0))


def _measure_rain_backscatter_power(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the power from range intervals over the radar equation for volume scattering."""
    radar = replace(impairment_radar(2), frame=replace(impairment_radar(2).frame, period_s=0.01))
    samples = simulate_samples(
        EMPTY_SCENE, RainBackscatter(rate_m_per_s=_RAIN_RATE_M_PER_S), radar=radar, rng=rng
    )
    weights = window_weights("blackman", N_SAMPLES)
    spectrum = abs(np.fft.fft(samples * weights)) ** 2 / (N_SAMPLES * np.sum(weights**2))
    chirp = radar.frame.chirp
    eta = evaluate_rain_reflectivity_per_m(
        mid_window_frequency_hz(), _RAIN_RATE_MM_PER_H, _WATER_TEMPERATURE_K
    )
    # An antenna of gain G has the beam solid angle 4 pi / G.
    factor = (
        TRANSMIT_POWER_W * chirp.wavelength_m**2 * eta / (4 * np.pi) ** 3 * ANTENNA_GAIN * 4 * np.pi
    )
    bins_m, width_m = chirp.range_bins_m(), chirp.range_resolution_m
    ratios = []
    for low_m, high_m in _RANGE_INTERVALS_M:
        in_interval = (bins_m >= low_m) & (bins_m < high_m)
        inner, outer = bins_m[in_interval][0] - width_m / 2, bins_m[in_interval][-1] + width_m / 2
        power = spectrum[..., in_interval].sum(axis=-1).mean()
        ratios.append((float(power / (factor * (1 / inner - 1 / outer))), 1.0))
    return ratios


MEASUREMENTS = (
    Measurement(
        kind="gas-attenuation",
        claim="The two-way attenuation of an echo by air is that of the validation examples"
        " of ITU-R P.676-12.",
        quantities=(Quantity(name="standard air, 70 m", unit="dB", tolerance=2e-4),),
        measure=_measure_echo_loss_by_gas,
    ),
    Measurement(
        kind="rain-attenuation",
        claim="The two-way attenuation of an echo by rain follows table 5 of ITU-R P.838-3.",
        quantities=(Quantity(name="25 mm/h, 70 m", unit="dB", tolerance=1e-3),),
        measure=_measure_echo_loss_by_rain,
    ),
    Measurement(
        kind="fog-attenuation",
        claim="The two-way attenuation of an echo by fog is that of ITU-R P.840-8.",
        quantities=(Quantity(name="0.5 g/m³, 70 m", unit="dB", tolerance=1e-3),),
        measure=_measure_echo_loss_by_fog,
    ),
    Measurement(
        kind="radome",
        claim="A wet radome attenuates an echo by twice the loss of its water film, a dry one by"
        " its"
        " two-way loss.",
        quantities=(
            Quantity(name="water film of 0.1 mm", unit="dB", tolerance=1e-3),
            Quantity(name="dry radome of 3 dB", unit="dB", tolerance=1e-3),
        ),
        measure=_measure_echo_loss_by_radome,
    ),
    Measurement(
        kind="rain-backscatter",
        claim="Rain backscatter follows the radar equation for volume scattering at all ranges.",
        quantities=tuple(
            Quantity(
                name=f"power from {low:g} to {high:g} m over the radar equation",
                unit="1",
                tolerance=0.06,
            )
            for low, high in _RANGE_INTERVALS_M
        ),
        measure=_measure_rain_backscatter_power,
        n_trials=640,
    ),
)
