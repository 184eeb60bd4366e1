"""Measurements of leakage, coupling, antenna position errors, multipath and interference."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dechirp.certificate.impairments.measurement import MeasuredPair, Measurement, Quantity
from dechirp.certificate.impairments.reference_radar import (
    ANTENNA_GAIN,
    EMPTY_SCENE,
    RATE_HZ,
    SLOPE_HZ_PER_S,
    TRANSMIT_POWER_W,
    beat_frequency_hz,
    fit_phase_polynomial,
    impairment_radar,
    mean_power_w,
    mid_window_frequency_hz,
    sample_times_s,
    simulate_samples,
    to_dbm,
    tone_power_w,
)
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.radar.array import Array
from dechirp.scene.bodies.vehicle import Truck
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.simulation.impairments.base import Propagation
from dechirp.simulation.impairments.body_multipath import BodyMultipath
from dechirp.simulation.impairments.bumper import Bumper
from dechirp.simulation.impairments.interference import Interference, Interferer
from dechirp.simulation.impairments.leakage import Leakage
from dechirp.simulation.impairments.mutual_coupling import MutualCoupling
from dechirp.simulation.impairments.position_errors import PositionErrors
from dechirp.simulation.impairments.two_ray_ground import TwoRayGround
from dechirp.simulation.impairments.wall_multipath import WallMultipath

_PATH_M = 3.0


def _one_way_friis_gain(length_m: float) -> float:
    """Return the one-way Friis power ratio between two antennas of the radar's gain."""
    wavelength_m = impairment_radar().frame.chirp.wavelength_m
    return (ANTENNA_GAIN * wavelength_m / (4 * np.pi * length_m)) ** 2


def _measure_leakage_power_and_beat_frequency(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the leakage power over the transmitted power, and the beat frequency of 3 m."""
    leakage_samples = simulate_samples(EMPTY_SCENE, Leakage(isolation=1e3, extra_length_m=_PATH_M))[
        0, 0, 0
    ]
    phase_rate, _ = fit_phase_polynomial(leakage_samples)
    return (
        (float(to_decibels(mean_power_w(leakage_samples) / TRANSMIT_POWER_W)), -30.0),
        (phase_rate / (2 * np.pi), SLOPE_HZ_PER_S * _PATH_M / SPEED_OF_LIGHT),
    )


def _measure_bumper_echo_power(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    samples = simulate_samples(EMPTY_SCENE, Bumper(distance_m=0.04, reflectivity=0.05))[0, 0, 0]
    return (
        (
            to_dbm(mean_power_w(samples)),
            to_dbm(TRANSMIT_POWER_W * 0.05 * _one_way_friis_gain(0.08)),
        ),
    )


_OFF_BORESIGHT_SCENE = Scene(targets=(Target(position_m=(20.0, 12.0, 0.0)),))


def _measure_mutual_coupling_level_and_phase(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the level and phase of the neighbour's signal in a receiver."""
    clean = simulate_samples(_OFF_BORESIGHT_SCENE)[0]
    coupled = simulate_samples(
        _OFF_BORESIGHT_SCENE, MutualCoupling(rx_level=0.01, rx_phase_rad=0.7)
    )[0]
    coefficient = np.mean((coupled[:, 0] - clean[:, 0]) / clean[:, 1])
    return (float(2 * to_decibels(abs(coefficient))), -20.0), (float(np.angle(coefficient)), 0.7)


_POSITION_ERROR_M = 1e-4


def _measure_phase_by_antenna_position_error(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the phase error of a receiver displaced to the left, for an echo from 31 degrees."""
    impairment = PositionErrors(rx_m=((0.0, 0.0, 0.0), (0.0, _POSITION_ERROR_M, 0.0)))
    ratio = (
        simulate_samples(_OFF_BORESIGHT_SCENE, impairment)[0, :, 1]
        / simulate_samples(_OFF_BORESIGHT_SCENE)[0, :, 1]
    )
    sine = 12.0 / np.hypot(20.0, 12.0)
    formula = -2 * np.pi * _POSITION_ERROR_M * sine * mid_window_frequency_hz() / SPEED_OF_LIGHT
    return ((float(np.angle(ratio.mean())), formula),)


_HEIGHT_M, _TARGET_HEIGHT_M = 0.5, 0.9


def _measure_two_ray_maximum_and_minimum(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the strongest and weakest echo relative to free space between 45 m and 70 m."""
    radar = replace(impairment_radar(1), array=Array())
    road = TwoRayGround(height_m=_HEIGHT_M, permittivity=4.0)
    measured_db, formula_db = [], []
    for ahead_m in np.linspace(45.0, 70.0, 26):
        position_m = (float(ahead_m), 0.0, _TARGET_HEIGHT_M - _HEIGHT_M)
        scene = Scene(targets=(Target(position_m=position_m),))
        ratio = (
            simulate_samples(scene, road, radar=radar)[0, 0, 0]
            / simulate_samples(scene, radar=radar)[0, 0, 0]
        )
        measured_db.append(to_decibels(abs(ratio) ** 2))
        direct_m = np.hypot(ahead_m, _HEIGHT_M - _TARGET_HEIGHT_M)
        reflected_m = np.hypot(ahead_m, _HEIGHT_M + _TARGET_HEIGHT_M)
        sine, cosine = (_HEIGHT_M + _TARGET_HEIGHT_M) / reflected_m, ahead_m / reflected_m
        root = np.sqrt(4.0 - cosine**2)
        gamma = (4.0 * sine - root) / (4.0 * sine + root)
        frequency_hz = 77e9 + SLOPE_HZ_PER_S * (sample_times_s() - 2 * direct_m / SPEED_OF_LIGHT)
        phasor = np.exp(-2j * np.pi * frequency_hz * (reflected_m - direct_m) / SPEED_OF_LIGHT)
        formula_db.append(to_decibels(abs(1 + gamma * phasor) ** 4))
    return (
        (float(np.max(measured_db)), float(np.max(formula_db))),
        (float(np.min(measured_db)), float(np.min(formula_db))),
    )


_REFLECTIVITY = 0.25


def _measure_wall_ghost_levels(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the ghosts of a target beside a wall relative to its echo: one and two bounces."""
    wall = WallMultipath(start_m=(-10.0, 6.0), end_m=(60.0, 6.0), reflectivity=_REFLECTIVITY)
    return _ghost_level_pairs((), wall, np.sqrt(_REFLECTIVITY))


def _measure_body_ghost_levels(rng: np.random.Generator) -> Sequence[MeasuredPair]:
    """Measure the ghosts of a target beside the side of a truck, of a permittivity of 5.24."""
    truck = Truck(length_m=14.0, width_m=2.5, height_m=4.0)
    truck_target = Target(name="truck", position_m=(8.0, 6.0 + truck.width_m / 2, -2.0), body=truck)
    # The wave arrives at asin(0.8) from the normal of the side.
    root = np.sqrt(5.24 - 0.8**2)
    fresnel = (0.6 - root) / (0.6 + root)
    return _ghost_level_pairs((truck_target,), BodyMultipath(permittivity=5.24), abs(fresnel))


def _ghost_level_pairs(
    others: tuple[Target, ...], impairment: Propagation, coefficient: float
) -> list[MeasuredPair]:
    """Return levels over the echo of a target 9 m beside a mirror along x, and their formulas."""
    radar = replace(impairment_radar(1), array=Array())
    target = Target(name="target", position_m=(20.0, -3.0, 0.0))
    echo = simulate_samples(Scene(targets=(target,)), radar=radar)[0, 0, 0]
    scene = Scene(targets=(*others, target))
    ghosts = (
        simulate_samples(scene, impairment, radar=radar) - simulate_samples(scene, radar=radar)
    )[0, 0, 0]
    direct_m, image_m = np.hypot(20.0, 3.0), np.hypot(20.0, 15.0)
    single_bounce = 2 * coefficient * direct_m / image_m  # out and back
    double_bounce = (coefficient * direct_m / image_m) ** 2
    return [
        (
            float(
                to_decibels(tone_power_w(ghosts, beat_frequency_hz(range_m)) / mean_power_w(echo))
            ),
            float(2 * to_decibels(amplitude_ratio)),
        )
        for range_m, amplitude_ratio in (
            ((direct_m + image_m) / 2, single_bounce),
            (image_m, double_bounce),
        )
    ]


_INTERFERER_RANGE_M, _INTERFERER_POWER_W, _INTERFERER_GAIN = 40.0, 0.01, 4.0


def _interferer_crossing_at_mid_ramp(slope_hz_per_s: float, *, offset_s: float = 0.0) -> Interferer:
    """Return an interferer ahead whose ramps cross those of the radar in the middle."""
    return Interferer(
        start_frequency_hz=77e9 + (SLOPE_HZ_PER_S - slope_hz_per_s) * 15e-6,
        slope_hz_per_s=slope_hz_per_s,
        ramp_duration_s=30e-6,
        interval_s=35e-6,
        coherent=True,
        transmit_power_w=_INTERFERER_POWER_W,
        antenna_gain=_INTERFERER_GAIN,
        position_m=(_INTERFERER_RANGE_M, 0.0, 0.0),
        offset_s=offset_s,
    )


def _measure_interference_power_and_burst_duration(
    rng: np.random.Generator,
) -> Sequence[MeasuredPair]:
    """Measure the power of a parallel interferer, and the burst duration of a crossing one."""
    # The interferer transmits early, so that its beat frequency lies in the middle of the band.
    early_s = _INTERFERER_RANGE_M / SPEED_OF_LIGHT - 5e6 / SLOPE_HZ_PER_S
    ghost = simulate_samples(
        EMPTY_SCENE,
        Interference(interferers=(_interferer_crossing_at_mid_ramp(20e12, offset_s=-early_s),)),
    )
    friis_w = (
        _INTERFERER_POWER_W
        * _one_way_friis_gain(_INTERFERER_RANGE_M)
        * _INTERFERER_GAIN
        / ANTENNA_GAIN
    )
    burst = (
        abs(
            simulate_samples(
                EMPTY_SCENE, Interference(interferers=(_interferer_crossing_at_mid_ramp(19e12),))
            )[0, :, 0]
        )
        ** 2
    )
    is_on = burst > burst.max() / 2
    duration_s = float(is_on.sum(axis=1).mean()) / RATE_HZ
    return (
        (to_dbm(mean_power_w(ghost)), to_dbm(friis_w)),
        (duration_s, RATE_HZ / abs(SLOPE_HZ_PER_S - 19e12)),
    )


MEASUREMENTS = (
    Measurement(
        kind="leakage",
        claim="Leakage has the transmitted power over the isolation, and the beat frequency of its"
        " path length.",
        quantities=(
            Quantity(name="power over the transmitted power", unit="dB", tolerance=0.01),
            Quantity(name="beat frequency of a 3 m path", unit="Hz", tolerance=1.0),
        ),
        measure=_measure_leakage_power_and_beat_frequency,
    ),
    Measurement(
        kind="bumper",
        claim="The bumper echo follows the Friis equation over the distance to the antenna's mirror"
        " image.",
        quantities=(Quantity(name="received power", unit="dBm", tolerance=0.01),),
        measure=_measure_bumper_echo_power,
    ),
    Measurement(
        kind="mutual-coupling",
        claim="A receiver contains the signal of its neighbour with the level and phase of the"
        " coupling matrix.",
        quantities=(
            Quantity(name="level of the coupled signal", unit="dB", tolerance=0.01),
            Quantity(name="phase of the coupled signal", unit="rad", tolerance=0.001),
        ),
        measure=_measure_mutual_coupling_level_and_phase,
    ),
    Measurement(
        kind="position-errors",
        claim="A position error e of an antenna shifts the phase by 2π e u / λ.",
        quantities=(
            Quantity(
                name="phase, 0.1 mm across, echo from 31 degrees", unit="rad", tolerance=0.001
            ),
        ),
        measure=_measure_phase_by_antenna_position_error,
    ),
    Measurement(
        kind="two-ray-ground",
        claim="Over a road the echo varies by the two-way two-ray factor with the Fresnel"
        " reflection"
        " coefficient.",
        quantities=(
            Quantity(name="maximum over free space, 45 to 70 m", unit="dB", tolerance=0.05),
            Quantity(name="minimum over free space, 45 to 70 m", unit="dB", tolerance=0.3),
        ),
        measure=_measure_two_ray_maximum_and_minimum,
    ),
    Measurement(
        kind="wall-multipath",
        claim="A wall produces ghosts at the mirror image of a target and halfway to it, with the"
        " power of the radar equation.",
        quantities=(
            Quantity(name="single bounce, over the echo", unit="dB", tolerance=0.02),
            Quantity(name="double bounce, over the echo", unit="dB", tolerance=0.02),
        ),
        measure=_measure_wall_ghost_levels,
    ),
    Measurement(
        kind="body-multipath",
        claim="The side of a truck produces ghosts at the mirror image of a target and halfway to"
        " it, with the power of the radar equation and the Fresnel reflection coefficient.",
        quantities=(
            Quantity(name="single bounce, over the echo", unit="dB", tolerance=0.02),
            Quantity(name="double bounce, over the echo", unit="dB", tolerance=0.02),
        ),
        measure=_measure_body_ghost_levels,
    ),
    Measurement(
        kind="interference",
        claim="Interference has the one-way power of the Friis equation, and a burst lasts for the"
        " passband over the slope difference.",
        quantities=(
            Quantity(name="power, parallel ramps, 40 m ahead", unit="dBm", tolerance=0.05),
            Quantity(name="burst duration, crossing ramps", unit="s", tolerance=0.15e-6),
        ),
        measure=_measure_interference_power_and_burst_duration,
    ),
)
