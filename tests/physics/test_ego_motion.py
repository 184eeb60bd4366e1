"""What stands still tells how the radar moves: its velocity, its mounting, and what moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.evaluation.association import associate_detections
from dechirp.radar.velocity_ambiguity import unambiguous_span_m_per_s
from dechirp.tracking.doppler_fit import Sightings, fit_velocity
from dechirp.tracking.ego import EgoMotion, ego_motion, label_motion
from dechirp.tracking.mounting import mounting_angle

HIGHWAY = Path(__file__).parents[2] / "examples" / "highway.yaml"
AT_REST = {"right-rail", "left-rail", "stranded-car", "sign", "bridge", "emergency-phone"}
NAN = float("nan")


def table(**columns) -> xr.Dataset:
    """Detections, of which nothing is told but what is given; 60 m away."""
    usual = {"frame": 0, "time": 0.0, "range": 60.0, "elevation": NAN, "ambiguity_number": NAN}
    errors = {"velocity_std": 1e-6, "azimuth_std": 1e-7, "elevation_std": NAN}
    known = usual | errors | columns
    arrays = np.broadcast_arrays(*known.values())
    return xr.Dataset(
        {name: ("detection", one.copy()) for name, one in zip(known, arrays, strict=True)}
    )


def at_rest(azimuth, v, elevation=0.0):
    """Radial velocities of what stands still."""
    return -(v[0] * np.cos(azimuth) + v[1] * np.sin(azimuth)) * np.cos(elevation)


@pytest.fixture(scope="module")
def one_element(radar) -> dc.Radar:
    """As the radar of all tests, 54.6 m/s of span: made of one element, at the origin."""
    return replace(radar, array=dc.Array())


@pytest.mark.parametrize("v", [(12.0, 0.0), (20.0, -3.0), (-4.0, 1.0), (0.0, 0.0)])
def test_the_velocity_is_what_most_agree_on(one_element, v):
    rng = np.random.default_rng(1)
    azimuth, elevation = rng.uniform(-0.7, 0.7, 50), rng.uniform(-0.1, 0.1, 50)
    velocity = at_rest(azimuth, v, elevation)
    velocity[:20] += rng.uniform(1.5, 25, 20)  # a third and more are traffic
    rows = table(azimuth=azimuth, velocity=velocity, elevation=elevation)

    ego = ego_motion(rows, one_element)
    marked = label_motion(rows, ego, one_element)

    assert ego.n_static.item() == 30
    assert [ego.vx.item(), ego.vy.item()] == pytest.approx(v, abs=1e-5)
    assert marked.motion.values.tolist() == ["moving"] * 20 + ["static"] * 30


def sighted(rng, n, v, azimuth_std, velocity_std, extra, about_rad):
    azimuth = rng.uniform(about_rad - 0.5, about_rad + 0.5, n)
    of_azimuth, of_velocity = (
        std * rng.uniform(0.5, 1.5, n) for std in (azimuth_std, velocity_std)
    )
    velocity = at_rest(azimuth, v) + np.hypot(of_velocity, extra) * rng.standard_normal(n)
    azimuth = azimuth + of_azimuth * rng.standard_normal(n)
    none = np.zeros(n)
    return Sightings(velocity, azimuth, none, of_velocity, of_azimuth, none, np.full(n, 1e9))


@pytest.mark.parametrize(
    ("azimuth_std", "velocity_std", "extra"),
    [(0.01, 0.02, 0.0), (0.003, 0.01, 0.05), (0.001, 0.05, 0.0)],
)
def test_a_fit_is_as_far_off_as_its_standard_errors_say(azimuth_std, velocity_std, extra):
    rng = np.random.default_rng(2)
    n_trials, v = 2500, np.array([30.0, 1.0])
    squares = np.empty(n_trials)
    for trial in range(n_trials):
        found = fit_velocity(sighted(rng, 40, v, azimuth_std, velocity_std, extra, 0.0), v)
        off = found.velocity - v
        squares[trial] = off @ np.linalg.solve(found.covariance, off) / 2

    # The mean of so many is known to 0.02; where all errors are told, it is 0.9 to 0.95, since
    # what is added to them cannot be below zero.
    assert 0.85 < squares.mean() < 1.15


def test_errors_of_azimuths_do_not_pull_the_velocity():
    rng = np.random.default_rng(3)
    n_trials, v = 1000, np.array([30.0, 0.0])
    fitted, plain = np.empty((2, n_trials, 2))
    for trial in range(n_trials):
        one = sighted(rng, 60, v, 0.03, 0.02, 0.0, 0.6)
        fitted[trial] = fit_velocity(one, v).velocity
        towards = one.level_directions(one.azimuth_rad)
        plain[trial] = -np.linalg.lstsq(towards, one.velocity_m_per_s)[0]
    pulled = abs(plain.mean(axis=0) - v) / plain.std(axis=0)
    left = abs(fitted.mean(axis=0) - v) / fitted.std(axis=0)

    # Means are known to 0.03 of the deviations.
    assert pulled.min() > 0.5
    assert left.max() < 0.2


def test_velocities_are_towards_the_middle_of_the_array(one_element):
    side_m, v = 0.2, np.array([20.0, 0.0])
    radar = replace(one_element, array=dc.Array(tx_m=[(0, side_m, 0)], rx_m=[(0, side_m, 0)]))
    rng = np.random.default_rng(5)
    range_m, azimuth = rng.uniform(4, 8, 30), rng.uniform(-0.6, 0.6, 30)
    x, y = range_m * np.cos(azimuth), range_m * np.sin(azimuth)
    rows = table(
        range=range_m,
        azimuth=azimuth,
        velocity=at_rest(np.arctan2(y - side_m, x), v),
        ambiguity_number=0.0,
    )

    ego = ego_motion(rows, radar)
    assert ego.n_static.item() == 30
    assert [ego.vx.item(), ego.vy.item()] == pytest.approx(v, abs=1e-5)


def test_a_velocity_beyond_the_span_is_told_by_directions(one_element):
    rng = np.random.default_rng(4)
    azimuth = rng.uniform(-0.8, 0.8, 40)
    span = float(unambiguous_span_m_per_s(np.array(60.0), one_element.frame))
    v = np.array([span / 2 + 9.0, 0.5])
    velocity = (at_rest(azimuth, v) + span / 2) % span - span / 2
    rows = table(azimuth=azimuth, velocity=velocity, velocity_std=0.02, azimuth_std=0.002)

    ego = ego_motion(rows, one_element)
    assert [ego.vx.item(), ego.vy.item()] == pytest.approx(v, abs=1e-5)

    # In a narrow sector a car that drives backwards, a span slower, would look the same.
    narrow = rows.assign(azimuth=rows.azimuth / 10)
    narrow["velocity"] = (at_rest(narrow.azimuth, v) + span / 2) % span - span / 2
    assert np.isnan(ego_motion(narrow, one_element).vx.item())
    # Unless nothing drives so fast backwards, or one fold more is known.
    slow = EgoMotion(max_speed_m_per_s=v[0] - 1)
    assert ego_motion(narrow, one_element, slow).vx.item() == pytest.approx(v[0] - span, abs=0.1)


AZIMUTH = np.linspace(-0.6, 0.6, 20)
MOVING = np.linspace(2, 22, 20)


@pytest.mark.parametrize(
    "rows",
    [
        table(azimuth=AZIMUTH[:4], velocity=at_rest(AZIMUTH[:4], (10, 0))),
        table(azimuth=0.2 + AZIMUTH / 100, velocity=at_rest(0.2 + AZIMUTH / 100, (10, 0))),
        # All of the spread is error.
        table(azimuth=AZIMUTH / 6, velocity=-10.0, azimuth_std=0.07, velocity_std=0.1),
        table(azimuth=AZIMUTH, velocity=at_rest(AZIMUTH, (10, 0)) + MOVING * (np.arange(20) % 2)),
        table(azimuth=AZIMUTH, velocity=MOVING**2 / 20),
        table(azimuth=NAN, velocity=np.full(20, -10.0)),
        table(azimuth=AZIMUTH, velocity=NAN),
        table(azimuth=0.3, velocity=np.full(20, -10.0)),
    ],
    ids=["few", "one sector", "errors", "half", "all move", "no angle", "one chirp", "one place"],
)
def test_what_cannot_be_told_is_not(one_element, rows):
    majority = EgoMotion(min_share=0.6)
    ego = ego_motion(rows, one_element, majority)

    assert ego.n_static.item() == 0
    assert all(np.isnan(ego[name].item()) for name in ("vx", "vy", "vx_std", "vy_std"))
    assert set(label_motion(rows, ego, one_element).motion.values) == {""}


def test_what_moves_is_beyond_three_standard_errors_and_tolerances(one_element):
    # A slow walk at 0.4 m/s is told from rest where velocities are good, not where they are bad.
    for velocity_std, motion in ((1e-6, "moving"), (0.2, "static")):
        velocity = at_rest(AZIMUTH, (10, 0))
        velocity[7] += 0.4
        rows = table(azimuth=AZIMUTH, velocity=velocity, velocity_std=velocity_std)
        marked = label_motion(rows, ego_motion(rows, one_element), one_element).motion.values
        assert marked[7] == motion and set(np.delete(marked, 7)) == {"static"}


def test_directions_need_the_spread_that_is_asked_for(one_element):
    rows = table(azimuth=AZIMUTH, velocity=at_rest(AZIMUTH, (10, 0)))
    spread = AZIMUTH.std()
    for asked, n_static in ((0.99 * spread, 20), (1.01 * spread, 0)):
        settings = EgoMotion(min_spread_rad=asked)
        assert ego_motion(rows, one_element, settings).n_static.item() == n_static


def test_two_convoys_of_one_size_are_no_majority(one_element):
    velocity = at_rest(AZIMUTH, (10, 0))
    velocity[::2] = at_rest(AZIMUTH[::2], (25, 0))
    rows = table(azimuth=AZIMUTH, velocity=velocity)
    assert np.isnan(ego_motion(rows, one_element, EgoMotion(min_share=0.3)).vx.item())


def test_directions_that_are_not_sure_have_no_vote(radar):
    radar = replace(
        radar,
        frame=replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1))),
        array=replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)]),
    )
    velocity = at_rest(AZIMUTH, (10, 0))
    unsure = np.arange(20) % 3 == 0
    velocity[3] += 8.0
    rows = table(azimuth=AZIMUTH, velocity=velocity, ambiguity_number=np.where(unsure, NAN, 0.0))

    ego = ego_motion(rows, radar)
    motion = label_motion(rows, ego, radar).motion.values

    assert ego.n_static.item() == 13
    # What agrees is static; what does not may have another direction.
    assert motion[3] == "" and set(np.delete(motion, 3)) == {"static"}


def test_a_frame_is_the_same_alone_and_among_others(one_element):
    rng = np.random.default_rng(6)
    azimuth = np.tile(AZIMUTH, 3)
    velocity = at_rest(azimuth, (10, 1)) + 0.1 * rng.standard_normal(60)
    frame = np.repeat([9, 4, 6], 20)
    rows = table(frame=frame, time=0.05 * frame, azimuth=azimuth, velocity=velocity)
    rows["velocity_std"][:] = 0.1

    together = ego_motion(rows, one_element)
    alone = [ego_motion(rows.isel(detection=frame == number), one_element) for number in (4, 6, 9)]

    assert np.isfinite(together.vx).all()
    xr.testing.assert_identical(together, xr.concat(alone, "frame"))
    assert together.time.values == pytest.approx([0.2, 0.3, 0.45])
    # Frames that are not in the list are not known.
    some = label_motion(rows, alone[0], one_element)
    assert set(some.motion.values[frame != 4]) == {""}


@pytest.fixture(scope="module")
def highway() -> dc.Scenario:
    return dc.load(HIGHWAY)


def driven(scenario, n_frames, **ego):
    """Detections of the highway from a radar that moves so."""
    scene = replace(scenario.scene, ego=replace(scenario.scene.ego, **ego))
    radar, noise = scenario.radar, scenario.impairments
    with pytest.warns(dc.PhysicsWarning, match="is aliased to"):
        cube = dc.simulate(scene, radar, impairments=noise, n_frames=n_frames, seed=1)
    return dc.detect(cube, radar, scenario.chain), scene


def test_on_a_highway_the_speed_is_known_to_a_decimetre_a_second(highway):
    rows, scene = driven(highway, 2)
    ego = ego_motion(rows, highway.radar)
    assert np.hypot(ego.vx - 30, ego.vy).max() < 0.1

    motion = label_motion(rows, ego, highway.radar).motion.values
    truth = dc.truth(scene, highway.radar, n_frames=2)
    owner = associate_detections(rows, truth, highway.radar, scene).target
    names = np.array(scene.names)[owner]
    rests = np.isin(names, sorted(AT_REST))
    assert "static" not in motion[(owner >= 0) & ~rests]
    # Two posts of both rails in one cell have the direction of neither.
    assert (motion[(owner >= 0) & rests] == "static").mean() > 0.9


def test_in_a_bend_the_velocity_is_that_of_the_radar_itself(highway):
    rows, _ = driven(highway, 1, turn_rate_rad_per_s=0.4)
    ego = ego_motion(rows, highway.radar)
    assert np.hypot(ego.vx - 30, ego.vy).max() < 0.1


def test_driving_straight_on_tells_how_the_radar_is_mounted(highway):
    yaw = np.radians(3.7)
    rows, _ = driven(highway, 6, yaw_rad=yaw)
    found = mounting_angle(ego_motion(rows, highway.radar))

    assert found.n_frames == 6
    assert abs(np.degrees(found.yaw_rad - yaw)) < 0.1
    assert abs(found.yaw_rad - yaw) < 5 * found.yaw_std_rad


def drives(rng, n_frames, yaw, speed, covariance):
    """Motions of frames with errors of such covariances, (n_frames, 2, 2)."""
    true = speed[:, None] * np.array([np.cos(yaw), -np.sin(yaw)])
    v = true + np.einsum("fij,fj->fi", np.linalg.cholesky(covariance), rng.normal(size=true.shape))
    columns = {
        "vx": v[:, 0],
        "vy": v[:, 1],
        "vx_std": np.sqrt(covariance[:, 0, 0]),
        "vy_std": np.sqrt(covariance[:, 1, 1]),
        "vx_vy_covariance": covariance[:, 0, 1],
    }
    known = {name: ("frame", column) for name, column in columns.items()}
    return xr.Dataset(known, coords={"frame": np.arange(n_frames)})


def test_the_mounting_angle_is_as_far_off_as_its_standard_error_says():
    rng = np.random.default_rng(7)
    n_trials, n_frames, yaw = 3000, 50, np.radians(-110.0)
    # As of a sector to one side: errors along and across go together.
    covariance = np.tile(np.array([[1.0, -1.6], [-1.6, 4.0]]) * 1e-3, (n_frames, 1, 1))
    speed = rng.uniform(4, 30, n_frames)
    ratio = np.empty(n_trials)
    for trial in range(n_trials):
        found = mounting_angle(drives(rng, n_frames, yaw, speed, covariance))
        ratio[trial] = ((found.yaw_rad - yaw) / found.yaw_std_rad) ** 2

    # Known to 0.026; raised errors of frames that scatter by chance take off 0.02.
    assert 0.85 < np.mean(ratio) < 1.15


def test_frames_that_scatter_more_than_they_say_raise_the_error():
    rng = np.random.default_rng(8)
    covariance = np.tile(1e-4 * np.eye(2), (200, 1, 1))
    ego = drives(rng, 200, 0.1, np.full(200, 20.0), 25 * covariance)
    told = mounting_angle(ego.assign(vx_std=ego.vx_std / 5, vy_std=ego.vy_std / 5))

    assert told.yaw_std_rad == pytest.approx(mounting_angle(ego).yaw_std_rad, rel=0.15)


def test_frames_that_stand_or_are_not_known_do_not_count():
    ego = drives(
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
    ("name", "wrong"),
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
def test_settings_that_cannot_work_are_refused(name, wrong):
    with pytest.raises(dc.InvalidSetting) as refused:
        EgoMotion(**{name: wrong})
    assert refused.value.mistakes[0].setting == f"EgoMotion.{name}"


GOOD = table(azimuth=AZIMUTH, velocity=at_rest(AZIMUTH, (10, 0)))


@pytest.mark.parametrize(
    ("rows", "setting"),
    [
        (GOOD.drop_vars("azimuth_std"), "detections"),
        (GOOD.velocity, "detections"),
        (GOOD.assign(range=GOOD.range * np.inf), "detections.range"),
        (GOOD.assign(azimuth_std=-GOOD.azimuth_std), "detections.azimuth_std"),
        (GOOD.assign(velocity_std=0 * GOOD.velocity_std), "detections.velocity_std"),
        (GOOD.assign(frame=GOOD.frame - 1), "detections.frame"),
        (GOOD.assign(frame=GOOD.frame + 0.5), "detections.frame"),
        (GOOD.assign(velocity=GOOD.velocity * 1e12), "detections.velocity"),
    ],
)
def test_detections_that_cannot_be_are_refused(one_element, rows, setting):
    with pytest.raises(dc.InvalidSetting) as refused:
        ego_motion(rows, one_element)
    assert refused.value.mistakes[0].setting == setting


def test_no_detections_are_no_frames(one_element):
    none = GOOD.isel(detection=[])
    ego = ego_motion(none, one_element)
    assert ego.sizes["frame"] == 0
    assert label_motion(none, ego, one_element).motion.size == 0


def test_what_is_no_radar_is_refused(one_element):
    with pytest.raises(dc.InvalidSetting, match="radar: a Frame"):
        ego_motion(GOOD, one_element.frame)
    with pytest.raises(dc.InvalidSetting, match="settings: a dict"):
        ego_motion(GOOD, one_element, {})
    with pytest.raises(dc.InvalidSetting, match="ego: a tuple"):
        label_motion(GOOD, (10.0, 0.0), one_element)
    with pytest.raises(dc.InvalidSetting, match="ego: a dataset without vx"):
        label_motion(GOOD, ego_motion(GOOD, one_element).drop_vars("vx"), one_element)
