"""Multipath over road and walls, and antenna position errors.

The reference for walls uses no images: it minimises the path length over points of the wall, in
scene coordinates, for each antenna at each sample.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.radar.patterns.cosine import Cosine
from dechirp.scene.bodies.points import Oscillation, Points, Scatterer
from dechirp.simulation.echo_groups import direct_echo_groups, frame_sampling_times
from dechirp.simulation.impairments.base import Impairment
from dechirp.simulation.impairments.position_errors import PositionErrors
from dechirp.simulation.impairments.two_ray_ground import TwoRayGround, fresnel_coefficients
from dechirp.simulation.impairments.wall_multipath import WallMultipath
from dechirp.simulation.mirror_images import mid_run_time_s

SPEED_OF_LIGHT_M_PER_S = 299_792_458.0


def simulate_samples(scene, radar, *impairments, **options):
    cube = dc.simulate(scene, radar, impairments=impairments, dtype=np.complex128, **options)
    return cube.values[0]


def reduce_to_one_chirp(radar):
    """Reduce the radar to one chirp and one receiver at the origin."""
    return replace(radar, frame=replace(radar.frame, n_chirps=1), array=dc.Array())


@pytest.fixture
def mimo(radar) -> dc.Radar:
    """TDM radar with two transmitters and two receivers at distinct positions."""
    array = dc.Array(
        tx_m=[(0, -0.004, 0.001), (0, 0.0078, 0)], rx_m=[(0, 0.02, 0), (0.001, 0.0219, 0.002)]
    )
    frame = replace(radar.frame, n_chirps=64, multiplexing=dc.multiplexing.Tdm(order=(1, 0)))
    return replace(radar, frame=frame, array=array)


# Two-ray ground reflection.


@pytest.mark.parametrize("polarisation", ["vertical", "horizontal"])
@pytest.mark.parametrize("roughness_m", [0.0, 3e-3])
def test_road_echoes_vary_by_two_way_propagation_factor(radar, polarisation, roughness_m):
    radar, h1, h2 = reduce_to_one_chirp(radar), 0.5, 0.9
    ground = TwoRayGround(
        height_m=h1, permittivity=4.0, polarisation=polarisation, roughness_m=roughness_m
    )
    chirp = radar.frame.chirp
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    min_ratio, max_ratio = np.inf, 0.0
    for ground_m in np.linspace(45, 70, 11):
        scene = dc.Scene(targets=[dc.Target(position_m=(ground_m, 0, h2 - h1))])
        ratio = (
            abs(simulate_samples(scene, radar, ground) / simulate_samples(scene, radar))[0, 0] ** 2
        )

        direct_m, reflected_m = np.hypot(ground_m, h1 - h2), np.hypot(ground_m, h1 + h2)
        sine, cosine = (h1 + h2) / reflected_m, ground_m / reflected_m
        root = np.sqrt(4.0 - cosine**2)
        front = 4.0 * sine if polarisation == "vertical" else sine
        gamma = (front - root) / (front + root)
        wavenumber = 2 * np.pi * chirp.mid_window_frequency_hz / SPEED_OF_LIGHT_M_PER_S
        gamma *= np.exp(-2 * (wavenumber * roughness_m * sine) ** 2)
        # Each sample has the frequency transmitted when its echo left the antenna.
        transmit_time_s = t - 2 * direct_m / SPEED_OF_LIGHT_M_PER_S
        k = (
            2
            * np.pi
            * (chirp.start_frequency_hz + chirp.slope_hz_per_s * transmit_time_s)
            / SPEED_OF_LIGHT_M_PER_S
        )
        factor = abs(1 + gamma * np.exp(-1j * k * (reflected_m - direct_m))) ** 4
        # The formula neglects the greater spreading of the reflected path: 0.02 dB in nulls.
        assert 10 * np.log10(ratio / factor) == pytest.approx(np.zeros(len(t)), abs=0.1)
        min_ratio, max_ratio = min(min_ratio, ratio.min()), max(max_ratio, ratio.max())
    # Constructive interference adds nearly 12 dB; nulls are deeper than that.
    assert 10 * np.log10(max_ratio) > 10
    assert 10 * np.log10(min_ratio) < -12


def test_dielectric_reflection_matches_fresnel():
    brewster = np.arctan(1 / np.sqrt(5.24))  # grazing angle
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


def test_radar_attitude_does_not_change_road_reflection(radar):
    radar, ground = reduce_to_one_chirp(radar), TwoRayGround(height_m=0.6, permittivity=5.0)
    target = dc.Target(position_m=(30, 4, 0.2))
    level_scene = dc.Scene(targets=[target])
    tilted_ego = dc.Ego(pitch_rad=0.2, roll_rad=-0.1, yaw_rad=0.3, turn_rate_rad_per_s=0.5)
    tilted_samples = simulate_samples(replace(level_scene, ego=tilted_ego), radar, ground)

    np.testing.assert_allclose(
        tilted_samples,
        simulate_samples(level_scene, radar, ground),
        atol=1e-8 * abs(tilted_samples).max(),
    )


def test_target_slightly_below_road_is_not_mirrored(radar):
    radar = reduce_to_one_chirp(radar)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, -0.55))])
    np.testing.assert_array_equal(
        simulate_samples(scene, radar, TwoRayGround(height_m=0.5)), simulate_samples(scene, radar)
    )


# Walls.


def find_shortest_path_m(wall, antenna_m, target_m):
    """Find the shortest path length over a wall; its error is quadratic in the point's error."""
    direction = np.subtract(wall.end_m, wall.start_m)
    direction /= np.hypot(*direction)

    def length_m(where):
        point_m = np.array([*(wall.start_m + where[0] * direction), where[1]])
        return np.linalg.norm(point_m - antenna_m) + np.linalg.norm(point_m - target_m)

    options = {"xatol": 1e-9, "fatol": 1e-14, "maxiter": 4000}
    return minimize(length_m, [20.0, 0.0], method="Nelder-Mead", options=options).fun


def compute_beat_sample(scene, radar, wall, m, n, rx):
    """Compute one sample of one target's four echoes in scene coordinates."""
    chirp, hardware, (target,), ego = radar.frame.chirp, radar.hardware, scene.targets, scene.ego
    fast_time_s = chirp.adc_start_s + n / chirp.sample_rate_hz
    t = m * radar.frame.interval_s + fast_time_s
    target_m = np.add(target.position_m, np.multiply(t, target.velocity_m_per_s))
    c, s = np.cos(ego.yaw_rad), np.sin(ego.yaw_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    radar_m = np.add(ego.position_m, np.multiply(t, ego.velocity_m_per_s))
    tx = radar.frame.tdm_order[m % radar.frame.n_slots]
    tx_m, rx_m = radar_m + turn @ radar.array.tx_m[tx], radar_m + turn @ radar.array.rx_m[rx]
    direct_m, wall_m = (
        [path_length_m(antenna_m, target_m) for antenna_m in (tx_m, rx_m)]
        for path_length_m in (
            lambda a_m, b_m: np.linalg.norm(a_m - b_m),
            partial(find_shortest_path_m, wall),
        )
    )
    total = 0
    for out_m, out_sign in ((direct_m[0], 1), (wall_m[0], -np.sqrt(wall.reflectivity))):
        for in_m, in_sign in ((direct_m[1], 1), (wall_m[1], -np.sqrt(wall.reflectivity))):
            tau = (out_m + in_m) / SPEED_OF_LIGHT_M_PER_S
            cycles = chirp.start_frequency_hz * tau
            cycles += chirp.slope_hz_per_s * (tau * fast_time_s - tau**2 / 2)
            power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * target.rcs_m2
            power_w *= chirp.wavelength_m**2 / ((4 * np.pi) ** 3 * (out_m * in_m) ** 2)
            total += out_sign * in_sign * np.sqrt(power_w) * np.exp(2j * np.pi * cycles)
    return total


MOVING_EGO = dc.Ego(position_m=(3, -1, 0.5), yaw_rad=0.4, velocity_m_per_s=(24, 7, 0))


@pytest.mark.parametrize(
    ("ego", "wall"),
    [
        (dc.Ego(), WallMultipath(start_m=(0, 4.5), end_m=(60, 6), reflectivity=0.3)),
        # Parallel to the direction of travel; boresight in another direction.
        (MOVING_EGO, WallMultipath(start_m=(-40, -24), end_m=(80, 11), reflectivity=0.8)),
    ],
    ids=["at rest", "driving along wall"],
)
def test_wall_ghosts_match_shortest_paths_over_wall(mimo, ego, wall):
    velocity = np.add(ego.velocity_m_per_s, (-8, 3, 0.5))
    target = dc.Target(position_m=(26, 2, 0.7), velocity_m_per_s=tuple(velocity), rcs_m2=2.0)
    scene = dc.Scene(targets=[target], ego=ego)
    signals = simulate_samples(scene, mimo, wall)

    rng = np.random.default_rng(3)
    for m, n, rx in zip(
        rng.integers(128, size=8), rng.integers(256, size=8), [0, 1] * 4, strict=True
    ):
        expected = compute_beat_sample(scene, mimo, wall, int(m), int(n), rx)
        # A path error of 0.1 um is a phase error of 1.6e-4 rad.
        assert abs(signals[m, rx, n] - expected) < 3e-4 * abs(signals).max()


def test_wall_ghosts_are_detected_at_image_and_halfway_to_it(mimo):
    mimo = replace(mimo, frame=replace(mimo.frame, n_chirps=128))
    target = dc.Target(position_m=(30, -3, 0), velocity_m_per_s=(-8, -6, 0), rcs_m2=10)
    wall = WallMultipath(start_m=(-10, 6), end_m=(60, 6), reflectivity=0.5)
    image = replace(target, position_m=(30, 15, 0), velocity_m_per_s=(-8, 6, 0))
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, mimo, impairments=[wall, dc.impairments.ThermalNoise()], seed=5)
    detections = dc.detect(cube, mimo)

    ground_truth = dc.truth(dc.Scene(targets=[target, image]), mimo).isel(frame=0)
    ranges = [*ground_truth.range.values, ground_truth.range.values.mean()]
    velocities = [*ground_truth.velocity.values, ground_truth.velocity.values.mean()]
    assert detections.sizes["detection"] == 3
    order = np.argsort(detections.range.values)
    # Antennas 2 cm from the origin shift the range by less than a tenth of a bin.
    assert detections.range.values[order] == pytest.approx(np.sort(ranges), abs=0.03)
    assert detections.velocity.values[order] == pytest.approx(
        np.array(velocities)[np.argsort(ranges)], abs=0.04
    )


def test_wall_ghost_has_angles_and_power_of_its_two_paths(mimo):
    # Transmit beams point at the target on the right, receive beams at its image on the left.
    target = dc.Target(position_m=(30, -12, 0), rcs_m2=5)
    wall = WallMultipath(start_m=(0, 6), end_m=(60, 6), reflectivity=0.5)
    image_m = np.array([30, 24, 0])
    beams = [
        Cosine(
            azimuth_beamwidth_rad=0.1,
            elevation_beamwidth_rad=1.0,
            beam_azimuth_rad=np.arctan2(y, x),
            gain=100.0,
        )
        for x, y in ((30, -12), (30, 24))
    ]
    hardware = replace(mimo.hardware, antenna_gain=None, tx_pattern=beams[0], rx_pattern=beams[1])
    radar = replace(mimo, hardware=hardware, frame=replace(mimo.frame, n_chirps=1))
    signals = simulate_samples(dc.Scene(targets=[target]), radar, wall)

    direct_m, reflected_m = np.hypot(30, 12), np.hypot(30, 24)
    power_w = hardware.transmit_power_w * 100**2 * 5 * 0.5 * radar.frame.chirp.wavelength_m**2
    power_w /= (4 * np.pi) ** 3 * (direct_m * reflected_m) ** 2
    # Antennas are 2 cm from the origin, 1e-3 of the path length.
    assert np.mean(abs(signals) ** 2) == pytest.approx(power_w, rel=5e-3)

    def compute_phase_ratio(antennas_m, at_m):
        """Compute the beat ratio of the second to the first antenna, plane waves at mid-band."""
        paths_m = [np.linalg.norm(np.subtract(at_m, antenna_m)) for antenna_m in antennas_m]
        return np.exp(2j * np.pi * (paths_m[1] - paths_m[0]) / radar.frame.chirp.wavelength_m)

    rx_ratio = np.mean(signals[:, 1] / signals[:, 0])
    assert abs(rx_ratio - compute_phase_ratio(radar.array.rx_m, image_m)) < 0.01
    # The second transmitter has the first slot.
    tx_ratio = np.mean(signals[0] / signals[1])
    assert abs(tx_ratio - compute_phase_ratio(radar.array.tx_m, target.position_m)) < 0.01


def test_finite_wall_reflects_only_between_its_ends(radar):
    radar = reduce_to_one_chirp(radar)
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 0, 0))])
    clean = simulate_samples(scene, radar)
    # Reflection point on a wall along y = 5: halfway, at x = 15.
    full_wall_samples = simulate_samples(scene, radar, WallMultipath(start_m=(0, 5), end_m=(40, 5)))
    assert abs(full_wall_samples - clean).max() > 0.5 * abs(clean).max()
    for start, end, reflects in ((14, 16, True), (0, 14.9, False), (15.1, 40, False)):
        short_wall_samples = simulate_samples(
            scene, radar, WallMultipath(start_m=(start, 5), end_m=(end, 5))
        )
        np.testing.assert_array_equal(short_wall_samples, full_wall_samples if reflects else clean)


def test_wall_reflection_ends_when_radar_passes_wall(radar):
    radar = replace(
        reduce_to_one_chirp(radar), frame=replace(reduce_to_one_chirp(radar).frame, period_s=0.1)
    )
    # After 0.1 s and 3 m, the reflection point is beyond the end of the wall at 16 m.
    ego = dc.Ego(velocity_m_per_s=(30, 0, 0))
    target = dc.Target(position_m=(30, 0, 0), velocity_m_per_s=(30, 0, 0))
    scene, wall = dc.Scene(targets=[target], ego=ego), WallMultipath(start_m=(0, 5), end_m=(16, 5))
    with_wall, without_wall = (
        dc.simulate(scene, radar, impairments=impairments, n_frames=2, dtype=np.complex128).values
        for impairments in ([wall], ())
    )
    assert abs(with_wall - without_wall)[0].max() > 0.5 * abs(without_wall).max()
    np.testing.assert_array_equal(with_wall[1], without_wall[1])


def test_target_behind_wall_is_not_mirrored(radar):
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 8, 0))], shadowing=False)
    wall = WallMultipath(start_m=(0, 5), end_m=(60, 5))
    np.testing.assert_array_equal(
        simulate_samples(scene, radar, wall), simulate_samples(scene, radar)
    )


def test_ghosts_of_two_walls_do_not_depend_on_their_order(mimo):
    scene = dc.Scene(targets=[dc.Target(position_m=(30, 1, 0), velocity_m_per_s=(-5, 2, 0))])
    left_wall, right_wall = (
        WallMultipath(start_m=(0, 6), end_m=(60, 6)),
        WallMultipath(start_m=(0, -4), end_m=(60, -4)),
    )
    expected = simulate_samples(scene, mimo, left_wall, right_wall)
    np.testing.assert_allclose(
        simulate_samples(scene, mimo, right_wall, left_wall),
        expected,
        atol=1e-12 * abs(expected).max(),
    )


@pytest.mark.parametrize("reverse", [False, True])
def test_paths_combine_wall_and_road_reflections(radar, reverse):
    # Reflection coefficients of -1 give four image antennas with signs + - - +.
    h, d, target_m = 0.6, 5.0, np.array([25, 1.0, 0.3])
    target = dc.Target(position_m=tuple(target_m))
    impairments = [
        TwoRayGround(height_m=h, permittivity=1e6, polarisation="horizontal"),
        WallMultipath(start_m=(0, d), end_m=(60, d)),
    ]
    radar = reduce_to_one_chirp(radar)
    signals = simulate_samples(
        dc.Scene(targets=[target]), radar, *impairments[:: -1 if reverse else 1]
    )

    images_m = np.array([(0, 0, 0), (0, 0, -2 * h), (0, 2 * d, 0), (0, 2 * d, -2 * h)])
    paths_m = np.linalg.norm(target_m - images_m, axis=1)
    chirp = radar.frame.chirp
    t = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    expected = np.zeros(len(t), complex)
    for sign_out, out_m in zip((1, -1, -1, 1), paths_m, strict=True):
        for sign_in, in_m in zip((1, -1, -1, 1), paths_m, strict=True):
            tau = (out_m + in_m) / SPEED_OF_LIGHT_M_PER_S
            cycles = chirp.start_frequency_hz * tau + chirp.slope_hz_per_s * tau * (t - tau / 2)
            expected += sign_out * sign_in / (out_m * in_m) * np.exp(2j * np.pi * cycles)
    hardware = radar.hardware
    power_w = hardware.transmit_power_w * hardware.antenna_gain**2 * chirp.wavelength_m**2
    expected *= np.sqrt(power_w / (4 * np.pi) ** 3)
    # The reflection coefficient of this dielectric is -1 within 2 sin psi / 1000.
    np.testing.assert_allclose(signals[0, 0], expected, atol=2e-3 * abs(expected).max())


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
    exact, approximation = (
        dc.simulate(
            scene, mimo, impairments=impairments, engine=dc.Engine(kernel=kernel_name)
        ).values
        for kernel_name in ("direct", kernel)
    )
    error = np.sqrt(np.mean(abs(approximation - exact) ** 2) / np.mean(abs(exact) ** 2))
    assert error < 1e-5


def test_mid_run_time_is_middle_of_sampled_interval(radar):
    swing = Oscillation(amplitude_m=(0.3, 0, 0), frequency_hz=400)
    arm = Scatterer(position_m=(0, 0, 0), rcs_m2=1.0, oscillation=swing)
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), body=Points(scatterers=(arm,)))])
    window, chirp = frame_sampling_times(radar, 2), radar.frame.chirp
    groups = list(direct_echo_groups(scene, radar, 2, np.random.default_rng(0)))

    assert len(groups) > 1
    for group in groups:
        first_s, last_s = window.chirp_starts_s[group.chirps][[0, -1]]
        middle_s = (first_s + last_s + chirp.sampled_duration_s) / 2 + chirp.adc_start_s
        if group.chirps.start:
            assert mid_run_time_s(group, window) == pytest.approx(
                window.frame_start_s + middle_s, abs=3e-6
            )


# Antenna position errors.

POSITION_ERRORS = PositionErrors(
    tx_m=[(1e-4, 2e-4, -3e-4), (-2e-4, 0, 1e-4)], rx_m=[(0, 3e-4, 1e-4), (2e-4, -1e-4, 0)]
)
OFF_AXIS_SCENE = dc.Scene(targets=[dc.Target(position_m=(18, 2, 0.4), velocity_m_per_s=(-6, 1, 0))])


def test_position_errors_equal_displaced_antennas(mimo):
    displaced_radar = replace(
        mimo,
        array=dc.Array(
            tx_m=np.add(mimo.array.tx_m, POSITION_ERRORS.tx_m),
            rx_m=np.add(mimo.array.rx_m, POSITION_ERRORS.rx_m),
        ),
    )
    signals = simulate_samples(OFF_AXIS_SCENE, mimo, POSITION_ERRORS)
    np.testing.assert_allclose(
        signals, simulate_samples(OFF_AXIS_SCENE, displaced_radar), atol=1e-12 * abs(signals).max()
    )


@pytest.mark.parametrize("n_images_before", [0, 1, 2])
def test_antenna_images_mirror_position_errors_in_any_order(mimo, n_images_before):
    images = [TwoRayGround(height_m=0.5), WallMultipath(start_m=(0, 4.5), end_m=(60, 5.5))]
    displaced_radar = replace(
        mimo,
        array=dc.Array(
            tx_m=np.add(mimo.array.tx_m, POSITION_ERRORS.tx_m),
            rx_m=np.add(mimo.array.rx_m, POSITION_ERRORS.rx_m),
        ),
    )
    expected = simulate_samples(OFF_AXIS_SCENE, displaced_radar, *images)
    signals = simulate_samples(
        OFF_AXIS_SCENE, mimo, *images[:n_images_before], POSITION_ERRORS, *images[n_images_before:]
    )

    # Half a micrometre of grazing height changes the reflection of the road by 1e-4.
    np.testing.assert_allclose(signals, expected, atol=1e-3 * abs(expected).max())
    assert (
        abs(signals - simulate_samples(OFF_AXIS_SCENE, mimo, *images)).max()
        > 0.1 * abs(expected).max()
    )


def test_random_position_errors_depend_on_seed_and_are_constant(mimo):
    large_radar = replace(
        mimo, array=replace(mimo.array, rx_m=[(0, 0.002 * k, 0) for k in range(2000)])
    )
    tx_m, rx_m = PositionErrors(std_m=1e-4, seed=4).errors_m(large_radar)
    # Five standard errors of 6,000 numbers.
    assert rx_m.std() == pytest.approx(1e-4, rel=5 / np.sqrt(12000))
    assert tx_m.shape == (2, 3)
    repeated_rx_m = PositionErrors(std_m=1e-4, seed=4).errors_m(large_radar)[1]
    np.testing.assert_array_equal(repeated_rx_m, rx_m)
    assert not np.array_equal(PositionErrors(std_m=1e-4, seed=5).errors_m(large_radar)[1], rx_m)

    errors = PositionErrors(std_m=3e-4, seed=1)
    static_scene = dc.Scene(targets=[dc.Target(position_m=(18, 2, 0.4))])
    for seed in (1, 2):
        frames = dc.simulate(static_scene, mimo, impairments=[errors], n_frames=2, seed=seed)
        np.testing.assert_allclose(frames[1], frames[0], atol=1e-6 * abs(frames).max().item())


# Invalid settings.


@pytest.mark.parametrize(
    ("build_impairment", "message"),
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
def test_rejects_invalid_impairment_settings(build_impairment, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        build_impairment()


TARGET_AHEAD = dc.Target(name="car", position_m=(30, 0, 0))


@pytest.mark.parametrize(
    ("impairment", "ego", "message"),
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
def test_rejects_impairment_that_does_not_fit_scene(radar, impairment, ego, message):
    scene = dc.Scene(targets=[TARGET_AHEAD], ego=dc.Ego(**ego))
    with pytest.raises(dc.InvalidSetting, match=message):
        simulate_samples(scene, radar, impairment)


def test_rejects_antenna_below_road(radar):
    low_radar = replace(radar, array=replace(radar.array, tx_m=[(0, 0, -0.45)]))
    with pytest.raises(dc.InvalidSetting, match="with transmitter 0 0.05 m above the road"):
        simulate_samples(dc.Scene(targets=[TARGET_AHEAD]), low_radar, TwoRayGround(height_m=0.5))


@pytest.mark.parametrize(
    ("text", "impairment"),
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
def test_settings_round_trip_with_units(text, impairment):
    assert parse_settings(text, Impairment) == impairment
    assert parse_settings(dump_yaml(impairment), Impairment) == impairment
