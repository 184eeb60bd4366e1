"""Where targets are: poses, arcs, parabolas and waypoints, and paths as polynomials."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

import dechirp as dc
from dechirp.core.values import frozen_dataclass
from dechirp.scene.bodies.base import Body
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.bodies.points import Oscillation, Points, Rotation, Scatterer
from dechirp.scene.ego import Ego
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.trajectories import fit_paths
from dechirp.scene.truth import truth
from dechirp.scene.waypoints import Waypoint

IN_A_BEND = Ego(
    position_m=(3, -2, 0.5),
    yaw_rad=0.3,
    pitch_rad=0.05,
    roll_rad=-0.1,
    velocity_m_per_s=(18, 4, -0.2),
    turn_rate_rad_per_s=0.6,
)
SWERVING = (
    Waypoint(time_s=0.5, position_m=(28, 5, 0)),
    Waypoint(time_s=1.2, position_m=(35, 2, 0.2)),
    Waypoint(time_s=2.0, position_m=(38, 9, 0.1)),
)
WHEEL = tuple(
    Scatterer(
        position_m=(1.3 + 0.32 * np.cos(angle), 0.8, 0.32 * np.sin(angle)),
        rcs_m2=0.01,
        rotation=Rotation(center_m=(1.3, 0.8, 0), rate_rad_per_s=100),
    )
    for angle in np.linspace(0, 5, 8)
)
WALKER = (
    Scatterer(
        position_m=(0, 0.2, 1),
        rcs_m2=0.05,
        oscillation=Oscillation(amplitude_m=(0.3, 0, 0.1), frequency_hz=2, phase_rad=1),
    ),
)
BOX = tuple(Scatterer(position_m=(x, y, 0.4), rcs_m2=1) for x in (-1, 0, 3.5) for y in (-0.9, 0.9))


def one(**of):
    """A scene of one target, and the radar's motion."""
    ego = of.pop("ego", Ego())
    return Scene(targets=[Target(name="car", **{"position_m": (25, 3, 0.2), **of})], ego=ego)


def at(scene, time_s):
    return scene.positions_m([time_s])[0]


def test_a_radar_that_turns_goes_along_an_arc():
    # Gauss's quadrature of the velocity, 40 points over 5 rad: as exact as doubles are.
    x, weights = np.polynomial.legendre.leggauss(40)
    for time_s in (0.3, 2.0, 8.0):
        times_s = time_s * (x + 1) / 2
        integral = time_s / 2 * weights @ IN_A_BEND.velocities_m_per_s(times_s)
        assert IN_A_BEND.displacements_m(np.array([time_s]))[0] == pytest.approx(
            integral, abs=1e-12
        )


def test_a_bend_of_hardly_any_rate_is_a_straight_line():
    straight = replace(IN_A_BEND, turn_rate_rad_per_s=0)
    times_s = np.array([0.0, 1.0, 100.0])
    for rate in (1e-300, 1e-15, 1e-12):
        bend = replace(IN_A_BEND, turn_rate_rad_per_s=rate)
        # 18.4 m/s for 100 s turned by half of 1e-10 rad: 1e-7 m aside.
        assert bend.displacements_m(times_s) == pytest.approx(
            straight.displacements_m(times_s), abs=1e5 * rate
        )


def test_a_full_turn_comes_back_to_where_it_began():
    ego = replace(IN_A_BEND, velocity_m_per_s=(18, 4, 0))
    turn_s = 2 * np.pi / ego.turn_rate_rad_per_s

    assert ego.displacements_m(np.array([turn_s])) == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert ego.axes(np.array([turn_s])) == pytest.approx(ego.axes(np.zeros(1)), abs=1e-14)


@pytest.mark.parametrize(
    ("pose", "seen_m"),
    [
        ({}, (4, 3, 2)),
        ({"position_m": (1, 1, 1)}, (3, 2, 1)),
        ({"yaw_rad": np.pi / 2}, (3, -4, 2)),  # looks left: what was left is ahead
        ({"pitch_rad": np.pi / 2}, (2, 3, -4)),  # looks up: what was up is ahead
        ({"roll_rad": np.pi / 2}, (4, 2, -3)),  # left side up: what was up is left
        ({"yaw_rad": np.pi / 2, "pitch_rad": np.pi / 2}, (2, -4, -3)),  # left, then up
    ],
)
def test_a_target_is_where_the_pose_of_the_radar_lets_it_be(pose, seen_m):
    scene = one(position_m=(4, 3, 2), ego=Ego(**pose))

    assert at(scene, 0.0)[0] == pytest.approx(seen_m, abs=1e-12)


def test_a_radar_that_turns_left_sees_what_stands_go_right():
    scene = one(position_m=(30, 0, 0), ego=Ego(turn_rate_rad_per_s=0.5))
    x, y, _ = at(scene, 0.4)[0]

    assert np.arctan2(y, x) == pytest.approx(-0.2, abs=1e-12)
    assert np.hypot(x, y) == pytest.approx(30, abs=1e-12)


def test_what_a_radar_on_the_same_arc_carries_along_stays_where_it_is():
    # A point rigid to the car at (5, 1, 0.3) of the radar: another Ego on its own arc.
    lever = np.array([5, 1, 0.3]) @ IN_A_BEND.axes(np.zeros(1))[0].T
    about_z = np.cross([0, 0, IN_A_BEND.turn_rate_rad_per_s], lever)
    carried = replace(
        IN_A_BEND,
        position_m=tuple(IN_A_BEND.position_m + lever),
        velocity_m_per_s=tuple(IN_A_BEND.velocity_m_per_s + about_z),
    )
    times_s = np.linspace(0, 6, 7)
    apart_m = carried.displacements_m(times_s) - IN_A_BEND.displacements_m(times_s) + lever
    seen_m = np.einsum("ti,tij->tj", apart_m, IN_A_BEND.axes(times_s))

    assert seen_m == pytest.approx(np.tile([5, 1, 0.3], (7, 1)), abs=1e-12)


def test_an_accelerated_target_goes_along_a_parabola():
    scene = one(velocity_m_per_s=(-10, 1, 0), acceleration_m_per_s2=(3, 0, -9.81))

    # 25 - 10 x 2 + 3 x 2, 3 + 2, 0.2 - 9.81 x 2.
    assert at(scene, 2.0)[0] == pytest.approx((11, 5, -19.42), abs=1e-12)


def test_a_path_goes_through_its_waypoints_without_jumps_up_to_the_acceleration():
    target = Target(position_m=(25, 3, 0.2), waypoints=SWERVING)
    for point in SWERVING:
        way_m = target.displacements_m(np.array([point.time_s]))[0]
        assert target.position_m + way_m == pytest.approx(point.position_m, abs=1e-12)
    step_s = 1e-5
    for knot_s in (0.5, 1.2, 2.0):  # the last as well: straight on with acceleration 0
        before, here, after = target.velocities_at_m_per_s(knot_s + step_s * np.arange(-1, 2))
        # Accelerations to both sides differ by the third derivative, 500 m/s^3, times 1e-5 s.
        assert (after - here) / step_s == pytest.approx((here - before) / step_s, abs=2e-2)
    (start, soon) = target.velocities_at_m_per_s(np.array([0.0, step_s]))
    assert (soon - start) / step_s == pytest.approx(np.zeros(3), abs=2e-2)
    end, later = target.velocities_at_m_per_s(np.array([2.0, 7.0]))
    assert later == pytest.approx(end, abs=1e-12)
    last_m = np.array(SWERVING[-1].position_m) + 5 * end
    assert target.position_m + target.displacements_m(np.array([7.0]))[0] == pytest.approx(
        last_m, abs=1e-9
    )


def test_the_velocity_of_a_path_is_how_fast_it_goes():
    target = Target(position_m=(25, 3, 0.2), waypoints=SWERVING)
    times_s, step_s = np.linspace(0.1, 2.5, 13), 1e-6
    ahead, behind = (
        target.displacements_m(times_s + step_s),
        target.displacements_m(times_s - step_s),
    )

    # Roundings of 40 m over 2 us.
    numeric = (ahead - behind) / (2 * step_s)
    assert target.velocities_at_m_per_s(times_s) == pytest.approx(numeric, abs=1e-8)


def test_waypoints_at_equal_steps_are_a_straight_line_at_constant_speed():
    points = [Waypoint(time_s=t, position_m=(25 + 8 * t, 3 - 2 * t, 0.2)) for t in (0.7, 1.0, 3.0)]
    for given in (points, points[:1]):
        bent = one(waypoints=given)
        straight = one(velocity_m_per_s=(8, -2, 0))
        for time_s in (0.0, 0.2, 0.9, 2.0, 10.0):
            assert at(bent, time_s) == pytest.approx(at(straight, time_s), abs=1e-12)


AHEAD = Points(scatterers=(Scatterer(position_m=(1, 0, 0), rcs_m2=1),))


@pytest.mark.parametrize(
    ("motion", "time_s", "nose"),
    [
        ({}, 1.0, (1, 0)),
        ({"velocity_m_per_s": (0, -3, 0)}, 1.0, (0, -1)),
        ({"velocity_m_per_s": (0, 0, 5)}, 1.0, (1, 0)),  # a lift
        ({"velocity_m_per_s": (0, -3, 0), "heading_rad": np.pi}, 1.0, (-1, 0)),
        ({"acceleration_m_per_s2": (0, 2, 0)}, 0.0, (0, 1)),  # about to go
        # It brakes, and backs up after 2 s.
        ({"velocity_m_per_s": (4, 0, 0), "acceleration_m_per_s2": (-2, 0, 0)}, 5.0, (1, 0)),
        ({"velocity_m_per_s": (3, 0, 0), "acceleration_m_per_s2": (0, 2, 0)}, 2.0, (0.6, 0.8)),
        ({"waypoints": SWERVING[:1]}, 0.3, (np.sqrt(9 / 13), np.sqrt(4 / 13))),
    ],
)
def test_a_body_faces_where_it_goes_or_as_it_is_told(motion, time_s, nose):
    body, origin = one(body=AHEAD, **motion), one(**motion)

    assert (at(body, time_s) - at(origin, time_s))[0, :2] == pytest.approx(nose, abs=1e-12)


def test_a_body_in_a_curve_turns_with_its_path():
    body, origin = one(body=AHEAD, waypoints=SWERVING), one(waypoints=SWERVING)
    for time_s in (0.1, 0.8, 1.6, 3.0):
        vx, vy, _ = origin.target_velocities_m_per_s([time_s])[0, 0]
        nose = (at(body, time_s) - at(origin, time_s))[0, :2]
        assert nose == pytest.approx(np.array([vx, vy]) / np.hypot(vx, vy), abs=1e-12)


def test_positions_are_those_of_fifty_digits():
    mp.mp.dps = 50
    wheel = replace(WHEEL[2], rotation=replace(WHEEL[2].rotation, axis=(0.6, 0.8, 0)))
    scene = one(velocity_m_per_s=(5, -12, 0.3), body=Points(scatterers=(wheel,)), ego=IN_A_BEND)
    for time_s in (0.0, 0.0123, 4.56):
        found = at(scene, time_s)[0]
        # Roundings of coordinates of up to 100 m, and of 456 rad of the wheel.
        assert [float(abs(x - y)) for x, y in zip(found, exact_m(wheel, time_s), strict=True)] == (
            pytest.approx([0, 0, 0], abs=1e-13)
        )


def exact_m(wheel, time_s):
    """Where the wheel's point of that scene is, in 50 digits."""
    t, ego, w = mp.mpf(time_s), IN_A_BEND, mp.mpf(IN_A_BEND.turn_rate_rad_per_s)
    vx, vy, vz = map(mp.mpf, ego.velocity_m_per_s)
    ego_m = mp.matrix(
        [
            (vx * mp.sin(w * t) - vy * (1 - mp.cos(w * t))) / w,
            (vy * mp.sin(w * t) + vx * (1 - mp.cos(w * t))) / w,
            vz * t,
        ]
    ) + mp.matrix(ego.position_m)
    k = mp.matrix(wheel.rotation.axis) / mp.norm(mp.matrix(wheel.rotation.axis))
    arm = mp.matrix(wheel.position_m) - mp.matrix(wheel.rotation.center_m)
    angle = wheel.rotation.rate_rad_per_s * t
    across = mp.matrix(
        [
            k[1] * arm[2] - k[2] * arm[1],
            k[2] * arm[0] - k[0] * arm[2],
            k[0] * arm[1] - k[1] * arm[0],
        ]
    )
    along = (k.T * arm)[0] * k
    offset = mp.matrix(wheel.rotation.center_m) + along
    offset += (arm - along) * mp.cos(angle) + across * mp.sin(angle)
    at_m = mp.matrix([25, 3, mp.mpf(0.2)]) + t * mp.matrix([5, -12, mp.mpf(0.3)])
    at_m += turned(mp.atan2(-12, 5), 2, 0) * offset
    axes = turned(ego.yaw_rad + w * t, 2, 0) * turned(-ego.pitch_rad, 1, 2)
    return (axes * turned(ego.roll_rad, 0, 1)).T * (at_m - ego_m)


def turned(angle, about, first):
    """Rotation about an axis by the right hand, the first after it in their round."""
    first, second = (about + 1) % 3, (about + 2) % 3
    made = mp.eye(3)
    made[first, first] = made[second, second] = mp.cos(angle)
    made[first, second], made[second, first] = -mp.sin(angle), mp.sin(angle)
    return made


PAST = {"velocity_m_per_s": (-20, 4, 0.1)}
CASES = {
    "straight": one(**PAST),
    "accelerated": one(**PAST, acceleration_m_per_s2=(5, 0, -9.81)),
    "rigid body": one(**PAST, body=Points(scatterers=BOX)),
    "body of given heading in a curve": one(
        **PAST, acceleration_m_per_s2=(0, 5, 0), heading_rad=1.0, body=Points(scatterers=BOX)
    ),
    "body in a curve": one(**PAST, acceleration_m_per_s2=(0, 5, 0), body=Points(scatterers=BOX)),
    "wheels at 100 rad/s": one(**PAST, body=Points(scatterers=(*BOX, *WHEEL))),
    "walker": one(velocity_m_per_s=(1, 1, 0), body=Points(scatterers=WALKER)),
    "waypoints": one(waypoints=SWERVING),
    "turning radar": one(**PAST, ego=IN_A_BEND),
    "all": replace(
        one(waypoints=SWERVING, body=Points(scatterers=(*WHEEL, *WALKER, *BOX)), ego=IN_A_BEND),
        targets=(
            Target(position_m=(30, 3, 0.2), waypoints=SWERVING, body=Points(scatterers=WHEEL)),
            Target(position_m=(20, -3, 0.2), **PAST),
        ),
    ),
}
IN_PARABOLAS = ("straight", "accelerated", "rigid body", "body of given heading in a curve")


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("start_s", [0.0, 0.4975, 1.4])  # 0.5 s, a waypoint, is in the second
def test_paths_are_where_scatterers_are(radar, case, start_s):
    scene, frame = CASES[case], replace(radar.frame, n_chirps=256)
    rng = np.random.default_rng(71)
    found = fit_paths(scene, frame, start_s)
    for path in found:
        chirps = rng.integers(path.chirps.start, path.chirps.stop, 20)
        # From the start of the ramp to the last sample.
        times_s = chirps * frame.interval_s + rng.uniform(0, 27.5e-6, 20)
        exact_m = scene.positions_m(start_s + times_s)[:, path.scatterers]
        powers = (times_s - path.mid_s)[:, None] ** np.arange(len(path.path_m))
        # 1e-9 rad at 77 GHz, there and back; a chirp in which a waypoint is, where the turning
        # of a body changes its rate, is not divided.
        close_m = 3e-13 if path.chirps.stop - path.chirps.start > 1 else 1e-10
        assert np.einsum("tk,knx->tnx", powers, path.path_m) == pytest.approx(exact_m, abs=close_m)
        assert len(path.path_m) <= (3 if case in IN_PARABOLAS else 8)
    assert len(found) == 1 or case not in IN_PARABOLAS


@pytest.mark.parametrize("case", CASES)
def test_each_scatterer_has_one_path_in_each_chirp(radar, case):
    scene, frame = CASES[case], radar.frame
    times = np.zeros((frame.n_chirps_total, scene.n_scatterers), int)
    for path in fit_paths(scene, frame, 0.49):
        times[path.chirps, path.scatterers] += 1

    assert (times == 1).all()


def test_only_what_needs_it_has_short_paths(radar):
    far = [Target(position_m=(50, y, 0), velocity_m_per_s=(y, 0, 0)) for y in range(40)]
    wheel = Target(position_m=(30, 3, 0), body=Points(scatterers=(*BOX, *WHEEL)))
    frame = replace(radar.frame, n_chirps=512)
    for ego in (Ego(), IN_A_BEND):
        found = fit_paths(Scene(targets=[*far, wheel], ego=ego), frame, 0.0)
        everywhere = [path for path in found if path.chirps == slice(0, 512)]

        assert sum(len(path.scatterers) for path in everywhere) == 40 + len(BOX)
        assert {len(path.scatterers) for path in found} == (
            {40, len(BOX), len(WHEEL)} if ego == Ego() else {40 + len(BOX), len(WHEEL)}
        )


def test_a_scene_without_targets_has_no_paths(radar):
    for ego in (Ego(), IN_A_BEND):
        assert fit_paths(Scene(ego=ego), radar.frame, 0.0) == []
        assert Scene(ego=ego).positions_m([0.0, 1.0]).shape == (2, 0, 3)


def test_late_frames_and_far_coordinates_are_followed_as_far_as_doubles_go(radar):
    # Five hours on, and 6,000 km from the origin of the scene: roundings of 1e-9 m.
    ego = replace(IN_A_BEND, position_m=(6e6, 3e6, 0))
    near = one(position_m=(6e6 + 30, 3e6, 0), velocity_m_per_s=(1, 1, 0), ego=ego)
    assert len(fit_paths(near, radar.frame, 0.0)) == 1
    assert len(fit_paths(near, radar.frame, 18000.0)) == 1
    assert len(fit_paths(one(waypoints=SWERVING, body=AHEAD), radar.frame, 18000.0)) == 1


@frozen_dataclass
class Jumping(Body):
    """Two points, one of which is somewhere else from 2 ms on."""

    to_m: float

    def offsets_m(self, times_s):
        offsets_m = np.zeros((len(times_s), 2, 3))
        offsets_m[times_s > 0.00203, 1] = self.to_m
        return offsets_m

    def cross_sections_m2(self):
        return np.ones(2)


def test_a_body_that_jumps_or_is_nowhere_is_refused_by_the_name_of_its_target(radar):
    with pytest.raises(dc.InvalidSetting, match=r"scene\.targets\.car: a motion in the"):
        fit_paths(one(body=Jumping(to_m=0.1)), radar.frame, 0.0)
    for ego in (Ego(), IN_A_BEND):
        with pytest.raises(dc.InvalidSetting, match=r"targets\.car\.body: .* not finite"):
            fit_paths(one(body=Jumping(to_m=np.nan), ego=ego), radar.frame, 0.0)


@pytest.mark.parametrize("case", CASES)
def test_the_true_velocity_is_the_rate_of_change_of_the_true_range(radar, case):
    scene = CASES[case]
    radar = replace(radar, frame=replace(radar.frame, period_s=0.3))
    known = truth(scene, radar, n_frames=6)
    step_s = 1e-5
    for frame in range(6):
        time_s = float(known.time[frame])
        nearer, farther = np.linalg.norm(
            scene.target_positions_m([time_s - step_s, time_s + step_s]), axis=-1
        )
        # Roundings of 1e-14 m over 20 us, and a third derivative of 1e4 m/s^3 times 2e-11 s^2.
        numeric = (farther - nearer) / (2 * step_s)
        assert known.velocity[:, frame].values == pytest.approx(numeric, abs=1e-6)


def test_the_truth_tells_directions_in_the_axes_of_the_radar(radar):
    ego = Ego(yaw_rad=0.4, pitch_rad=0.1, velocity_m_per_s=(30, 0, 0), turn_rate_rad_per_s=1.0)
    scene = one(position_m=(40, 2, 1), ego=ego)
    known = truth(scene, radar).isel(target=0, frame=0)
    time_s = radar.frame.mid_frame_s
    x, y, z = at(scene, time_s)[0]

    assert known.range.item() == pytest.approx(np.sqrt(x**2 + y**2 + z**2), rel=1e-14)
    assert known.azimuth.item() == pytest.approx(np.arctan2(y, x), abs=1e-14)
    assert known.elevation.item() == pytest.approx(np.arcsin(z / known.range.item()), abs=1e-14)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"waypoints": SWERVING[::-1]},
            r"Target\.waypoints\.1\.time_s: 1\.2 s after 2 s: the path of car goes back",
        ),
        ({"waypoints": SWERVING[:1] * 2}, "path of car goes back in time"),
        ({"waypoints": [(1, 2, 3)]}, r"Target\.waypoints.* a Waypoint"),
        ({"waypoints": 5}, r"Target\.waypoints.* a Waypoint"),
        ({"waypoints": np.array(np.nan)}, r"Target\.waypoints.* a Waypoint"),
        ({"waypoints": np.zeros((2, 3))}, r"Target\.waypoints.* a Waypoint"),
        (
            {"waypoints": SWERVING, "velocity_m_per_s": (1, 0, 0)},
            "velocity_m_per_s: .* in addition to waypoints",
        ),
        (
            {"waypoints": SWERVING, "acceleration_m_per_s2": (0, 1, 0)},
            "acceleration_m_per_s2: .* in addition to waypoints",
        ),
        (
            {"waypoints": [Waypoint(time_s=1e-6, position_m=(26, 3, 0.2))]},
            r"Target\.waypoints: 1e\+06 m/s between them",
        ),
        ({"acceleration_m_per_s2": (np.nan, 0, 0)}, "acceleration_m_per_s2"),
        ({"acceleration_m_per_s2": np.array(1.0)}, "acceleration_m_per_s2"),
        ({"position_m": (10**400, 0, 0)}, "position_m"),
        ({"rcs_m2": 10**400}, "rcs_m2"),
        ({"fluctuation": np.array(["steady", "steady"])}, "fluctuation"),
        ({"heading_rad": 90}, "heading_rad: 90"),
        ({"body": "car"}, r"Target\.body: car; expected a Body, or none"),
    ],
)
def test_a_motion_that_cannot_be_is_refused(wrong, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        one(**wrong)


def test_no_waypoints_are_none_in_whatever_list():
    straight = one(waypoints=())
    for none in ([], np.zeros((0, 3)), iter(())):
        assert one(waypoints=none) == straight


@pytest.mark.parametrize("time_s", [0, -1, np.inf, "1", 10**400])
def test_a_waypoint_is_at_a_time_after_time_zero(time_s):
    with pytest.raises(dc.InvalidSetting, match=r"Waypoint\.time_s"):
        Waypoint(time_s=time_s, position_m=(1, 0, 0))


@pytest.mark.parametrize(
    "wrong",
    [{"yaw_rad": 30}, {"turn_rate_rad_per_s": np.nan}, {"position_m": (1, 2)}, {"roll_rad": None}],
)
def test_a_pose_that_cannot_be_is_refused(wrong):
    (name,) = wrong
    with pytest.raises(dc.InvalidSetting, match=rf"Ego\.{name}"):
        Ego(**wrong)


def test_many_targets_and_a_cloud_of_them_go_the_same_ways(radar):
    rng = np.random.default_rng(72)
    places_m = rng.uniform((1, -50, -1), (200, 50, 3), (300, 3))
    cloud = one(**PAST, body=PointCloud(positions_m=places_m, rcs_m2=np.ones(300)), heading_rad=0.0)
    targets = [Target(position_m=tuple(np.add(p, (25, 3, 0.2))), **PAST) for p in places_m]
    (of_cloud,) = fit_paths(cloud, radar.frame, 0.3)
    (of_targets,) = fit_paths(Scene(targets=targets), radar.frame, 0.3)

    assert of_cloud.path_m == pytest.approx(of_targets.path_m, abs=1e-13)
