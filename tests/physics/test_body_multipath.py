"""Ghosts by reflection off the sides of bodies, against paths via moving mirrors.

The reference mirrors antennas in the moving side, in scene coordinates, at the time of each sample.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.foliage import Foliage
from dechirp.scene.bodies.guard_rail import GuardRail
from dechirp.scene.bodies.vehicle import Truck
from dechirp.scene.bodies.wall import Wall
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.body_multipath import BodyMultipath

SPEED_OF_LIGHT_M_PER_S = 299_792_458.0
CONCRETE = Wall(length_m=14.0, width_m=2.5, height_m=4.0)
BOX = replace(CONCRETE, reflectivity=1.0, scattering=1e-3)  # like metal


@pytest.fixture
def mimo(radar) -> dc.Radar:
    array = dc.Array(tx_m=[(0, 0, 0), (0, 0.0078, 0)], rx_m=[(0, 0.002, 0), (0, 0.004, 0)])
    frame = replace(radar.frame, n_chirps=64, multiplexing=dc.multiplexing.Tdm(order=(0, 1)))
    return replace(radar, frame=frame, array=array)


def ghost_samples(scene, radar, impairment, n_frames=1):
    """Return the samples that the impairment adds."""
    with_ghosts, without = (
        dc.simulate(scene, radar, impairments=chosen, dtype=np.complex128, n_frames=n_frames)
        for chosen in ([impairment], [])
    )
    return with_ghosts.values[-1] - without.values[-1]


def turn_about_z(angle_rad):
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def image_in_right_side_m(box, point_m, t):
    """Return the image of a point in the right side of a box at a time."""
    heading = box.heading_rad + box.turn_rate_rad_per_s * t
    outwards = turn_about_z(heading) @ [0.0, -1.0, 0.0]
    centre_m = np.add(box.position_m, np.multiply(t, box.velocity_m_per_s))
    on_side_m = centre_m + outwards * box.body.width_m / 2
    return point_m - 2 * ((point_m - on_side_m) @ outwards) * outwards


def one_way_lengths_m(scene, t, antenna_m=(0.0, 0.0, 0.0)):
    """Return the direct length to the last target, and that via the first."""
    box, target, ego = scene.targets[0], scene.targets[-1], scene.ego
    radar_m = ego.displacements_m(np.array([t]))[0]
    antenna_m = radar_m + turn_about_z(ego.turn_rate_rad_per_s * t) @ np.array(antenna_m)
    target_m = np.add(target.position_m, np.multiply(t, target.velocity_m_per_s))
    image_m = image_in_right_side_m(box, antenna_m, t)
    return np.linalg.norm(target_m - antenna_m), np.linalg.norm(target_m - image_m)


def ghost_beat_sample(scene, radar, m, n, rx, coefficient):
    """Return one sample of the three ghosts."""
    chirp, hardware, target = radar.frame.chirp, radar.hardware, scene.targets[-1]
    fast_time_s = chirp.adc_start_s + n / chirp.sample_rate_hz
    t = m * radar.frame.interval_s + fast_time_s
    out_m, in_m = (
        one_way_lengths_m(scene, t, antenna_m)
        for antenna_m in (radar.array.tx_m[m % 2], radar.array.rx_m[rx])
    )
    total = 0
    for i, j in ((0, 1), (1, 0), (1, 1)):
        tau = (out_m[i] + in_m[j]) / SPEED_OF_LIGHT_M_PER_S
        cycles = chirp.start_frequency_hz * tau
        cycles += chirp.slope_hz_per_s * (tau * fast_time_s - tau**2 / 2)
        power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * target.rcs_m2
        power_w *= chirp.wavelength_m**2 / ((4 * np.pi) ** 3 * (out_m[i] * in_m[j]) ** 2)
        total += coefficient ** (i + j) * np.sqrt(power_w) * np.exp(2j * np.pi * cycles)
    return total


def make_scene(box_velocity=(20.0, 0.0, 0.0), turn_rate=0.0, ego_turn_rate=0.0, target_y_m=-2.0):
    """Return a truck-like box on the left, and a target beyond its front on the right."""
    return dc.Scene(
        targets=[
            dc.Target(
                name="truck",
                position_m=(12.0, 5.0, -0.5),
                velocity_m_per_s=box_velocity,
                heading_rad=0.05,
                turn_rate_rad_per_s=turn_rate,
                body=BOX,
            ),
            dc.Target(
                name="car",
                position_m=(24.0, target_y_m, 0.3),
                velocity_m_per_s=(16.0, 0.5, 0.0),
                rcs_m2=3.0,
            ),
        ],
        ego=dc.Ego(velocity_m_per_s=(22.0, 0.0, 0.0), turn_rate_rad_per_s=ego_turn_rate),
        shadowing=False,
    )


@pytest.mark.parametrize(
    ("motion", "tolerance"),
    [
        ({"box_velocity": (22.0, 0.0, 0.0)}, 1e-3),
        ({"box_velocity": (18.0, -2.0, 0.0)}, 2e-3),
        ({"box_velocity": (18.0, 1.5, 0.0), "turn_rate": 0.2}, 1e-2),
        ({"ego_turn_rate": 0.25}, 1e-2),
    ],
    ids=["alongside", "changing lanes", "turning truck", "turning radar"],
)
def test_ghosts_match_paths_via_moving_side(mimo, motion, tolerance):
    scene = make_scene(**motion)
    signals = ghost_samples(scene, mimo, BodyMultipath())

    # The image of an array turns with the mirror, by twice 0.25 rad/s * 1.2 ms = 6e-4 rad in half a
    # frame; over antennas of 8 mm this is 5 um, a phase of 0.008 rad.
    rng = np.random.default_rng(4)
    largest = abs(signals).max()
    for m, n, rx in zip(
        rng.integers(128, size=10), rng.integers(256, size=10), [0, 1] * 5, strict=True
    ):
        # Fresnel's coefficient of metal at the angle of this path, within 1e-3 of -1.
        expected = ghost_beat_sample(scene, mimo, int(m), int(n), rx, -0.9995)
        assert abs(signals[m, rx, n] - expected) < tolerance * largest


def test_ghosts_have_half_the_sum_of_the_legs_and_its_derivative(mimo):
    scene = make_scene(box_velocity=(18.0, -2.0, 0.0))
    ghosts = BodyMultipath().ghosts(scene, mimo)

    t, step_s = mimo.frame.mid_frame_s, 1e-3
    direct_m, via_m = one_way_lengths_m(scene, t)
    rates = np.subtract(
        one_way_lengths_m(scene, t + step_s), one_way_lengths_m(scene, t - step_s)
    ) / (2 * step_s)
    assert ghosts["order"].values.tolist() == ["outbound", "inbound", "both"]
    assert set(ghosts["target"].values) == {"car"} and set(ghosts["mirror"].values) == {"truck"}
    assert ghosts["range"].values == pytest.approx([(direct_m + via_m) / 2] * 2 + [via_m], rel=1e-9)
    assert ghosts["velocity"].values == pytest.approx([rates.mean()] * 2 + [rates[1]], abs=1e-5)
    radar_m = np.array([22.0 * t, 0.0, 0.0])
    target_m = np.array([24.0 + 16.0 * t, -2.0 + 0.5 * t, 0.3])
    arrivals = [
        np.arctan2(*(point_m - radar_m)[1::-1])
        for point_m in (target_m, image_in_right_side_m(scene.targets[0], target_m, t))
    ]
    assert ghosts["azimuth"].values == pytest.approx([arrivals[0], *[arrivals[1]] * 2], rel=1e-9)


def test_ghosts_are_detected_at_their_range_velocity_and_angle(mimo):
    scene = make_scene(box_velocity=(18.0, -2.0, 0.0))
    impairments = [BodyMultipath(), dc.impairments.ThermalNoise()]
    detections = dc.detect(dc.simulate(scene, mimo, impairments=impairments, seed=2), mimo)
    ghosts = BodyMultipath().ghosts(scene, mimo)

    # Outbound and inbound ghosts share a cell, and their angles with it.
    for ghost in (0, 2):
        expected = ghosts.isel(ghost=ghost)
        errors_m = abs(detections["range"].values - float(expected["range"]))
        nearest = detections.isel(detection=int(errors_m.argmin()))
        assert float(nearest["range"]) == pytest.approx(float(expected["range"]), abs=0.05)
        assert float(nearest["velocity"]) == pytest.approx(float(expected["velocity"]), abs=0.05)


@pytest.mark.parametrize(
    ("position_m", "exists"),
    [
        ((24.0, -2.0, 0.3), True),
        ((62.0, 2.0, 0.3), False),  # reflected beyond the front of the box
        ((24.0, 8.0, 0.3), False),  # behind the side
        ((24.0, -2.0, 12.0), False),  # reflected above the upper edge, 3.5 m above the radar
    ],
)
def test_plate_reflects_only_within_its_extent(mimo, position_m, exists):
    scene = make_scene(box_velocity=(22.0, 0.0, 0.0))
    scene = replace(
        scene, targets=(scene.targets[0], replace(scene.targets[1], position_m=position_m))
    )

    assert bool(abs(ghost_samples(scene, mimo, BodyMultipath())).max() > 0) == exists
    assert bool(BodyMultipath().ghosts(scene, mimo).sizes["ghost"]) == exists


def test_power_is_that_of_radar_equation_and_fresnel(radar):
    # One antenna: outbound and inbound ghosts are equal and add; the third is apart by 1 m.
    radar = replace(radar, frame=replace(radar.frame, n_chirps=1), array=dc.Array())
    scene = make_scene(box_velocity=(0.0, 0.0, 0.0))
    scene = replace(
        scene,
        ego=dc.Ego(),
        targets=tuple(replace(item, velocity_m_per_s=(0.0, 0.0, 0.0)) for item in scene.targets),
    )
    scene = replace(scene, targets=(replace(scene.targets[0], body=CONCRETE), *scene.targets[1:]))
    direct_m, via_m = one_way_lengths_m(scene, 0.0)
    outwards = turn_about_z(0.05) @ [0.0, -1.0, 0.0]
    image_m = image_in_right_side_m(scene.targets[0], np.zeros(3), 0.0)
    cosine = abs((np.array([24.0, -2.0, 0.3]) - image_m) @ outwards) / via_m
    amplitude = math.sqrt(CONCRETE.reflectivity * (1 - CONCRETE.scattering**2))
    permittivity = ((1 + amplitude) / (1 - amplitude)) ** 2
    root = math.sqrt(permittivity - 1 + cosine**2)
    gamma2 = ((cosine - root) / (cosine + root)) ** 2 / 2.0

    samples = ghost_samples(scene, radar, BodyMultipath(loss=2.0))[0, 0]

    hardware = radar.hardware
    unit_w = hardware.transmit_power_w * hardware.antenna_gain**2 * 3.0
    unit_w *= radar.frame.chirp.wavelength_m**2 / (4 * np.pi) ** 3
    mixed_w, both_w = 4 * unit_w * gamma2 / (direct_m * via_m) ** 2, unit_w * gamma2**2 / via_m**4
    chirp = radar.frame.chirp
    times_s = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    tones = []
    for length_m in (direct_m + via_m, 2 * via_m):
        tau = length_m / SPEED_OF_LIGHT_M_PER_S
        phase = chirp.start_frequency_hz * tau
        phase += chirp.slope_hz_per_s * (tau * times_s - tau**2 / 2)
        tones.append(np.exp(2j * np.pi * phase))
    amplitudes, *_ = np.linalg.lstsq(np.stack(tones, axis=1), samples, rcond=None)
    assert abs(amplitudes) ** 2 == pytest.approx([mixed_w, both_w], rel=1e-6)


@pytest.mark.parametrize(
    ("body", "is_mirror"),
    [
        (Foliage(length_m=14.0, width_m=2.5), False),
        (dc.bodies.Pole(radius_m=3.0), False),
        (Truck(), True),
    ],
)
def test_only_flat_sides_are_mirrors(mimo, body, is_mirror):
    scene = make_scene(box_velocity=(22.0, 0.0, 0.0))
    scene = replace(scene, targets=(replace(scene.targets[0], body=body), scene.targets[1]))

    assert bool(abs(ghost_samples(scene, mimo, BodyMultipath())).max() > 0) == is_mirror
    assert bool(BodyMultipath().ghosts(scene, mimo).sizes["ghost"]) == is_mirror


# The second box hides truck and rail.
@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_truck_and_rail_mirror_a_car_and_shadows_apply(mimo):
    rail = dc.Target(
        name="rail", position_m=(30.5, -5.0, -0.5), heading_rad=0.0, body=GuardRail(length_m=60.0)
    )
    truck = dc.Target(name="truck", position_m=(16.0, 4.5, -0.5), heading_rad=0.0, body=Truck())
    car = dc.Target(name="car", position_m=(26.0, 0.0, 0.1), rcs_m2=10.0)
    scene = dc.Scene(targets=[rail, truck, car])

    ghosts = BodyMultipath().ghosts(scene, mimo)

    of_car = ghosts["target"].values == "car"
    assert sorted(set(ghosts["mirror"].values[of_car].tolist())) == ["rail", "truck"]
    sides = BodyMultipath(min_length_m=12.5)  # not those of the box that follows
    samples = ghost_samples(scene, mimo, sides)
    assert abs(samples).max() > 0
    # A box between the radar and the sides shadows the paths.
    blocker = dc.Target(
        name="blocker",
        position_m=(4.0, 0.0, -0.5),
        heading_rad=0.0,
        body=Wall(length_m=0.5, width_m=12.0, height_m=5.0, reflectivity=1e-12),
    )
    blocked = ghost_samples(replace(scene, targets=(*scene.targets, blocker)), mimo, sides)
    assert abs(blocked).max() < 0.1 * abs(samples).max()


def test_settings_select_it_by_kind_and_are_checked():
    parsed = parse_settings("{kind: body-multipath, permittivity: 5.24, loss: 3 dB}", Impairment)
    assert parsed == BodyMultipath(permittivity=5.24, loss=10**0.3)
    for settings, message in (
        ({"min_length_m": -1}, "BodyMultipath.min_length_m: -1"),
        ({"permittivity": 0.5}, "BodyMultipath.permittivity: 0.5"),
        ({"loss": 0.5}, "BodyMultipath.loss: 0.5"),
    ):
        with pytest.raises(dc.InvalidSetting, match=message):
            BodyMultipath(**settings)
