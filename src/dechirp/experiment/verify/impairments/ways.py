"""Ways beside those of echoes: leakage, antennas, road, wall, other radars."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.echoes.impairments.bumper import Bumper
from dechirp.echoes.impairments.coupling import Coupling
from dechirp.echoes.impairments.ground import Ground
from dechirp.echoes.impairments.interference import Interference, Interferer
from dechirp.echoes.impairments.leakage import Leakage
from dechirp.echoes.impairments.position_errors import PositionErrors
from dechirp.echoes.impairments.wall import Wall
from dechirp.experiment.verify.impairments.bench import (
    GAIN,
    NOTHING,
    RATE_HZ,
    SLOPE_HZ_PER_S,
    TRANSMIT_W,
    beat_hz,
    dbm,
    mid_window_hz,
    power_w,
    radar,
    samples,
    slope_of_phase,
    times_s,
    tone_w,
)
from dechirp.experiment.verify.impairments.measurement import Measured, Measurement, Quantity
from dechirp.radar.array import Array
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target

_WAY_M = 3.0


def _friis(length_m: float) -> float:
    """Power received over that sent, one way, both antennas with their gain."""
    wavelength_m = radar().frame.chirp.wavelength_m
    return (GAIN * wavelength_m / (4 * np.pi * length_m)) ** 2


def _leakage(rng: np.random.Generator) -> Sequence[Measured]:
    """Power over what is sent, and beat frequency of a way of 3 m."""
    leak = samples(NOTHING, Leakage(isolation=1e3, extra_length_m=_WAY_M))[0, 0, 0]
    turn, _ = slope_of_phase(leak)
    return (
        (float(decibels(power_w(leak) / TRANSMIT_W)), -30.0),
        (turn / (2 * np.pi), SLOPE_HZ_PER_S * _WAY_M / SPEED_OF_LIGHT),
    )


def _bumper(rng: np.random.Generator) -> Sequence[Measured]:
    found = samples(NOTHING, Bumper(distance_m=0.04, reflectivity=0.05))[0, 0, 0]
    return ((dbm(power_w(found)), dbm(TRANSMIT_W * 0.05 * _friis(0.08))),)


_ASIDE = Scene(targets=(Target(position_m=(20.0, 12.0, 0.0)),))


def _coupling(rng: np.random.Generator) -> Sequence[Measured]:
    """What of the neighbour's signal is in a receiver: level and phase."""
    clean = samples(_ASIDE)[0]
    coupled = samples(_ASIDE, Coupling(rx_level=0.01, rx_phase_rad=0.7))[0]
    share = np.mean((coupled[:, 0] - clean[:, 0]) / clean[:, 1])
    return (float(2 * decibels(abs(share))), -20.0), (float(np.angle(share)), 0.7)


_OFF_M = 1e-4


def _position_errors(rng: np.random.Generator) -> Sequence[Measured]:
    """Phase of a receiver that is too far to the left, of an echo from 31 degrees there."""
    moved = PositionErrors(rx_m=((0.0, 0.0, 0.0), (0.0, _OFF_M, 0.0)))
    ratio = samples(_ASIDE, moved)[0, :, 1] / samples(_ASIDE)[0, :, 1]
    sine = 12.0 / np.hypot(20.0, 12.0)
    formula = -2 * np.pi * _OFF_M * sine * mid_window_hz() / SPEED_OF_LIGHT
    return ((float(np.angle(ratio.mean())), formula),)


_HEIGHT_M, _TARGET_HEIGHT_M = 0.5, 0.9


def _ground(rng: np.random.Generator) -> Sequence[Measured]:
    """Strongest and weakest echo over free space, of places between 45 m and 70 m."""
    by = replace(radar(1), array=Array())
    road = Ground(height_m=_HEIGHT_M, permittivity=4.0)
    found, formula = [], []
    for ahead_m in np.linspace(45.0, 70.0, 26):
        at = (float(ahead_m), 0.0, _TARGET_HEIGHT_M - _HEIGHT_M)
        scene = Scene(targets=(Target(position_m=at),))
        ratio = samples(scene, road, by=by)[0, 0, 0] / samples(scene, by=by)[0, 0, 0]
        found.append(decibels(abs(ratio) ** 2))
        direct_m = np.hypot(ahead_m, _HEIGHT_M - _TARGET_HEIGHT_M)
        off_m = np.hypot(ahead_m, _HEIGHT_M + _TARGET_HEIGHT_M)
        sine, cosine = (_HEIGHT_M + _TARGET_HEIGHT_M) / off_m, ahead_m / off_m
        root = np.sqrt(4.0 - cosine**2)
        gamma = (4.0 * sine - root) / (4.0 * sine + root)
        sent_hz = 77e9 + SLOPE_HZ_PER_S * (times_s() - 2 * direct_m / SPEED_OF_LIGHT)
        turn = np.exp(-2j * np.pi * sent_hz * (off_m - direct_m) / SPEED_OF_LIGHT)
        formula.append(decibels(abs(1 + gamma * turn) ** 4))
    return (
        (float(np.max(found)), float(np.max(formula))),
        (float(np.min(found)), float(np.min(formula))),
    )


_REFLECTIVITY = 0.25


def _wall(rng: np.random.Generator) -> Sequence[Measured]:
    """Ghosts of a target beside a wall, over its echo: one way off the wall, and both."""
    by = replace(radar(1), array=Array())
    scene = Scene(targets=(Target(position_m=(20.0, -3.0, 0.0)),))
    wall = Wall(start_m=(-10.0, 6.0), end_m=(60.0, 6.0), reflectivity=_REFLECTIVITY)
    echo = samples(scene, by=by)[0, 0, 0]
    ghosts = samples(scene, wall, by=by)[0, 0, 0] - echo
    direct_m, image_m = np.hypot(20.0, 3.0), np.hypot(20.0, 15.0)
    one_way = 2 * np.sqrt(_REFLECTIVITY) * direct_m / image_m  # there, and back
    both = _REFLECTIVITY * (direct_m / image_m) ** 2
    return [
        (float(decibels(tone_w(ghosts, beat_hz(at_m)) / power_w(echo))), float(2 * decibels(size)))
        for at_m, size in (((direct_m + image_m) / 2, one_way), (image_m, both))
    ]


_FAR_M, _OTHER_W, _OTHER_GAIN = 40.0, 0.01, 4.0


def _other(slope_hz_per_s: float, *, offset_s: float = 0.0) -> Interferer:
    """A radar ahead whose ramps cross those of the radar in their middle."""
    return Interferer(
        start_frequency_hz=77e9 + (SLOPE_HZ_PER_S - slope_hz_per_s) * 15e-6,
        slope_hz_per_s=slope_hz_per_s,
        ramp_duration_s=30e-6,
        interval_s=35e-6,
        coherent=True,
        transmit_power_w=_OTHER_W,
        antenna_gain=_OTHER_GAIN,
        position_m=(_FAR_M, 0.0, 0.0),
        offset_s=offset_s,
    )


def _interference(rng: np.random.Generator) -> Sequence[Measured]:
    """Power by Friis of ramps in parallel, and how long a burst of crossing ones lasts."""
    # Sent early, so that it beats in the middle of the band.
    early_s = _FAR_M / SPEED_OF_LIGHT - 5e6 / SLOPE_HZ_PER_S
    ghost = samples(NOTHING, Interference(interferers=(_other(20e12, offset_s=-early_s),)))
    friis_w = _OTHER_W * _friis(_FAR_M) * _OTHER_GAIN / GAIN
    burst = abs(samples(NOTHING, Interference(interferers=(_other(19e12),)))[0, :, 0]) ** 2
    is_on = burst > burst.max() / 2
    lasted_s = float(is_on.sum(axis=1).mean()) / RATE_HZ
    return (
        (dbm(power_w(ghost)), dbm(friis_w)),
        (lasted_s, RATE_HZ / abs(SLOPE_HZ_PER_S - 19e12)),
    )


MEASUREMENTS = (
    Measurement(
        kind="leakage",
        claim="Leakage has the power that the isolation leaves, and beats with its length.",
        quantities=(
            Quantity(name="power over that sent", unit="dB", within=0.01),
            Quantity(name="beat frequency of 3 m", unit="Hz", within=1.0),
        ),
        measure=_leakage,
    ),
    Measurement(
        kind="bumper",
        claim="A bumper reflects by Friis over the way to the image of the antenna.",
        quantities=(Quantity(name="power received", unit="dBm", within=0.01),),
        measure=_bumper,
    ),
    Measurement(
        kind="coupling",
        claim="A receiver holds the signal of its neighbour at the level and phase of the matrix.",
        quantities=(
            Quantity(name="level of the neighbour", unit="dB", within=0.01),
            Quantity(name="its phase", unit="rad", within=0.001),
        ),
        measure=_coupling,
    ),
    Measurement(
        kind="position-errors",
        claim="An antenna out of place by e turns the phase by 2π e u / λ.",
        quantities=(Quantity(name="0.1 mm across, 31 degrees aside", unit="rad", within=0.001),),
        measure=_position_errors,
    ),
    Measurement(
        kind="ground",
        claim="Over a road an echo varies by the two-way factor of two rays, with Fresnel's"
        " coefficient.",
        quantities=(
            Quantity(name="strongest over free space, 45 to 70 m", unit="dB", within=0.05),
            Quantity(name="weakest", unit="dB", within=0.3),
        ),
        measure=_ground,
    ),
    Measurement(
        kind="wall",
        claim="A wall makes ghosts at the image of a target and halfway to it, by the radar"
        " equation.",
        quantities=(
            Quantity(name="one way off the wall, over the echo", unit="dB", within=0.02),
            Quantity(name="both ways off the wall, over the echo", unit="dB", within=0.02),
        ),
        measure=_wall,
    ),
    Measurement(
        kind="interference",
        claim="Another radar is received by Friis, one way, and its burst lasts the passband over"
        " the difference of the slopes.",
        quantities=(
            Quantity(name="parallel ramps, 40 m ahead", unit="dBm", within=0.05),
            Quantity(name="crossing ramps: duration of a burst", unit="s", within=0.15e-6),
        ),
        measure=_interference,
    ),
)
