"""Scene geometry against 50 digits: pose, turn rate, acceleration, wheels and several frames.

The reference transforms the antennas into scene axes instead of the scene into radar axes, and
uses no polynomials.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from mpmath import mpf

import dechirp as dc
from nightly import nightly_except

C = mpf(299792458)


def rotate(axis, angle, vector):
    """Rotate a vector right-handed about an axis (Rodrigues)."""
    size = mpmath.sqrt(sum(mpf(a) ** 2 for a in axis))
    k, v = [mpf(a) / size for a in axis], [mpf(x) for x in vector]
    cross = [
        k[1] * v[2] - k[2] * v[1],
        k[2] * v[0] - k[0] * v[2],
        k[0] * v[1] - k[1] * v[0],
    ]
    projection = sum(a * b for a, b in zip(k, v, strict=True))
    c, s = mpmath.cos(angle), mpmath.sin(angle)
    return [v[i] * c + cross[i] * s + k[i] * projection * (1 - c) for i in range(3)]


def compute_displacement(ego, t):
    """Compute the displacement of the radar, whose velocity turns with it."""
    z, rate = (0, 0, 1), mpf(ego.turn_rate_rad_per_s)
    return [
        mpmath.quad(lambda s, i=i: rotate(z, rate * s, ego.velocity_m_per_s)[i], [0, t])
        for i in range(3)
    ]


def locate_antenna(ego, at_m, t, displacement):
    """Compute the position of an antenna of a turning radar in the scene."""
    position = rotate((1, 0, 0), mpf(ego.roll_rad), at_m)
    position = rotate((0, -1, 0), mpf(ego.pitch_rad), position)
    position = rotate((0, 0, 1), mpf(ego.yaw_rad) + mpf(ego.turn_rate_rad_per_s) * t, position)
    return [a + mpf(p) + w for a, p, w in zip(position, ego.position_m, displacement, strict=True)]


def locate_scatterer(target, point, t):
    """Compute the position of a point of a target in the scene."""
    position = [
        mpf(p) + mpf(v) * t + mpf(a) * t**2 / 2
        for p, v, a in zip(
            target.position_m, target.velocity_m_per_s, target.acceleration_m_per_s2, strict=True
        )
    ]
    if point is None:
        return position
    body_position = [mpf(x) for x in point.position_m]
    if point.rotation is not None:
        centre = [mpf(x) for x in point.rotation.center_m]
        arm = [a - b for a, b in zip(body_position, centre, strict=True)]
        arm = rotate(point.rotation.axis, mpf(point.rotation.rate_rad_per_s) * t, arm)
        body_position = [a + b for a, b in zip(centre, arm, strict=True)]
    if point.oscillation is not None:
        swing = point.oscillation
        sine = mpmath.sin(2 * mpmath.pi * mpf(swing.frequency_hz) * t + mpf(swing.phase_rad))
        body_position = [
            a + mpf(b) * sine for a, b in zip(body_position, swing.amplitude_m, strict=True)
        ]
    rotated = rotate((0, 0, 1), mpf(target.heading_rad), body_position)
    return [a + b for a, b in zip(position, rotated, strict=True)]


def compute_sample(scene, radar, frame_index, m, rx, n):
    """Compute one sample of the cube in 50 digits."""
    with mpmath.workdps(50):
        frame, chirp = radar.frame, radar.frame.chirp
        ramp_time = mpf(chirp.adc_start_s) + n / mpf(chirp.sample_rate_hz)
        t = frame_index * mpf(frame.period_s) + m * mpf(frame.interval_s) + ramp_time
        f0, slope = mpf(chirp.start_frequency_hz), mpf(chirp.slope_hz_per_s)
        window = mpf(chirp.adc_start_s) + chirp.n_samples / mpf(chirp.sample_rate_hz) / 2
        wavelength = C / (f0 + slope * window)
        h, total = radar.hardware, mpmath.mpc(0)
        displacement = compute_displacement(scene.ego, t)
        receiver = locate_antenna(scene.ego, radar.array.rx_m[rx], t, displacement)
        for target in scene.targets:
            points = [None] if target.body is None else target.body.scatterers
            for point in points:
                rcs = target.rcs_m2 if point is None else point.rcs_m2
                position = locate_scatterer(target, point, t)
                for weight, tx_m in zip(frame.chirp_weights()[m], radar.array.tx_m, strict=True):
                    tx_distance, rx_distance = (
                        mpmath.sqrt(
                            sum((a - b) ** 2 for a, b in zip(position, antenna, strict=True))
                        )
                        for antenna in (locate_antenna(scene.ego, tx_m, t, displacement), receiver)
                    )
                    tau = (tx_distance + rx_distance) / C
                    cycles = f0 * tau + slope * tau * ramp_time - slope * tau**2 / 2
                    power = mpf(h.transmit_power_w) * (mpf(h.antenna_gain) * wavelength) ** 2
                    power *= mpf(rcs) / (
                        (4 * mpmath.pi) ** 3 * (tx_distance * rx_distance) ** 2 * mpf(h.loss)
                    )
                    total += (
                        mpmath.mpc(complex(weight))
                        * mpmath.sqrt(power)
                        * mpmath.expjpi(2 * (cycles - mpmath.floor(cycles)))
                    )
        return complex(total)


WHEEL = [
    dc.bodies.Scatterer(
        position_m=(1.2, 0.8, 0.6),
        rcs_m2=0.1,
        rotation=dc.bodies.Rotation(center_m=(1.2, 0.8, 0.3), rate_rad_per_s=60.0),
    ),
    dc.bodies.Scatterer(
        position_m=(0.0, 0.0, 1.0),
        rcs_m2=0.5,
        oscillation=dc.bodies.Oscillation(
            amplitude_m=(0.1, 0.02, 0.3), frequency_hz=7.0, phase_rad=0.4
        ),
    ),
    dc.bodies.Scatterer(position_m=(-1.5, -0.7, 0.5), rcs_m2=1.0),
]


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("multiplexing", nightly_except(1, ["tdm", "bpm", "phase-code"]))
def test_scene_with_every_kind_of_motion_matches_fifty_digits(radar, multiplexing):
    codes = {
        "tdm": dc.multiplexing.Tdm(order=(1, 0)),
        "bpm": dc.multiplexing.Bpm(order=(1, 0)),
        "phase-code": dc.multiplexing.PhaseCode(phases_rad=[[0.0, 0.3], [1.0, -2.0], [2.5, 0.1]]),
    }
    frame = replace(radar.frame, multiplexing=codes[multiplexing], n_chirps=40, period_s=0.02)
    array = replace(radar.array, tx_m=[(0.0, 0.05, 0.0), (0.001, -0.03, 0.02)])
    radar = replace(radar, frame=frame, array=array)
    ego = dc.Ego(
        position_m=(3.0, -2.0, 0.6),
        yaw_rad=0.4,
        pitch_rad=0.05,
        roll_rad=-0.1,
        velocity_m_per_s=(8.0, 3.0, 0.1),
        turn_rate_rad_per_s=0.9,
    )
    targets = [
        dc.Target(
            position_m=(12.0, 4.0, 1.0),
            velocity_m_per_s=(-9.0, 5.0, 0.2),
            acceleration_m_per_s2=(4.0, -6.0, 1.0),
            rcs_m2=0.3,
        ),
        dc.Target(
            position_m=(14.0, -1.0, 0.0),
            velocity_m_per_s=(10.0, 2.0, 0.0),
            heading_rad=0.2,
            body=dc.bodies.Points(scatterers=WHEEL),
        ),
    ]
    scene = dc.Scene(targets=targets, ego=ego)
    cube = dc.simulate(scene, radar, impairments=(), n_frames=2, dtype=np.complex128).values

    # Echoes are summed, so errors are relative to the largest sample.
    size = abs(cube).max()
    rng = np.random.default_rng(11)
    for _ in range(10):
        index = tuple(int(rng.integers(length)) for length in cube.shape)
        assert abs(cube[index] - compute_sample(scene, radar, *index)) <= 1e-9 * size
