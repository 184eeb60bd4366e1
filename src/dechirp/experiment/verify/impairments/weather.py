"""Air, rain and what they leave on a radome."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dechirp.core.units import decibels
from dechirp.echoes.impairments.base import Impairment
from dechirp.echoes.impairments.fog import Fog
from dechirp.echoes.impairments.gas import Gas
from dechirp.echoes.impairments.radome import Radome
from dechirp.echoes.impairments.rain import Rain
from dechirp.echoes.impairments.rain_backscatter import RainBackscatter
from dechirp.experiment.verify.impairments.bench import (
    GAIN,
    N_SAMPLES,
    NOTHING,
    TRANSMIT_W,
    level_db,
    mid_window_hz,
    radar,
    samples,
    still,
)
from dechirp.experiment.verify.impairments.measurement import Measured, Measurement, Quantity
from dechirp.theory.attenuation import fog_db_per_km, gas_db_per_km, rain_db_per_km
from dechirp.theory.rain_echo import reflectivity_per_m
from dechirp.theory.water import film_loss
from dechirp.theory.windows import taper

_FAR_M = 70.0
_RAIN_M_PER_S = 25e-3 / 3600
_FOG_KG_PER_M3 = 5e-4
_FILM_M, _FILM_K = 0.1e-3, 283.15


def _taken_db(*air: Impairment) -> float:
    """What it takes of an echo from 70 m."""
    scene = still(_FAR_M)
    return -level_db(samples(scene, *air), samples(scene))


def _gas(rng: np.random.Generator) -> Sequence[Measured]:
    return ((_taken_db(Gas()), gas_db_per_km(mid_window_hz()) * 2 * _FAR_M / 1e3),)


def _rain(rng: np.random.Generator) -> Sequence[Measured]:
    formula = rain_db_per_km(mid_window_hz(), _RAIN_M_PER_S)
    return ((_taken_db(Rain(rate_m_per_s=_RAIN_M_PER_S)), formula * 2 * _FAR_M / 1e3),)


def _fog(rng: np.random.Generator) -> Sequence[Measured]:
    formula = fog_db_per_km(mid_window_hz(), _FOG_KG_PER_M3)
    return ((_taken_db(Fog(water_kg_per_m3=_FOG_KG_PER_M3)), formula * 2 * _FAR_M / 1e3),)


def _radome(rng: np.random.Generator) -> Sequence[Measured]:
    film_db = float(decibels(film_loss(mid_window_hz(), _FILM_M, _FILM_K)))
    return (
        (_taken_db(Radome(film_m=_FILM_M, temperature_k=_FILM_K)), 2 * film_db),
        (_taken_db(Radome(loss=2.0)), float(decibels(2.0))),
    )


_RINGS_M = ((8.0, 16.0), (16.0, 32.0), (32.0, 64.0))


def _drops(rng: np.random.Generator) -> Sequence[Measured]:
    """Power from between two ranges over the radar equation for a volume."""
    by = replace(radar(2), frame=replace(radar(2).frame, period_s=0.01))
    found = samples(NOTHING, RainBackscatter(rate_m_per_s=_RAIN_M_PER_S), by=by, rng=rng)
    weights = taper("blackman", N_SAMPLES)
    lines = abs(np.fft.fft(found * weights)) ** 2 / (N_SAMPLES * np.sum(weights**2))
    chirp = by.frame.chirp
    eta = reflectivity_per_m(mid_window_hz(), _RAIN_M_PER_S)
    # A gain of G alone sees 4 pi / G.
    factor = TRANSMIT_W * chirp.wavelength_m**2 * eta / (4 * np.pi) ** 3 * GAIN * 4 * np.pi
    bins_m, width_m = chirp.range_bins_m(), chirp.range_resolution_m
    ratios = []
    for low_m, high_m in _RINGS_M:
        ring = (bins_m >= low_m) & (bins_m < high_m)
        inner, outer = bins_m[ring][0] - width_m / 2, bins_m[ring][-1] + width_m / 2
        power = lines[..., ring].sum(axis=-1).mean()
        ratios.append((float(power / (factor * (1 / inner - 1 / outer))), 1.0))
    return ratios


MEASUREMENTS = (
    Measurement(
        kind="gas",
        claim="Air takes of an echo what ITU-R P.676-12 says for the way there and back.",
        quantities=(Quantity(name="standard air, 70 m", unit="dB", within=1e-3),),
        measure=_gas,
    ),
    Measurement(
        kind="rain",
        claim="Rain takes of an echo what ITU-R P.838-3 says for the way there and back.",
        quantities=(Quantity(name="25 mm/h, 70 m", unit="dB", within=1e-3),),
        measure=_rain,
    ),
    Measurement(
        kind="fog",
        claim="Fog takes of an echo what ITU-R P.840-8 says for the way there and back.",
        quantities=(Quantity(name="0.5 g/m³, 70 m", unit="dB", within=1e-3),),
        measure=_fog,
    ),
    Measurement(
        kind="radome",
        claim="A wet radome takes the loss of its film of water twice, a dry one its loss once.",
        quantities=(
            Quantity(name="0.1 mm of water", unit="dB", within=1e-3),
            Quantity(name="dry, 3 dB", unit="dB", within=1e-3),
        ),
        measure=_radome,
    ),
    Measurement(
        kind="rain-backscatter",
        claim="Drops send back what the radar equation for a volume says, at any range.",
        quantities=tuple(
            Quantity(
                name=f"power from {low:g} to {high:g} m over the equation", unit="1", within=0.06
            )
            for low, high in _RINGS_M
        ),
        measure=_drops,
        n_trials=640,
    ),
)
