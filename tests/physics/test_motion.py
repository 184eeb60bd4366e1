"""Motion of targets and radar: poses, arcs, parabolas, waypoints and path polynomials."""

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
from dechirp.scene.trajectories import fit_polynomial_paths
from dechirp.scene.truth import truth
from dechirp.scene.waypoints import Waypoint

TURNING_EGO = Ego(
    position_m=(3, -2, 0.5),
    yaw_rad=0.3,
    pitch_rad=0.05,
    roll_rad=-0.1,
    velocity_m_per_s=(18, 4, -0.2),
    turn_rate_rad_per_s=0.6,
)
SWERVE_WAYPOINTS = (
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


def build_scene(**target_settings):
    """Build a scene of one target named car, with optional ego motion."""
    ego = target_settings.pop("ego", Ego())
    return Scene(
        targets=[Target(name="car", **{"position_m": (25, 3, 0.2), **target_settings})], ego=ego
    )


def compute_positions_m(scene, time_s):
    return scene.scatterer_positions_m([time_s])[0]


def test_turning_radar_follows_arc():
    # Gauss-Legendre quadrature of the velocity, 40 points over 5 rad: exact to double precision.
    x, weights = np.polynomial.legendre.leggauss(40)
    for time_s in (0.3, 2.0, 8.0):
        times_s = time_s * (x + 1) / 2
        integral = time_s / 2 * weights @ TURNING_EGO.velocities_m_per_s(times_s)
        assert TURNING_EGO.displacements_m(np.array([time_s]))[0] == pytest.approx(
            integral, abs=1e-12
        )


def test_vanishing_turn_rate_gives_straight_line():
    straight_ego = replace(TURNING_EGO, turn_rate_rad_per_s=0)
    times_s = np.array([0.0, 1.0, 100.0])
    for rate in (1e-300, 1e-15, 1e-12):
        bent_ego = replace(TURNING_EGO, turn_rate_rad_per_s=rate)
        # 18.4 m/s for 100 s turned by half of 1e-10 rad: 1e-7 m aside.
        assert bent_ego.displacements_m(times_s) == pytest.approx(
            straight_ego.displacements_m(times_s), abs=1e5 * rate
        )


def test_full_turn_returns_to_start():
    ego = replace(TURNING_EGO, velocity_m_per_s=(18, 4, 0))
    turn_s = 2 * np.pi / ego.turn_rate_rad_per_s

    assert ego.displacements_m(np.array([turn_s])) == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert ego.axes(np.array([turn_s])) == pytest.approx(ego.axes(np.zeros(1)), abs=1e-14)


@pytest.mark.parametrize(
    ("pose", "expected_m"),
    [
        ({}, (4, 3, 2)),
        ({"position_m": (1, 1, 1)}, (3, 2, 1)),
        ({"yaw_rad": np.pi / 2}, (3, -4, 2)),  # boresight left: the left side is ahead
        ({"pitch_rad": np.pi / 2}, (2, 3, -4)),  # boresight up: the zenith is ahead
        ({"roll_rad": np.pi / 2}, (4, 2, -3)),  # left side up: the zenith is left
        ({"yaw_rad": np.pi / 2, "pitch_rad": np.pi / 2}, (2, -4, -3)),  # left, then up
    ],
)
def test_target_position_follows_radar_pose(pose, expected_m):
    scene = build_scene(position_m=(4, 3, 2), ego=Ego(**pose))

    assert compute_positions_m(scene, 0.0)[0] == pytest.approx(expected_m, abs=1e-12)


def test_static_target_moves_right_for_left_turning_radar():
    scene = build_scene(position_m=(30, 0, 0), ego=Ego(turn_rate_rad_per_s=0.5))
    x, y, _ = compute_positions_m(scene, 0.4)[0]

    assert np.arctan2(y, x) == pytest.approx(-0.2, abs=1e-12)
    assert np.hypot(x, y) == pytest.approx(30, abs=1e-12)


def test_point_fixed_to_vehicle_stays_fixed_in_radar_axes():
    # A point fixed to the vehicle at (5, 1, 0.3) from the radar: a second Ego on its own arc.
    lever = np.array([5, 1, 0.3]) @ TURNING_EGO.axes(np.zeros(1))[0].T
    lever_velocity = np.cross([0, 0, TURNING_EGO.turn_rate_rad_per_s], lever)
    carried_ego = replace(
        TURNING_EGO,
        position_m=tuple(TURNING_EGO.position_m + lever),
        velocity_m_per_s=tuple(TURNING_EGO.velocity_m_per_s + lever_velocity),
    )
    times_s = np.linspace(0, 6, 7)
    separation_m = (
        carried_ego.displacements_m(times_s) - TURNING_EGO.displacements_m(times_s) + lever
    )
    position_m = np.einsum("ti,tij->tj", separation_m, TURNING_EGO.axes(times_s))

    assert position_m == pytest.approx(np.tile([5, 1, 0.3], (7, 1)), abs=1e-12)


def test_accelerated_target_follows_parabola():
    scene = build_scene(velocity_m_per_s=(-10, 1, 0), acceleration_m_per_s2=(3, 0, -9.81))

    # 25 - 10 x 2 + 3 x 2, 3 + 2, 0.2 - 9.81 x 2.
    assert compute_positions_m(scene, 2.0)[0] == pytest.approx((11, 5, -19.42), abs=1e-12)


def test_path_passes_waypoints_with_continuous_acceleration():
    target = Target(position_m=(25, 3, 0.2), waypoints=SWERVE_WAYPOINTS)
    for point in SWERVE_WAYPOINTS:
        displacement_m = target.displacements_m(np.array([point.time_s]))[0]
        assert target.position_m + displacement_m == pytest.approx(point.position_m, abs=1e-12)
    step_s = 1e-5
    for knot_s in (0.5, 1.2, 2.0):  # the last one, too: straight line with acceleration 0
        velocity_before, velocity_at_knot, velocity_after = target.velocities_at_m_per_s(
            knot_s + step_s * np.arange(-1, 2)
        )
        # Accelerations on both sides differ by the third derivative, 500 m/s^3, times 1e-5 s.
        assert (velocity_after - velocity_at_knot) / step_s == pytest.approx(
            (velocity_at_knot - velocity_before) / step_s, abs=2e-2
        )
    (start_velocity, next_velocity) = target.velocities_at_m_per_s(np.array([0.0, step_s]))
    assert (next_velocity - start_velocity) / step_s == pytest.approx(np.zeros(3), abs=2e-2)
    end_velocity, late_velocity = target.velocities_at_m_per_s(np.array([2.0, 7.0]))
    assert late_velocity == pytest.approx(end_velocity, abs=1e-12)
    last_m = np.array(SWERVE_WAYPOINTS[-1].position_m) + 5 * end_velocity
    assert target.position_m + target.displacements_m(np.array([7.0]))[0] == pytest.approx(
        last_m, abs=1e-9
    )


def test_path_velocity_is_derivative_of_displacement():
    target = Target(position_m=(25, 3, 0.2), waypoints=SWERVE_WAYPOINTS)
    times_s, step_s = np.linspace(0.1, 2.5, 13), 1e-6
    ahead_m, behind_m = (
        target.displacements_m(times_s + step_s),
        target.displacements_m(times_s - step_s),
    )

    # Rounding errors of 40 m over 2 us.
    numeric = (ahead_m - behind_m) / (2 * step_s)
    assert target.velocities_at_m_per_s(times_s) == pytest.approx(numeric, abs=1e-8)


def test_collinear_waypoints_give_constant_velocity():
    points = [Waypoint(time_s=t, position_m=(25 + 8 * t, 3 - 2 * t, 0.2)) for t in (0.7, 1.0, 3.0)]
    for waypoints in (points, points[:1]):
        waypoint_scene = build_scene(waypoints=waypoints)
        straight_scene = build_scene(velocity_m_per_s=(8, -2, 0))
        for time_s in (0.0, 0.2, 0.9, 2.0, 10.0):
            assert compute_positions_m(waypoint_scene, time_s) == pytest.approx(
                compute_positions_m(straight_scene, time_s), abs=1e-12
            )


NOSE_POINT = Points(scatterers=(Scatterer(position_m=(1, 0, 0), rcs_m2=1),))


@pytest.mark.parametrize(
    ("motion", "time_s", "nose"),
    [
        ({}, 1.0, (1, 0)),
        ({"velocity_m_per_s": (0, -3, 0)}, 1.0, (0, -1)),
        ({"velocity_m_per_s": (0, 0, 5)}, 1.0, (1, 0)),  # vertical motion
        ({"velocity_m_per_s": (0, -3, 0), "heading_rad": np.pi}, 1.0, (-1, 0)),
        ({"acceleration_m_per_s2": (0, 2, 0)}, 0.0, (0, 1)),  # at rest, accelerating
        # Braking, and reversing after 2 s.
        ({"velocity_m_per_s": (4, 0, 0), "acceleration_m_per_s2": (-2, 0, 0)}, 5.0, (1, 0)),
        ({"velocity_m_per_s": (3, 0, 0), "acceleration_m_per_s2": (0, 2, 0)}, 2.0, (0.6, 0.8)),
        ({"waypoints": SWERVE_WAYPOINTS[:1]}, 0.3, (np.sqrt(9 / 13), np.sqrt(4 / 13))),
    ],
)
def test_body_heading_follows_motion_or_setting(motion, time_s, nose):
    body, origin = build_scene(body=NOSE_POINT, **motion), build_scene(**motion)

    assert (compute_positions_m(body, time_s) - compute_positions_m(origin, time_s))[
        0, :2
    ] == pytest.approx(nose, abs=1e-12)


def test_body_in_curve_turns_with_its_path():
    body, origin = (
        build_scene(body=NOSE_POINT, waypoints=SWERVE_WAYPOINTS),
        build_scene(waypoints=SWERVE_WAYPOINTS),
    )
    for time_s in (0.1, 0.8, 1.6, 3.0):
        vx, vy, _ = origin.target_velocities_m_per_s([time_s])[0, 0]
        nose = (compute_positions_m(body, time_s) - compute_positions_m(origin, time_s))[0, :2]
        assert nose == pytest.approx(np.array([vx, vy]) / np.hypot(vx, vy), abs=1e-12)


def test_positions_match_50_digit_reference():
    mp.mp.dps = 50
    wheel = replace(WHEEL[2], rotation=replace(WHEEL[2].rotation, axis=(0.6, 0.8, 0)))
    scene = build_scene(
        velocity_m_per_s=(5, -12, 0.3), body=Points(scatterers=(wheel,)), ego=TURNING_EGO
    )
    for time_s in (0.0, 0.0123, 4.56):
        position_m = compute_positions_m(scene, time_s)[0]
        # Rounding errors of coordinates up to 100 m and of 456 rad of the wheel.
        assert [
            float(abs(x - y))
            for x, y in zip(position_m, compute_exact_position_m(wheel, time_s), strict=True)
        ] == (pytest.approx([0, 0, 0], abs=1e-13))


def compute_exact_position_m(wheel, time_s):
    """Compute the position of the wheel's scatterer in that scene with 50 digits."""
    t, ego, w = mp.mpf(time_s), TURNING_EGO, mp.mpf(TURNING_EGO.turn_rate_rad_per_s)
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
    normal = mp.matrix(
        [
            k[1] * arm[2] - k[2] * arm[1],
            k[2] * arm[0] - k[0] * arm[2],
            k[0] * arm[1] - k[1] * arm[0],
        ]
    )
    parallel = (k.T * arm)[0] * k
    offset = mp.matrix(wheel.rotation.center_m) + parallel
    offset += (arm - parallel) * mp.cos(angle) + normal * mp.sin(angle)
    target_m = mp.matrix([25, 3, mp.mpf(0.2)]) + t * mp.matrix([5, -12, mp.mpf(0.3)])
    target_m += build_rotation_matrix(mp.atan2(-12, 5), 2, 0) * offset
    axes = build_rotation_matrix(ego.yaw_rad + w * t, 2, 0) * build_rotation_matrix(
        -ego.pitch_rad, 1, 2
    )
    return (axes * build_rotation_matrix(ego.roll_rad, 0, 1)).T * (target_m - ego_m)


def build_rotation_matrix(angle, axis, first):
    """Build the right-handed rotation matrix about an axis (0, 1 or 2)."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = mp.eye(3)
    matrix[first, first] = matrix[second, second] = mp.cos(angle)
    matrix[first, second], matrix[second, first] = -mp.sin(angle), mp.sin(angle)
    return matrix


PASSING_MOTION = {"velocity_m_per_s": (-20, 4, 0.1)}
CASES = {
    "straight": build_scene(**PASSING_MOTION),
    "accelerated": build_scene(**PASSING_MOTION, acceleration_m_per_s2=(5, 0, -9.81)),
    "rigid body": build_scene(**PASSING_MOTION, body=Points(scatterers=BOX)),
    "body of given heading in a curve": build_scene(
        **PASSING_MOTION,
        acceleration_m_per_s2=(0, 5, 0),
        heading_rad=1.0,
        body=Points(scatterers=BOX),
    ),
    "body in a curve": build_scene(
        **PASSING_MOTION, acceleration_m_per_s2=(0, 5, 0), body=Points(scatterers=BOX)
    ),
    "wheels at 100 rad/s": build_scene(**PASSING_MOTION, body=Points(scatterers=(*BOX, *WHEEL))),
    "walker": build_scene(velocity_m_per_s=(1, 1, 0), body=Points(scatterers=WALKER)),
    "waypoints": build_scene(waypoints=SWERVE_WAYPOINTS),
    "turning radar": build_scene(**PASSING_MOTION, ego=TURNING_EGO),
    "all": replace(
        build_scene(
            waypoints=SWERVE_WAYPOINTS,
            body=Points(scatterers=(*WHEEL, *WALKER, *BOX)),
            ego=TURNING_EGO,
        ),
        targets=(
            Target(
                position_m=(30, 3, 0.2), waypoints=SWERVE_WAYPOINTS, body=Points(scatterers=WHEEL)
            ),
            Target(position_m=(20, -3, 0.2), **PASSING_MOTION),
        ),
    ),
}
PARABOLIC_CASES = ("straight", "accelerated", "rigid body", "body of given heading in a curve")


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("start_s", [0.0, 0.4975, 1.4])  # the second contains the waypoint at 0.5 s
def test_path_polynomials_match_scatterer_positions(radar, case, start_s):
    scene, frame = CASES[case], replace(radar.frame, n_chirps=256)
    rng = np.random.default_rng(71)
    paths = fit_polynomial_paths(scene, frame, start_s)
    for path in paths:
        chirps = rng.integers(path.chirps.start, path.chirps.stop, 20)
        # From the start of the ramp to the last sample.
        times_s = chirps * frame.interval_s + rng.uniform(0, 27.5e-6, 20)
        exact_m = scene.scatterer_positions_m(start_s + times_s)[:, path.scatterers]
        powers = (times_s - path.mid_s)[:, None] ** np.arange(len(path.path_m))
        # 1e-9 rad of two-way phase at 77 GHz; a chirp with a waypoint, where the turn rate of a
        # body jumps, is not divided.
        tolerance_m = 3e-13 if path.chirps.stop - path.chirps.start > 1 else 1e-10
        assert np.einsum("tk,knx->tnx", powers, path.path_m) == pytest.approx(
            exact_m, abs=tolerance_m
        )
        assert len(path.path_m) <= (3 if case in PARABOLIC_CASES else 8)
    assert len(paths) == 1 or case not in PARABOLIC_CASES


@pytest.mark.parametrize("case", CASES)
def test_each_scatterer_has_one_path_in_each_chirp(radar, case):
    scene, frame = CASES[case], radar.frame
    n_paths = np.zeros((frame.n_chirps_total, scene.n_scatterers), int)
    for path in fit_polynomial_paths(scene, frame, 0.49):
        n_paths[path.chirps, path.scatterers] += 1

    assert (n_paths == 1).all()


def test_only_rotating_scatterers_have_short_paths(radar):
    far_targets = [Target(position_m=(50, y, 0), velocity_m_per_s=(y, 0, 0)) for y in range(40)]
    wheel = Target(position_m=(30, 3, 0), body=Points(scatterers=(*BOX, *WHEEL)))
    frame = replace(radar.frame, n_chirps=512)
    for ego in (Ego(), TURNING_EGO):
        paths = fit_polynomial_paths(Scene(targets=[*far_targets, wheel], ego=ego), frame, 0.0)
        whole_frame_paths = [path for path in paths if path.chirps == slice(0, 512)]

        assert sum(len(path.scatterers) for path in whole_frame_paths) == 40 + len(BOX)
        assert {len(path.scatterers) for path in paths} == (
            {40, len(BOX), len(WHEEL)} if ego == Ego() else {40 + len(BOX), len(WHEEL)}
        )


def test_scene_without_targets_has_no_paths(radar):
    for ego in (Ego(), TURNING_EGO):
        assert fit_polynomial_paths(Scene(ego=ego), radar.frame, 0.0) == []
        assert Scene(ego=ego).scatterer_positions_m([0.0, 1.0]).shape == (2, 0, 3)


def test_late_frames_and_far_coordinates_need_one_path(radar):
    # Five hours after the start and 6,000 km from the scene origin: rounding errors of 1e-9 m.
    ego = replace(TURNING_EGO, position_m=(6e6, 3e6, 0))
    near_scene = build_scene(position_m=(6e6 + 30, 3e6, 0), velocity_m_per_s=(1, 1, 0), ego=ego)
    assert len(fit_polynomial_paths(near_scene, radar.frame, 0.0)) == 1
    assert len(fit_polynomial_paths(near_scene, radar.frame, 18000.0)) == 1
    assert (
        len(
            fit_polynomial_paths(
                build_scene(waypoints=SWERVE_WAYPOINTS, body=NOSE_POINT), radar.frame, 18000.0
            )
        )
        == 1
    )


@frozen_dataclass
class JumpingBody(Body):
    """Body of two points, one of which jumps after 2 ms."""

    jump_m: float

    def scatterer_offsets_m(self, times_s):
        offsets_m = np.zeros((len(times_s), 2, 3))
        offsets_m[times_s > 0.00203, 1] = self.jump_m
        return offsets_m

    def cross_sections_m2(self):
        return np.ones(2)


def test_rejects_body_that_jumps_or_is_not_finite(radar):
    with pytest.raises(dc.InvalidSetting, match=r"scene\.targets\.car: a motion in the"):
        fit_polynomial_paths(build_scene(body=JumpingBody(jump_m=0.1)), radar.frame, 0.0)
    for ego in (Ego(), TURNING_EGO):
        with pytest.raises(dc.InvalidSetting, match=r"targets\.car\.body: .* not finite"):
            fit_polynomial_paths(
                build_scene(body=JumpingBody(jump_m=np.nan), ego=ego), radar.frame, 0.0
            )


@pytest.mark.parametrize("case", CASES)
def test_true_velocity_is_derivative_of_true_range(radar, case):
    scene = CASES[case]
    radar = replace(radar, frame=replace(radar.frame, period_s=0.3))
    ground_truth = truth(scene, radar, n_frames=6)
    step_s = 1e-5
    for frame in range(6):
        time_s = float(ground_truth.time[frame])
        range_before_m, range_after_m = np.linalg.norm(
            scene.target_positions_m([time_s - step_s, time_s + step_s]), axis=-1
        )
        # Rounding: 1e-14 m over 20 us; third derivative: 1e4 m/s^3 times 2e-11 s^2.
        numeric = (range_after_m - range_before_m) / (2 * step_s)
        assert ground_truth.velocity[:, frame].values == pytest.approx(numeric, abs=1e-6)


def test_true_angles_are_in_radar_axes(radar):
    ego = Ego(yaw_rad=0.4, pitch_rad=0.1, velocity_m_per_s=(30, 0, 0), turn_rate_rad_per_s=1.0)
    scene = build_scene(position_m=(40, 2, 1), ego=ego)
    ground_truth = truth(scene, radar).isel(target=0, frame=0)
    time_s = radar.frame.mid_frame_s
    x, y, z = compute_positions_m(scene, time_s)[0]

    assert ground_truth.range.item() == pytest.approx(np.sqrt(x**2 + y**2 + z**2), rel=1e-14)
    assert ground_truth.azimuth.item() == pytest.approx(np.arctan2(y, x), abs=1e-14)
    assert ground_truth.elevation.item() == pytest.approx(
        np.arcsin(z / ground_truth.range.item()), abs=1e-14
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"waypoints": SWERVE_WAYPOINTS[::-1]},
            r"Target\.waypoints\.1\.time_s: 1\.2 s after 2 s: the path of car goes back",
        ),
        ({"waypoints": SWERVE_WAYPOINTS[:1] * 2}, "path of car goes back in time"),
        ({"waypoints": [(1, 2, 3)]}, r"Target\.waypoints.* a Waypoint"),
        ({"waypoints": 5}, r"Target\.waypoints.* a Waypoint"),
        ({"waypoints": np.array(np.nan)}, r"Target\.waypoints.* a Waypoint"),
        ({"waypoints": np.zeros((2, 3))}, r"Target\.waypoints.* a Waypoint"),
        (
            {"waypoints": SWERVE_WAYPOINTS, "velocity_m_per_s": (1, 0, 0)},
            "velocity_m_per_s: .* in addition to waypoints",
        ),
        (
            {"waypoints": SWERVE_WAYPOINTS, "acceleration_m_per_s2": (0, 1, 0)},
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
def test_rejects_invalid_motion(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        build_scene(**settings)


def test_empty_waypoint_lists_of_any_type_are_equal():
    static_scene = build_scene(waypoints=())
    for empty_list in ([], np.zeros((0, 3)), iter(())):
        assert build_scene(waypoints=empty_list) == static_scene


@pytest.mark.parametrize("time_s", [0, -1, np.inf, "1", 10**400])
def test_rejects_waypoint_time_that_is_not_positive(time_s):
    with pytest.raises(dc.InvalidSetting, match=r"Waypoint\.time_s"):
        Waypoint(time_s=time_s, position_m=(1, 0, 0))


@pytest.mark.parametrize(
    "settings",
    [{"yaw_rad": 30}, {"turn_rate_rad_per_s": np.nan}, {"position_m": (1, 2)}, {"roll_rad": None}],
)
def test_rejects_invalid_pose(settings):
    (name,) = settings
    with pytest.raises(dc.InvalidSetting, match=rf"Ego\.{name}"):
        Ego(**settings)


def test_point_cloud_follows_same_paths_as_its_targets(radar):
    rng = np.random.default_rng(72)
    positions_m = rng.uniform((1, -50, -1), (200, 50, 3), (300, 3))
    cloud = build_scene(
        **PASSING_MOTION,
        body=PointCloud(positions_m=positions_m, rcs_m2=np.ones(300)),
        heading_rad=0.0,
    )
    targets = [
        Target(position_m=tuple(np.add(p, (25, 3, 0.2))), **PASSING_MOTION) for p in positions_m
    ]
    (cloud_path,) = fit_polynomial_paths(cloud, radar.frame, 0.3)
    (target_path,) = fit_polynomial_paths(Scene(targets=targets), radar.frame, 0.3)

    assert cloud_path.path_m == pytest.approx(target_path.path_m, abs=1e-13)
