"""Ego motion from static detections: velocity, mounting angle and motion labels."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation.association import associate_detections
from dechirp.radar.velocity_ambiguity import unambiguous_velocity_span_m_per_s
from dechirp.tracking.doppler_fit import Sightings, fit_radar_velocity
from dechirp.tracking.ego import EgoMotion, ego_motion, label_static_and_moving
from dechirp.tracking.mounting import mounting_angle
from nightly import nightly, nightly_except

HIGHWAY = Path(__file__).parents[2] / "examples" / "highway.yaml"
STATIC_TARGETS = {"right-rail", "left-rail", "stranded-car", "sign", "bridge", "emergency-phone"}
NAN = float("nan")


def make_detections(**columns) -> xr.Dataset:
    """Return detections at 60 m; columns not given are NaN or nearly exact."""
    defaults = {"frame": 0, "time": 0.0, "range": 60.0, "elevation": NAN, "ambiguity_number": NAN}
    standard_errors = {"velocity_std": 1e-6, "azimuth_std": 1e-7, "elevation_std": NAN}
    columns_with_defaults = defaults | standard_errors | columns
    arrays = np.broadcast_arrays(*columns_with_defaults.values())
    return xr.Dataset(
        {
            name: ("detection", column.copy())
            for name, column in zip(columns_with_defaults, arrays, strict=True)
        }
    )


def static_velocities(azimuth, v, elevation=0.0):
    """Return the radial velocities of static targets."""
    return -(v[0] * np.cos(azimuth) + v[1] * np.sin(azimuth)) * np.cos(elevation)


@pytest.fixture(scope="module")
def single_element_radar(radar) -> dc.Radar:
    """Return the common radar, 54.6 m/s of velocity span, with one element at the origin."""
    return replace(radar, array=dc.Array())


@pytest.mark.parametrize("v", [(12.0, 0.0), (20.0, -3.0), (-4.0, 1.0), (0.0, 0.0)])
def test_ego_velocity_follows_majority_of_detections(single_element_radar, v):
    rng = np.random.default_rng(1)
    azimuth, elevation = rng.uniform(-0.7, 0.7, 50), rng.uniform(-0.1, 0.1, 50)
    velocity = static_velocities(azimuth, v, elevation)
    velocity[:20] += rng.uniform(1.5, 25, 20)  # more than a third is traffic
    rows = make_detections(azimuth=azimuth, velocity=velocity, elevation=elevation)

    ego = ego_motion(rows, single_element_radar)
    marked = label_static_and_moving(rows, ego, single_element_radar)

    assert ego.n_static.item() == 30
    assert [ego.vx.item(), ego.vy.item()] == pytest.approx(v, abs=1e-5)
    assert marked.motion.values.tolist() == ["moving"] * 20 + ["static"] * 30


def draw_sightings(rng, n, v, azimuth_std, velocity_std, model_error, centre_rad):
    azimuth = rng.uniform(centre_rad - 0.5, centre_rad + 0.5, n)
    azimuth_stds, velocity_stds = (
        std * rng.uniform(0.5, 1.5, n) for std in (azimuth_std, velocity_std)
    )
    velocity = static_velocities(azimuth, v) + np.hypot(
        velocity_stds, model_error
    ) * rng.standard_normal(n)
    azimuth = azimuth + azimuth_stds * rng.standard_normal(n)
    zeros = np.zeros(n)
    return Sightings(velocity, azimuth, zeros, velocity_stds, azimuth_stds, zeros, np.full(n, 1e9))


@pytest.mark.parametrize(
    ("azimuth_std", "velocity_std", "model_error"),
    nightly_except(
        [(0.001, 0.05, 0.0)], [(0.01, 0.02, 0.0), (0.003, 0.01, 0.05), (0.001, 0.05, 0.0)]
    ),
)
def test_velocity_fit_covariance_is_correct(azimuth_std, velocity_std, model_error):
    rng = np.random.default_rng(2)
    n_trials, v = 800, np.array([30.0, 1.0])
    squares = np.empty(n_trials)
    for trial in range(n_trials):
        fit = fit_radar_velocity(
            draw_sightings(rng, 40, v, azimuth_std, velocity_std, model_error, 0.0), v
        )
        error = fit.velocity - v
        squares[trial] = error @ np.linalg.solve(fit.covariance, error) / 2

    # The mean has a standard error of 0.035. It is 0.9 to 0.95 if all errors are included, since
    # the estimated model error is never negative.
    assert 0.74 < squares.mean() < 1.18


@nightly
def test_azimuth_errors_do_not_bias_velocity_fit():
    rng = np.random.default_rng(3)
    n_trials, v = 1000, np.array([30.0, 0.0])
    fit_velocities, least_squares_velocities = np.empty((2, n_trials, 2))
    for trial in range(n_trials):
        sightings = draw_sightings(rng, 60, v, 0.03, 0.02, 0.0, 0.6)
        fit_velocities[trial] = fit_radar_velocity(sightings, v).velocity
        directions = sightings.horizontal_direction_components(sightings.azimuth_rad)
        least_squares_velocities[trial] = -np.linalg.lstsq(directions, sightings.velocity_m_per_s)[
            0
        ]
    least_squares_bias = abs(
        least_squares_velocities.mean(axis=0) - v
    ) / least_squares_velocities.std(axis=0)
    fit_bias = abs(fit_velocities.mean(axis=0) - v) / fit_velocities.std(axis=0)

    # Means have a standard error of 0.03 deviations.
    assert least_squares_bias.min() > 0.5
    assert fit_bias.max() < 0.2


def test_radial_velocities_refer_to_phase_centre(single_element_radar):
    side_m, v = 0.2, np.array([20.0, 0.0])
    radar = replace(
        single_element_radar, array=dc.Array(tx_m=[(0, side_m, 0)], rx_m=[(0, side_m, 0)])
    )
    rng = np.random.default_rng(5)
    range_m, azimuth = rng.uniform(4, 8, 30), rng.uniform(-0.6, 0.6, 30)
    x, y = range_m * np.cos(azimuth), range_m * np.sin(azimuth)
    rows = make_detections(
        range=range_m,
        azimuth=azimuth,
        velocity=static_velocities(np.arctan2(y - side_m, x), v),
        ambiguity_number=0.0,
    )

    ego = ego_motion(rows, radar)
    assert ego.n_static.item() == 30
    assert [ego.vx.item(), ego.vy.item()] == pytest.approx(v, abs=1e-5)


def test_directions_resolve_ambiguous_ego_velocity(single_element_radar):
    rng = np.random.default_rng(4)
    azimuth = rng.uniform(-0.8, 0.8, 40)
    span = float(unambiguous_velocity_span_m_per_s(np.array(60.0), single_element_radar.frame))
    v = np.array([span / 2 + 9.0, 0.5])
    velocity = (static_velocities(azimuth, v) + span / 2) % span - span / 2
    rows = make_detections(azimuth=azimuth, velocity=velocity, velocity_std=0.02, azimuth_std=0.002)

    ego = ego_motion(rows, single_element_radar)
    assert [ego.vx.item(), ego.vy.item()] == pytest.approx(v, abs=1e-5)

    # In a narrow sector, a car that reverses one span slower has the same velocities.
    narrow_rows = rows.assign(azimuth=rows.azimuth / 10)
    narrow_rows["velocity"] = (
        static_velocities(narrow_rows.azimuth, v) + span / 2
    ) % span - span / 2
    assert np.isnan(ego_motion(narrow_rows, single_element_radar).vx.item())
    # A speed limit excludes the reversing car.
    limited = EgoMotion(max_speed_m_per_s=v[0] - 1)
    assert ego_motion(narrow_rows, single_element_radar, limited).vx.item() == pytest.approx(
        v[0] - span, abs=0.1
    )


AZIMUTH = np.linspace(-0.6, 0.6, 20)
MOVING_VELOCITIES = np.linspace(2, 22, 20)


@pytest.mark.parametrize(
    "rows",
    [
        make_detections(azimuth=AZIMUTH[:4], velocity=static_velocities(AZIMUTH[:4], (10, 0))),
        make_detections(
            azimuth=0.2 + AZIMUTH / 100, velocity=static_velocities(0.2 + AZIMUTH / 100, (10, 0))
        ),
        # The spread of azimuths is error only.
        make_detections(azimuth=AZIMUTH / 6, velocity=-10.0, azimuth_std=0.07, velocity_std=0.1),
        make_detections(
            azimuth=AZIMUTH,
            velocity=static_velocities(AZIMUTH, (10, 0)) + MOVING_VELOCITIES * (np.arange(20) % 2),
        ),
        make_detections(azimuth=AZIMUTH, velocity=MOVING_VELOCITIES**2 / 20),
        make_detections(azimuth=NAN, velocity=np.full(20, -10.0)),
        make_detections(azimuth=AZIMUTH, velocity=NAN),
        make_detections(azimuth=0.3, velocity=np.full(20, -10.0)),
    ],
    ids=[
        "few detections",
        "narrow sector",
        "azimuth errors",
        "half moving",
        "all moving",
        "no azimuth",
        "no velocity",
        "one direction",
    ],
)
def test_inconclusive_detections_yield_no_ego_velocity(single_element_radar, rows):
    majority = EgoMotion(min_share=0.6)
    ego = ego_motion(rows, single_element_radar, majority)

    assert ego.n_static.item() == 0
    assert all(np.isnan(ego[name].item()) for name in ("vx", "vy", "vx_std", "vy_std"))
    assert set(label_static_and_moving(rows, ego, single_element_radar).motion.values) == {""}


def test_moving_label_needs_three_standard_errors(single_element_radar):
    # Slow walking at 0.4 m/s is labelled as moving for accurate velocities only.
    for velocity_std, motion in ((1e-6, "moving"), (0.2, "static")):
        velocity = static_velocities(AZIMUTH, (10, 0))
        velocity[7] += 0.4
        rows = make_detections(azimuth=AZIMUTH, velocity=velocity, velocity_std=velocity_std)
        marked = label_static_and_moving(
            rows, ego_motion(rows, single_element_radar), single_element_radar
        ).motion.values
        assert marked[7] == motion and set(np.delete(marked, 7)) == {"static"}


def test_minimum_spread_of_directions_is_applied(single_element_radar):
    rows = make_detections(azimuth=AZIMUTH, velocity=static_velocities(AZIMUTH, (10, 0)))
    spread = AZIMUTH.std()
    for min_spread_rad, n_static in ((0.99 * spread, 20), (1.01 * spread, 0)):
        settings = EgoMotion(min_spread_rad=min_spread_rad)
        assert ego_motion(rows, single_element_radar, settings).n_static.item() == n_static


def test_two_equal_convoys_yield_no_ego_velocity(single_element_radar):
    velocity = static_velocities(AZIMUTH, (10, 0))
    velocity[::2] = static_velocities(AZIMUTH[::2], (25, 0))
    rows = make_detections(azimuth=AZIMUTH, velocity=velocity)
    assert np.isnan(ego_motion(rows, single_element_radar, EgoMotion(min_share=0.3)).vx.item())


def test_ambiguous_directions_are_excluded_from_fit(radar):
    radar = replace(
        radar,
        frame=replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1))),
        array=replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)]),
    )
    velocity = static_velocities(AZIMUTH, (10, 0))
    is_ambiguous = np.arange(20) % 3 == 0
    velocity[3] += 8.0
    rows = make_detections(
        azimuth=AZIMUTH, velocity=velocity, ambiguity_number=np.where(is_ambiguous, NAN, 0.0)
    )

    ego = ego_motion(rows, radar)
    motion = label_static_and_moving(rows, ego, radar).motion.values

    assert ego.n_static.item() == 13
    # Consistent detections are static; inconsistent ones may have another direction.
    assert motion[3] == "" and set(np.delete(motion, 3)) == {"static"}


def test_ego_motion_of_frame_does_not_depend_on_other_frames(single_element_radar):
    rng = np.random.default_rng(6)
    azimuth = np.tile(AZIMUTH, 3)
    velocity = static_velocities(azimuth, (10, 1)) + 0.1 * rng.standard_normal(60)
    frame = np.repeat([9, 4, 6], 20)
    rows = make_detections(frame=frame, time=0.05 * frame, azimuth=azimuth, velocity=velocity)
    rows["velocity_std"][:] = 0.1

    combined = ego_motion(rows, single_element_radar)
    single_frames = [
        ego_motion(rows.isel(detection=frame == number), single_element_radar)
        for number in (4, 6, 9)
    ]

    assert np.isfinite(combined.vx).all()
    xr.testing.assert_identical(combined, xr.concat(single_frames, "frame"))
    assert combined.time.values == pytest.approx([0.2, 0.3, 0.45])
    # Frames without ego motion have no labels.
    marked = label_static_and_moving(rows, single_frames[0], single_element_radar)
    assert set(marked.motion.values[frame != 4]) == {""}


@pytest.fixture(scope="module")
def highway() -> dc.Scenario:
    return dc.load(HIGHWAY)


def detect_highway(scenario, n_frames, **ego):
    """Simulate and detect the highway scene with changed ego motion."""
    scene = replace(scenario.scene, ego=replace(scenario.scene.ego, **ego))
    radar, noise = scenario.radar, scenario.impairments
    with pytest.warns(dc.PhysicsWarning, match="is aliased to"):
        cube = dc.simulate(scene, radar, impairments=noise, n_frames=n_frames, seed=1)
    return dc.detect(cube, radar, scenario.chain), scene


@nightly
def test_highway_ego_velocity_is_accurate_to_decimetre_per_second(highway):
    rows, scene = detect_highway(highway, 2)
    ego = ego_motion(rows, highway.radar)
    assert np.hypot(ego.vx - 30, ego.vy).max() < 0.1

    motion = label_static_and_moving(rows, ego, highway.radar).motion.values
    truth = dc.truth(scene, highway.radar, n_frames=2)
    target_index = associate_detections(rows, truth, highway.radar, scene).target
    names = np.array(scene.names)[target_index]
    is_static = np.isin(names, sorted(STATIC_TARGETS))
    assert "static" not in motion[(target_index >= 0) & ~is_static]
    # Two posts of both guard rails in one cell have a direction between them.
    assert (motion[(target_index >= 0) & is_static] == "static").mean() > 0.9


def test_ego_velocity_in_bend_refers_to_radar(highway):
    rows, _ = detect_highway(highway, 1, turn_rate_rad_per_s=0.4)
    ego = ego_motion(rows, highway.radar)
    assert np.hypot(ego.vx - 30, ego.vy).max() < 0.1


@nightly
def test_straight_driving_yields_mounting_angle(highway):
    yaw = np.radians(3.7)
    rows, _ = detect_highway(highway, 6, yaw_rad=yaw)
    mounting = mounting_angle(ego_motion(rows, highway.radar))

    assert mounting.n_frames == 6
    assert abs(np.degrees(mounting.yaw_rad - yaw)) < 0.1
    assert abs(mounting.yaw_rad - yaw) < 5 * mounting.yaw_std_rad


def draw_ego_motions(rng, n_frames, yaw, speed, covariance):
    """Return random ego motions with the given error covariances, (n_frames, 2, 2)."""
    truth = speed[:, None] * np.array([np.cos(yaw), -np.sin(yaw)])
    v = truth + np.einsum(
        "fij,fj->fi", np.linalg.cholesky(covariance), rng.normal(size=truth.shape)
    )
    columns = {
        "vx": v[:, 0],
        "vy": v[:, 1],
        "vx_std": np.sqrt(covariance[:, 0, 0]),
        "vy_std": np.sqrt(covariance[:, 1, 1]),
        "vx_vy_covariance": covariance[:, 0, 1],
    }
    variables = {name: ("frame", column) for name, column in columns.items()}
    return xr.Dataset(variables, coords={"frame": np.arange(n_frames)})


@nightly
def test_mounting_angle_standard_error_is_correct():
    rng = np.random.default_rng(7)
    n_trials, n_frames, yaw = 1000, 50, np.radians(-110.0)
    # A sector to one side correlates longitudinal and lateral errors.
    covariance = np.tile(np.array([[1.0, -1.6], [-1.6, 4.0]]) * 1e-3, (n_frames, 1, 1))
    speed = rng.uniform(4, 30, n_frames)
    normalised_squares = np.empty(n_trials)
    for trial in range(n_trials):
        mounting = mounting_angle(draw_ego_motions(rng, n_frames, yaw, speed, covariance))
        normalised_squares[trial] = ((mounting.yaw_rad - yaw) / mounting.yaw_std_rad) ** 2

    # The standard error is 0.045; frames whose scatter raises their errors by chance lower the mean
    # by 0.02.
    assert 0.75 < np.mean(normalised_squares) < 1.23


def test_excess_scatter_raises_standard_error():
    rng = np.random.default_rng(8)
    covariance = np.tile(1e-4 * np.eye(2), (200, 1, 1))
    ego = draw_ego_motions(rng, 200, 0.1, np.full(200, 20.0), 25 * covariance)
    mounting = mounting_angle(ego.assign(vx_std=ego.vx_std / 5, vy_std=ego.vy_std / 5))

    assert mounting.yaw_rad == pytest.approx(0.1, abs=1e-3)  # five standard errors are 9e-4
    assert mounting.yaw_std_rad == pytest.approx(mounting_angle(ego).yaw_std_rad, rel=0.15)


def test_slow_and_unknown_frames_are_excluded():
    ego = draw_ego_motions(
        np.random.default_rng(9),
        5,
        0.1,
        np.array([0, 2, 10, 10, 10.0]),
        np.tile(1e-4 * np.eye(2), (5, 1, 1)),
    )
    assert mounting_angle(ego).n_frames == 3
    assert mounting_angle(ego.where(np.arange(5) != 3)).n_frames == 2
    with pytest.raises(dc.InvalidSetting, match="ego: 1 of 3 frames at 3 m/s or more"):
        mounting_angle(ego.isel(frame=[0, 1, 2]))
    with pytest.raises(dc.InvalidSetting, match="min_speed"):
        mounting_angle(ego, 0.0)


@pytest.mark.parametrize(
    ("name", "invalid_value"),
    [
        ("gate_probability", 1.0),
        ("tolerance_m_per_s", 0.0),
        ("min_static", 2),
        ("min_share", 0.0),
        ("min_share", 1.5),
        ("min_spread_rad", 2.0),
        ("max_speed_m_per_s", NAN),
        ("n_draws", 0),
        ("seed", -1),
    ],
)
def test_rejects_invalid_settings(name, invalid_value):
    with pytest.raises(dc.InvalidSetting) as error:
        EgoMotion(**{name: invalid_value})
    assert error.value.mistakes[0].setting == f"EgoMotion.{name}"


VALID_DETECTIONS = make_detections(azimuth=AZIMUTH, velocity=static_velocities(AZIMUTH, (10, 0)))


@pytest.mark.parametrize(
    ("rows", "setting"),
    [
        (VALID_DETECTIONS.drop_vars("azimuth_std"), "detections"),
        (VALID_DETECTIONS.velocity, "detections"),
        (VALID_DETECTIONS.assign(range=VALID_DETECTIONS.range * np.inf), "detections.range"),
        (
            VALID_DETECTIONS.assign(azimuth_std=-VALID_DETECTIONS.azimuth_std),
            "detections.azimuth_std",
        ),
        (
            VALID_DETECTIONS.assign(velocity_std=0 * VALID_DETECTIONS.velocity_std),
            "detections.velocity_std",
        ),
        (VALID_DETECTIONS.assign(frame=VALID_DETECTIONS.frame - 1), "detections.frame"),
        (VALID_DETECTIONS.assign(frame=VALID_DETECTIONS.frame + 0.5), "detections.frame"),
        (VALID_DETECTIONS.assign(velocity=VALID_DETECTIONS.velocity * 1e12), "detections.velocity"),
    ],
)
def test_rejects_invalid_detections(single_element_radar, rows, setting):
    with pytest.raises(dc.InvalidSetting) as error:
        ego_motion(rows, single_element_radar)
    assert error.value.mistakes[0].setting == setting


def test_no_detections_yield_no_frames(single_element_radar):
    no_detections = VALID_DETECTIONS.isel(detection=[])
    ego = ego_motion(no_detections, single_element_radar)
    assert ego.sizes["frame"] == 0
    assert label_static_and_moving(no_detections, ego, single_element_radar).motion.size == 0


def test_rejects_wrong_argument_types(single_element_radar):
    with pytest.raises(dc.InvalidSetting, match="radar: a Frame"):
        ego_motion(VALID_DETECTIONS, single_element_radar.frame)
    with pytest.raises(dc.InvalidSetting, match="settings: a dict"):
        ego_motion(VALID_DETECTIONS, single_element_radar, {})
    with pytest.raises(dc.InvalidSetting, match="ego: a tuple"):
        label_static_and_moving(VALID_DETECTIONS, (10.0, 0.0), single_element_radar)
    with pytest.raises(dc.InvalidSetting, match="ego: a dataset without vx"):
        label_static_and_moving(
            VALID_DETECTIONS,
            ego_motion(VALID_DETECTIONS, single_element_radar).drop_vars("vx"),
            single_element_radar,
        )


def draw_traffic(rng, n_static, n_cars, speed_spread, v):
    """Return static detections and those of cars, of one to three detections each."""
    azimuth = rng.uniform(-0.6, 0.6, n_static)
    velocity = static_velocities(azimuth, v)
    for _ in range(n_cars):
        on_car = rng.uniform(-0.3, 0.3) + rng.uniform(-0.02, 0.02, rng.integers(1, 4))
        relative = (v[0] - 20.0 - speed_spread * rng.standard_normal(), 0.0)
        azimuth = np.append(azimuth, on_car)
        velocity = np.append(velocity, static_velocities(on_car, relative))
    n = azimuth.size
    return make_detections(
        azimuth=azimuth + 0.003 * rng.standard_normal(n),
        velocity=velocity + 0.05 * rng.standard_normal(n),
        velocity_std=0.05,
        azimuth_std=0.003,
    )


@pytest.mark.parametrize(
    ("n_static", "n_cars", "speed_spread", "least_known"),
    nightly_except(
        2, [(10, 10, 0.1, 0), (10, 10, 0.3, 0), (10, 10, 1.0, 0), (2, 20, 0.5, 0), (40, 8, 1.0, 20)]
    ),
)
def test_dense_traffic_yields_no_wrong_ego_velocity(n_static, n_cars, speed_spread, least_known):
    """No known velocity is wrong by more than five stated errors; static scenes remain known."""
    rng = np.random.default_rng(12)
    v, n_known = np.array([20.0, 0.3]), 0
    for _ in range(25):
        rows = draw_traffic(rng, n_static, n_cars, speed_spread, v)
        ego = ego_motion(rows, None, EgoMotion(min_share=0.3))
        if np.isfinite(ego.vx.item()):
            n_known += 1
            for name, truth in (("vx", v[0]), ("vy", v[1])):
                assert abs(ego[name].item() - truth) < 5 * ego[f"{name}_std"].item()
    assert n_known >= least_known


def test_largest_speed_holds_for_the_result():
    """Hypotheses of exact pairs below the limit may be fitted to a velocity above it."""
    azimuth = np.linspace(-0.6, 0.6, 20)
    velocity = static_velocities(azimuth, (30.0, 0.0)) + 0.1 * np.cos(40 * azimuth)
    rows = make_detections(azimuth=azimuth, velocity=velocity, velocity_std=0.1)
    free = ego_motion(rows, None)
    speed = float(np.hypot(free.vx, free.vy).item())
    assert speed == pytest.approx(30.0, abs=0.3)
    limited = ego_motion(rows, None, EgoMotion(max_speed_m_per_s=speed - 1e-3))
    assert np.isnan(limited.vx.item()) and limited.n_static.item() == 0


def test_detections_of_one_object_count_as_one():
    """Three objects, seen ten times each, agree with a velocity but are too few."""
    azimuth = np.repeat([-0.3, 0.0, 0.3], 10) + np.tile(np.linspace(-0.05, 0.05, 10), 3)
    rows = make_detections(azimuth=azimuth, velocity=static_velocities(azimuth, (12.0, 0.0)))
    assert ego_motion(rows, None).n_static.item() == 30
    numbered = rows.assign(number=("detection", np.repeat([1, 2, 3], 10)))
    assert np.isnan(ego_motion(numbered, None).vx.item())
