"""Echoes by way of the road and of walls, and antennas out of place.

The witness for walls knows of no images: it looks for the shortest way over points of the
wall, in coordinates of the scene, for each antenna at each sample.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings
from dechirp.radar.patterns.cosine import CosinePattern
from dechirp.scene.bodies.points import Oscillation, Points, Scatterer
from dechirp.simulation.echo_groups import direct_echo_groups, sample_window
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.position_errors import PositionErrors
from dechirp.simulation.impairments.two_ray_ground import TwoRayGround, fresnel_coefficients
from dechirp.simulation.impairments.wall_multipath import WallMultipath
from dechirp.simulation.mirror_images import mid_run_time_s

LIGHT = 299_792_458.0


def samples(scene, radar, *impairments, **of):
    made = dc.simulate(scene, radar, impairments=impairments, dtype=np.complex128, **of)
    return made.values[0]


def single(radar):
    """One chirp, one receiver at the origin."""
    return replace(radar, frame=replace(radar.frame, n_chirps=1), array=dc.Array())


@pytest.fixture
def mimo(radar) -> dc.Radar:
    """Two transmitters in turn, two receivers, none where another is."""
    array = dc.Array(
        tx_m=[(0, -0.004, 0.001), (0, 0.0078, 0)], rx_m=[(0, 0.02, 0), (0.001, 0.0219, 0.002)]
    )
    frame = replace(radar.frame, n_chirps=64, multiplexing=dc.multiplexing.Tdm(order=(1, 0)))
    return replace(radar, frame=frame, array=array)


# Two rays.


@pytest.mark.parametrize("polarisation", ["vertical", "horizontal"])
@pytest.mark.parametrize("roughness_m", [0.0, 3e-3])
def test_over_a_road_echoes_vary_by_the_two_way_factor(radar, polarisation, roughness_m):
    radar, h1, h2 = single(radar), 0.5, 0.9
    ground = TwoRayGround(
        height_m=h1, permittivity=4.0, polarisation=polarisation, roughness_m=roughness_m
    )
    chirp = radar.frame.chirp
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    least, most = np.inf, 0.0
    for ground_m in np.linspace(45, 70, 11):
        scene = dc.Scene(targets=[dc.Target(position_m=(ground_m, 0, h2 - h1))])
        ratio = abs(samples(scene, radar, ground) / samples(scene, radar))[0, 0] ** 2

        direct_m, off_m = np.hypot(ground_m, h1 - h2), np.hypot(ground_m, h1 + h2)
        sine, cosine = (h1 + h2) / off_m, ground_m / off_m
        root = np.sqrt(4.0 - cosine**2)
        front = 4.0 * sine if polarisation == "vertical" else sine
        gamma = (front - root) / (front + root)
        wavenumber = 2 * np.pi * chirp.mid_window_frequency_hz / LIGHT
        gamma *= np.exp(-2 * (wavenumber * roughness_m * sine) ** 2)
        # Each sample is of the frequency that was sent when its echo left.
        sent_s = t - 2 * direct_m / LIGHT
        k = 2 * np.pi * (chirp.start_frequency_hz + chirp.slope_hz_per_s * sent_s) / LIGHT
        factor = abs(1 + gamma * np.exp(-1j * k * (off_m - direct_m))) ** 4
        # The formula leaves out that the way off the road is longer: 0.02 dB in nulls.
        assert 10 * np.log10(ratio / factor) == pytest.approx(np.zeros(len(t)), abs=0.1)
        least, most = min(least, ratio.min()), max(most, ratio.max())
    # Nearly 12 dB up, and down by far more than that.
    assert 10 * np.log10(most) > 10
    assert 10 * np.log10(least) < -12


def test_the_reflection_of_a_dielectric_is_fresnels():
    brewster = np.arctan(1 / np.sqrt(5.24))  # of grazing
    vertical = fresnel_coefficients(
        np.sin([0.0, brewster - 0.1, brewster, np.pi / 2]), 5.24, "vertical"
    )
    assert vertical[0] == -1
    assert vertical[1] < 0
    assert vertical[2] == pytest.approx(0, abs=1e-12)
    index = np.sqrt(5.24)
    assert vertical[3] == pytest.approx((index - 1) / (index + 1))
    horizontal = fresnel_coefficients(np.array([0.0, 1.0]), 5.24, "horizontal")
    assert horizontal == pytest.approx([-1, -(index - 1) / (index + 1)])


def test_a_radar_that_pitches_yaws_and_turns_sees_the_same_road(radar):
    radar, ground = single(radar), TwoRayGround(height_m=0.6, permittivity=5.0)
    target = dc.Target(position_m=(30, 4, 0.2))
    level = dc.Scene(targets=[target])
    tilted = dc.Ego(pitch_rad=0.2, roll_rad=-0.1, yaw_rad=0.3, turn_rate_rad_per_s=0.5)
    seen = samples(replace(level, ego=tilted), radar, ground)

    np.testing.assert_allclose(seen, samples(level, radar, ground), atol=1e-8 * abs(seen).max())


def test_what_is_below_the_road_by_a_little_is_not_mirrored(radar):
    radar = single(radar)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, -0.55))])
    np.testing.assert_array_equal(
        samples(scene, radar, TwoRayGround(height_m=0.5)), samples(scene, radar)
    )


# Walls.


def shortest_m(wall, antenna_m, target_m):
    """The length of the shortest way over a wall; the error is that of the place squared."""
    along = np.subtract(wall.end_m, wall.start_m)
    along /= np.hypot(*along)

    def length_m(where):
        point_m = np.array([*(wall.start_m + where[0] * along), where[1]])
        return np.linalg.norm(point_m - antenna_m) + np.linalg.norm(point_m - target_m)

    options = {"xatol": 1e-9, "fatol": 1e-14, "maxiter": 4000}
    return minimize(length_m, [20.0, 0.0], method="Nelder-Mead", options=options).fun


def beat(scene, radar, wall, m, n, rx):
    """One sample of one target's four echoes, in coordinates of the scene."""
    chirp, hardware, (target,), ego = radar.frame.chirp, radar.hardware, scene.targets, scene.ego
    on_ramp_s = chirp.adc_start_s + n / chirp.sample_rate_hz
    t = m * radar.frame.interval_s + on_ramp_s
    at_m = np.add(target.position_m, np.multiply(t, target.velocity_m_per_s))
    c, s = np.cos(ego.yaw_rad), np.sin(ego.yaw_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    own_m = np.add(ego.position_m, np.multiply(t, ego.velocity_m_per_s))
    tx = radar.frame.tdm_order[m % radar.frame.n_slots]
    tx_m, rx_m = own_m + turn @ radar.array.tx_m[tx], own_m + turn @ radar.array.rx_m[rx]
    straight_m, over_m = (
        [way(antenna_m, at_m) for antenna_m in (tx_m, rx_m)]
        for way in (lambda a_m, b_m: np.linalg.norm(a_m - b_m), partial(shortest_m, wall))
    )
    total = 0
    for out_m, out in ((straight_m[0], 1), (over_m[0], -np.sqrt(wall.reflectivity))):
        for in_m, back in ((straight_m[1], 1), (over_m[1], -np.sqrt(wall.reflectivity))):
            tau = (out_m + in_m) / LIGHT
            cycles = chirp.start_frequency_hz * tau
            cycles += chirp.slope_hz_per_s * (tau * on_ramp_s - tau**2 / 2)
            power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * target.rcs_m2
            power_w *= chirp.wavelength_m**2 / ((4 * np.pi) ** 3 * (out_m * in_m) ** 2)
            total += out * back * np.sqrt(power_w) * np.exp(2j * np.pi * cycles)
    return total


DRIVING = dc.Ego(position_m=(3, -1, 0.5), yaw_rad=0.4, velocity_m_per_s=(24, 7, 0))


@pytest.mark.parametrize(
    ("ego", "wall"),
    [
        (dc.Ego(), WallMultipath(start_m=(0, 4.5), end_m=(60, 6), reflectivity=0.3)),
        # Beside its way; it looks elsewhere.
        (DRIVING, WallMultipath(start_m=(-40, -24), end_m=(80, 11), reflectivity=0.8)),
    ],
    ids=["at rest", "driving along it"],
)
def test_ghosts_off_a_wall_equal_the_shortest_ways_over_it(mimo, ego, wall):
    velocity = np.add(ego.velocity_m_per_s, (-8, 3, 0.5))
    target = dc.Target(position_m=(26, 2, 0.7), velocity_m_per_s=tuple(velocity), rcs_m2=2.0)
    scene = dc.Scene(targets=[target], ego=ego)
    found = samples(scene, mimo, wall)

    rng = np.random.default_rng(3)
    for m, n, rx in zip(
        rng.integers(128, size=8), rng.integers(256, size=8), [0, 1] * 4, strict=True
    ):
        expected = beat(scene, mimo, wall, int(m), int(n), rx)
        # 0.1 um of a way is 1.6e-4 of a phase.
        assert abs(found[m, rx, n] - expected) < 3e-4 * abs(found).max()


def test_a_ghost_stands_at_the_image_and_two_halfway_to_it(mimo):
    mimo = replace(mimo, frame=replace(mimo.frame, n_chirps=128))
    target = dc.Target(position_m=(30, -3, 0), velocity_m_per_s=(-8, -6, 0), rcs_m2=10)
    wall = WallMultipath(start_m=(-10, 6), end_m=(60, 6), reflectivity=0.5)
    image = replace(target, position_m=(30, 15, 0), velocity_m_per_s=(-8, 6, 0))
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, mimo, impairments=[wall, dc.impairments.ThermalNoise()], seed=5)
    found = dc.detect(cube, mimo)

    at = dc.truth(dc.Scene(targets=[target, image]), mimo).isel(frame=0)
    ranges = [*at.range.values, at.range.values.mean()]
    velocities = [*at.velocity.values, at.velocity.values.mean()]
    assert found.sizes["detection"] == 3
    order = np.argsort(found.range.values)
    # The antennas are 2 cm off the origin: less than a tenth of a bin.
    assert found.range.values[order] == pytest.approx(np.sort(ranges), abs=0.03)
    assert found.velocity.values[order] == pytest.approx(
        np.array(velocities)[np.argsort(ranges)], abs=0.04
    )


def test_a_ghost_is_seen_at_the_angles_of_its_two_ways_by_the_radar_equation(mimo):
    # The transmitters look at the target to the right, the receivers at its image to the left.
    target = dc.Target(position_m=(30, -12, 0), rcs_m2=5)
    wall = WallMultipath(start_m=(0, 6), end_m=(60, 6), reflectivity=0.5)
    image_m = np.array([30, 24, 0])
    beams = [
        CosinePattern(
            azimuth_beamwidth_rad=0.1,
            elevation_beamwidth_rad=1.0,
            beam_azimuth_rad=np.arctan2(y, x),
            gain=100.0,
        )
        for x, y in ((30, -12), (30, 24))
    ]
    hardware = replace(mimo.hardware, antenna_gain=None, tx_pattern=beams[0], rx_pattern=beams[1])
    radar = replace(mimo, hardware=hardware, frame=replace(mimo.frame, n_chirps=1))
    found = samples(dc.Scene(targets=[target]), radar, wall)

    there_m, back_m = np.hypot(30, 12), np.hypot(30, 24)
    power_w = hardware.transmit_power_w * 100**2 * 5 * 0.5 * radar.frame.chirp.wavelength_m**2
    power_w /= (4 * np.pi) ** 3 * (there_m * back_m) ** 2
    # Antennas are 2 cm off the origin, 1e-3 of a way.
    assert np.mean(abs(found) ** 2) == pytest.approx(power_w, rel=5e-3)

    def ratio(antennas_m, at_m):
        """Beat of the second antenna over the first, plane waves at mid-band."""
        ways_m = [np.linalg.norm(np.subtract(at_m, one_m)) for one_m in antennas_m]
        return np.exp(2j * np.pi * (ways_m[1] - ways_m[0]) / radar.frame.chirp.wavelength_m)

    over_rx = np.mean(found[:, 1] / found[:, 0])
    assert abs(over_rx - ratio(radar.array.rx_m, image_m)) < 0.01
    # The second transmitter sends first.
    over_tx = np.mean(found[0] / found[1])
    assert abs(over_tx - ratio(radar.array.tx_m, target.position_m)) < 0.01


def test_a_short_wall_mirrors_only_what_reflects_between_its_ends(radar):
    radar = single(radar)
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 0, 0))])
    clean = samples(scene, radar)
    # Off a wall along y = 5 the way there meets it halfway, at x = 15.
    whole = samples(scene, radar, WallMultipath(start_m=(0, 5), end_m=(40, 5)))
    assert abs(whole - clean).max() > 0.5 * abs(clean).max()
    for start, end, reflects in ((14, 16, True), (0, 14.9, False), (15.1, 40, False)):
        short = samples(scene, radar, WallMultipath(start_m=(start, 5), end_m=(end, 5)))
        np.testing.assert_array_equal(short, whole if reflects else clean)


def test_the_end_of_a_wall_comes_by_as_the_radar_drives_on(radar):
    radar = replace(single(radar), frame=replace(single(radar).frame, period_s=0.1))
    # After 0.1 s, 3 m farther, the point of reflection is past the end at 16 m.
    ego = dc.Ego(velocity_m_per_s=(30, 0, 0))
    target = dc.Target(position_m=(30, 0, 0), velocity_m_per_s=(30, 0, 0))
    scene, wall = dc.Scene(targets=[target], ego=ego), WallMultipath(start_m=(0, 5), end_m=(16, 5))
    with_wall, without = (
        dc.simulate(scene, radar, impairments=chosen, n_frames=2, dtype=np.complex128).values
        for chosen in ([wall], ())
    )
    assert abs(with_wall - without)[0].max() > 0.5 * abs(without).max()
    np.testing.assert_array_equal(with_wall[1], without[1])


def test_what_is_behind_a_wall_is_not_mirrored(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 8, 0))])
    wall = WallMultipath(start_m=(0, 5), end_m=(60, 5))
    np.testing.assert_array_equal(samples(scene, radar, wall), samples(scene, radar))


def test_each_of_two_walls_makes_its_ghosts_in_any_order(mimo):
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 1, 0), velocity_m_per_s=(-5, 2, 0))])
    left, right = (
        WallMultipath(start_m=(0, 6), end_m=(60, 6)),
        WallMultipath(start_m=(0, -4), end_m=(60, -4)),
    )
    both = samples(scene, mimo, left, right)
    np.testing.assert_allclose(
        samples(scene, mimo, right, left), both, atol=1e-12 * abs(both).max()
    )


@pytest.mark.parametrize("reverse", [False, True])
def test_ways_go_off_a_wall_and_the_road_too(radar, reverse):
    # With a reflection of -1 off each, legs are from four antennas with signs + - - +.
    h, d, at_m = 0.6, 5.0, np.array([25, 1.0, 0.3])
    target = dc.Target(position_m=tuple(at_m))
    impairments = [
        TwoRayGround(height_m=h, permittivity=1e6, polarisation="horizontal"),
        WallMultipath(start_m=(0, d), end_m=(60, d)),
    ]
    radar = single(radar)
    found = samples(dc.Scene(targets=[target]), radar, *impairments[:: -1 if reverse else 1])

    images_m = np.array([(0, 0, 0), (0, 0, -2 * h), (0, 2 * d, 0), (0, 2 * d, -2 * h)])
    ways_m = np.linalg.norm(at_m - images_m, axis=1)
    chirp = radar.frame.chirp
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    expected = np.zeros(len(t), complex)
    for sign_out, out_m in zip((1, -1, -1, 1), ways_m, strict=True):
        for sign_in, in_m in zip((1, -1, -1, 1), ways_m, strict=True):
            tau = (out_m + in_m) / LIGHT
            cycles = chirp.start_frequency_hz * tau + chirp.slope_hz_per_s * tau * (t - tau / 2)
            expected += sign_out * sign_in / (out_m * in_m) * np.exp(2j * np.pi * cycles)
    hardware = radar.hardware
    power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * chirp.wavelength_m**2
    expected *= np.sqrt(power_w / (4 * np.pi) ** 3)
    # Of this dielectric the coefficient is -1 within 2 sin psi / 1000.
    np.testing.assert_allclose(found[0, 0], expected, atol=2e-3 * abs(expected).max())


@pytest.mark.parametrize("kernel", ["low-rank", "nufft"])
def test_every_kernel_sums_the_images(mimo, kernel):
    rng = np.random.default_rng(9)
    targets = [
        dc.Target(position_m=(x, y, 0.2), velocity_m_per_s=(v, 0, 0))
        for x, y, v in zip(
            rng.uniform(8, 40, 20), rng.uniform(-5, 4, 20), rng.uniform(-9, 9, 20), strict=True
        )
    ]
    scene = dc.Scene(targets=targets)
    impairments = [WallMultipath(start_m=(0, 4.5), end_m=(60, 4.5)), TwoRayGround(height_m=0.5)]
    exact, found = (
        dc.simulate(scene, mimo, impairments=impairments, engine=dc.Engine(kernel=one)).values
        for one in ("direct", kernel)
    )
    error = np.sqrt(np.mean(abs(found - exact) ** 2) / np.mean(abs(exact) ** 2))
    assert error < 1e-5


def test_the_middle_of_a_run_is_that_of_its_samples(radar):
    swing = Oscillation(amplitude_m=(0.3, 0, 0), frequency_hz=400)
    arm = Scatterer(position_m=(0, 0, 0), rcs_m2=1.0, oscillation=swing)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), body=Points(scatterers=(arm,)))])
    kept, chirp = sample_window(radar, 2), radar.frame.chirp
    parts = list(direct_echo_groups(scene, radar, 2, np.random.default_rng(0)))

    assert len(parts) > 1
    for part in parts:
        first_s, last_s = kept.chirp_starts_s[part.chirps][[0, -1]]
        middle_s = (first_s + last_s + chirp.sampled_duration_s) / 2 + chirp.adc_start_s
        if part.chirps.start:
            assert mid_run_time_s(part, kept) == pytest.approx(
                kept.frame_start_s + middle_s, abs=3e-6
            )


# Antennas out of place.

ERRORS = PositionErrors(
    tx_m=[(1e-4, 2e-4, -3e-4), (-2e-4, 0, 1e-4)], rx_m=[(0, 3e-4, 1e-4), (2e-4, -1e-4, 0)]
)
BESIDE = dc.Scene(targets=[dc.Target(position_m=(18, 2, 0.4), velocity_m_per_s=(-6, 1, 0))])


def test_echoes_are_those_of_a_radar_with_its_antennas_out_of_place(mimo):
    moved = replace(
        mimo,
        array=dc.Array(
            tx_m=np.add(mimo.array.tx_m, ERRORS.tx_m), rx_m=np.add(mimo.array.rx_m, ERRORS.rx_m)
        ),
    )
    found = samples(BESIDE, mimo, ERRORS)
    np.testing.assert_allclose(found, samples(BESIDE, moved), atol=1e-12 * abs(found).max())


@pytest.mark.parametrize("place", [0, 1, 2])
def test_images_of_antennas_are_out_of_place_as_mirrored_in_any_order(mimo, place):
    images = [TwoRayGround(height_m=0.5), WallMultipath(start_m=(0, 4.5), end_m=(60, 5.5))]
    moved = replace(
        mimo,
        array=dc.Array(
            tx_m=np.add(mimo.array.tx_m, ERRORS.tx_m), rx_m=np.add(mimo.array.rx_m, ERRORS.rx_m)
        ),
    )
    expected = samples(BESIDE, moved, *images)
    found = samples(BESIDE, mimo, *images[:place], ERRORS, *images[place:])

    # Half a micrometre of grazing height changes the reflection of the road by 1e-4.
    np.testing.assert_allclose(found, expected, atol=1e-3 * abs(expected).max())
    assert abs(found - samples(BESIDE, mimo, *images)).max() > 0.1 * abs(expected).max()


def test_normal_errors_belong_to_their_seed_and_stay_from_frame_to_frame(mimo):
    many = replace(mimo, array=replace(mimo.array, rx_m=[(0, 0.002 * k, 0) for k in range(2000)]))
    tx_m, rx_m = PositionErrors(std_m=1e-4, seed=4).errors_m(many)
    # Of 6,000 numbers: five standard errors.
    assert rx_m.std() == pytest.approx(1e-4, rel=5 / np.sqrt(12000))
    assert tx_m.shape == (2, 3)
    again_m = PositionErrors(std_m=1e-4, seed=4).errors_m(many)[1]
    np.testing.assert_array_equal(again_m, rx_m)
    assert not np.array_equal(PositionErrors(std_m=1e-4, seed=5).errors_m(many)[1], rx_m)

    errors = PositionErrors(std_m=3e-4, seed=1)
    still = dc.Scene(targets=[dc.Target(position_m=(18, 2, 0.4))])
    for seed in (1, 2):
        two = dc.simulate(still, mimo, impairments=[errors], n_frames=2, seed=seed)
        np.testing.assert_allclose(two[1], two[0], atol=1e-6 * abs(two).max().item())


# What cannot be.


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: TwoRayGround(height_m=0), "TwoRayGround.height_m"),
        (lambda: TwoRayGround(height_m=-1), "TwoRayGround.height_m"),
        (lambda: TwoRayGround(height_m=1, permittivity=0.5), "TwoRayGround.permittivity"),
        (lambda: TwoRayGround(height_m=1, roughness_m=-1), "TwoRayGround.roughness_m"),
        (
            lambda: TwoRayGround(height_m=1, polarisation="left"),
            "TwoRayGround.polarisation: 'left'",
        ),
        (
            lambda: WallMultipath(start_m=(1, 2), end_m=(1, 2)),
            "WallMultipath.end_m.* 0 m from start",
        ),
        (
            lambda: WallMultipath(start_m=(1, 2, 3), end_m=(1, 4)),
            "WallMultipath.start_m.* two finite numbers",
        ),
        (lambda: WallMultipath(start_m=(1, float("inf")), end_m=(1, 4)), "WallMultipath.start_m"),
        (
            lambda: WallMultipath(start_m=(1, 0), end_m=(1, 4), reflectivity=1.5),
            "WallMultipath.reflectivity",
        ),
        (lambda: PositionErrors(std_m=1.0), "PositionErrors.std_m"),
        (lambda: PositionErrors(tx_m=[(0, 1, 0)]), "PositionErrors.tx_m"),
    ],
)
def test_a_number_that_cannot_be_is_refused(make, named):
    with pytest.raises(dc.InvalidSetting, match=named):
        make()


AHEAD = dc.Target(name="car", position_m=(30, 0, 0))


@pytest.mark.parametrize(
    ("impairment", "ego", "named"),
    [
        (
            WallMultipath(start_m=(-5, 0), end_m=(5, 0)),
            {},
            "start: a wall whose line passes transmitter 0",
        ),
        (WallMultipath(start_m=(10, 0), end_m=(50, 0.05)), {}, "start: a wall whose line passes"),
        (
            WallMultipath(start_m=(0, 5), end_m=(50, 5)),
            {"turn_rate_rad_per_s": 0.1},
            "scene.ego turning",
        ),
        (
            WallMultipath(start_m=(0, 5), end_m=(50, 6)),
            {"velocity_m_per_s": (20, 0, 0)},
            r"end: .* scene.ego moving at 0.3999 m/s towards .* give \[50.0.* m, 5 m\]",
        ),
        (TwoRayGround(height_m=0.5), {"velocity_m_per_s": (20, 0, 1)}, "scene.ego rising at 1 m/s"),
        (
            TwoRayGround(height_m=0.5),
            {"position_m": (0, 0, 2)},
            "scene.targets.car 1.5 m below the road",
        ),
        (PositionErrors(rx_m=[(0, 0, 0)] * 3), {}, "rx: 3 errors for 2 receivers"),
    ],
)
def test_what_does_not_fit_the_scene_is_refused_by_name(radar, impairment, ego, named):
    scene = dc.Scene(targets=[AHEAD], ego=dc.Ego(**ego))
    with pytest.raises(dc.InvalidSetting, match=named):
        samples(scene, radar, impairment)


def test_an_antenna_below_the_road_is_refused(radar):
    low = replace(radar, array=replace(radar.array, tx_m=[(0, 0, -0.45)]))
    with pytest.raises(dc.InvalidSetting, match="with transmitter 0 0.05 m above the road"):
        samples(dc.Scene(targets=[AHEAD]), low, TwoRayGround(height_m=0.5))


@pytest.mark.parametrize(
    ("text", "made"),
    [
        (
            "{kind: wall-multipath, start: [0 m, 4 m], end: [60 m, 4 m], reflectivity: -20 dB}",
            WallMultipath(start_m=(0, 4), end_m=(60, 4), reflectivity=0.01),
        ),
        (
            "{kind: two-ray-ground, height: 50 cm, roughness: 1 mm, polarisation: horizontal}",
            TwoRayGround(height_m=0.5, roughness_m=1e-3, polarisation="horizontal"),
        ),
        (
            "{kind: position-errors, std: 100 um, rx: [[0, 1 mm, 0]], seed: 3}",
            PositionErrors(std_m=1e-4, rx_m=[(0, 1e-3, 0)], seed=3),
        ),
    ],
)
def test_settings_files_say_them_with_units(text, made):
    assert parse_settings(text, Impairment) == made
    assert parse_settings(dump(made), Impairment) == made
