"""Traffic around a radar: bounded paths, poses, presence, bodies and the view of each frame."""

import math
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.traffic.frame_scenes import FrameScenes
from dechirp.traffic.motion import MAX_ACCELERATION_M_PER_S2, fit_paths
from dechirp.traffic.mounting import Mounting
from dechirp.traffic.outlines import visible_shares

EXAMPLES = Path(__file__).parents[2] / "examples"
HEADER = "time,id,class,x,y,heading,length,width,height"


@pytest.fixture(scope="module")
def radar():
    return dc.load(EXAMPLES / "highway.yaml").radar


def open_rows(folder, *rows, header=HEADER):
    path = folder / "traffic.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return dc.open_traffic(path)


def states(number, times_s, x_m, y_m, heading=None, kind="car", size="4.5,1.8,1.5"):
    """Return rows of an object; positions and headings are functions of time."""
    return [
        f"{t:.9g},{number},{kind},{x_m(t):.12g},{y_m(t):.12g},"
        f"{'' if heading is None else f'{heading(t):.12g}'},{size}"
        for t in times_s
    ]


def constant(value):
    return lambda t: value


STEPS_S = np.arange(0, 2.01, 0.1)


def test_scene_follows_both_vehicles_within_a_frame(tmp_path, radar):
    # The radar turns with its car on a circle of 30 m at 9 m/s (0.3 rad/s), and a truck brakes.
    # Cubic Hermite errors at 0.1 s steps: h^4/384 times the fourth derivative, 9 * 0.3^3 m/s^4,
    # below 1e-7 m; the frame adds the third derivative, 0.8 m/s^3 * (4 ms)^3 / 6, 1e-8 m.
    def turned(t):
        return 0.3 * t

    rows = states(
        1,
        STEPS_S,
        lambda t: 30 * math.sin(turned(t)),
        lambda t: 30 * (1 - math.cos(turned(t))),
        turned,
    )
    rows += states(
        2, STEPS_S, lambda t: 40 + 5 * t - 1.5 * t**2, constant(3.0), constant(0.1), "truck"
    )
    traffic = open_rows(tmp_path, *rows)
    scenes = FrameScenes(
        traffic, radar, ego=1, mount=Mounting(position_m=(2.0, 0.5, 0.7), yaw_rad=0.2)
    )
    number = 17
    start_s = radar.frame.frame_start_s(number)
    within_s = np.linspace(0, radar.frame.duration_s, 5)

    positions_m = scenes.scene(number).target_positions_m(within_s)[:, 0]

    for t, position_m in zip(start_s + within_s, positions_m, strict=True):
        yaw = turned(t)
        forward, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        place_m = 30 * np.array([np.sin(yaw), 1 - np.cos(yaw)]) + 2.0 * forward + 0.5 * left
        offset_m = np.array([40 + 5 * t - 1.5 * t**2, 3.0]) - place_m
        axes = np.array(
            [[np.cos(yaw + 0.2), np.sin(yaw + 0.2)], [-np.sin(yaw + 0.2), np.cos(yaw + 0.2)]]
        )
        # Stated positions have derived velocities with an error of h^2/6 times the third
        # derivative, 1.3e-3 m/s: up to 1e-4 m between the steps.
        assert position_m == pytest.approx([*(axes @ offset_m), -0.7], abs=2e-4)
    (truck,) = scenes.scene(number).targets
    assert truck.name == "truck-2"
    assert truck.body.speed_m_per_s == pytest.approx(5 - 3 * scenes.mid_frame_s(number), abs=0.05)


def test_relative_velocity_is_the_derivative_of_positions_over_frames(tmp_path, radar):
    rows = states(1, STEPS_S, lambda t: 10 * t, constant(0.0))
    rows += states(2, STEPS_S, lambda t: 50 + 4 * t, lambda t: 2 * t)
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)
    frames = [0, 10, 20]
    truths = [dc.truth(scenes.scene(k), radar.for_frame(k)) for k in frames]

    ranges_m = [float(truth.range[0, 0]) for truth in truths]
    times_s = [scenes.mid_frame_s(k) for k in frames]

    expected_m = [math.hypot(50 - 2.25 - 6 * t, 2 * t, 0.5) for t in times_s]
    assert ranges_m == pytest.approx(expected_m, abs=1e-6)
    for truth, t, range_m in zip(truths, times_s, expected_m, strict=True):
        rate = (-6 * (50 - 2.25 - 6 * t) + 4 * t) / range_m
        assert float(truth.velocity[0, 0]) == pytest.approx(rate, abs=1e-6)


def test_jitter_of_positions_does_not_exceed_the_acceleration_limit(tmp_path):
    # 0.1 m of jitter at 10 Hz is an acceleration of sqrt(6) * 0.1 / 0.1^2 = 24 m/s^2.
    rng = np.random.default_rng(3)
    jitter_m = dict(zip(STEPS_S.tolist(), rng.normal(0, 0.1, len(STEPS_S)).tolist(), strict=True))
    traffic = open_rows(
        tmp_path, *states(1, STEPS_S, lambda t: 20 * t + jitter_m[float(t)], constant(0.0))
    )

    (path,) = fit_paths(traffic.objects.isel(object=0), 0.1)

    times_s = np.linspace(0, 2, 2001)
    motions = [path.motion_at(t) for t in times_s]
    accelerations = [np.linalg.norm(motion.acceleration_m_per_s2) for motion in motions]
    assert max(accelerations) <= MAX_ACCELERATION_M_PER_S2 * (1 + 1e-9)
    x_m = np.array([motion.position_m[0] for motion in motions])
    speeds = np.array([motion.velocity_m_per_s[0] for motion in motions])
    # The velocity is the derivative of the position: central differences at 1 ms are off by the
    # third derivative, 240 m/s^3 at most, times h^2 / 6.
    assert np.allclose(np.gradient(x_m, times_s)[1:-1], speeds[1:-1], rtol=0, atol=1e-3)
    assert path.shift_m < 0.3  # three standard deviations: the path stays beside the positions
    assert abs(speeds - 20).max() < 2.5


def test_stated_velocities_shape_the_path_between_coarse_steps(tmp_path):
    header = f"{HEADER},vx,vy"
    rows = [f"{t},1,car,{t**3 / 3:.17g},0,0,4.5,1.8,1.5,{t**2},0" for t in range(4)]
    traffic = open_rows(tmp_path, *rows, header=header)

    (path,) = fit_paths(traffic.objects.isel(object=0), 1.0)

    # A cubic is its own Hermite interpolant.
    assert path.motion_at(1.5).position_m[0] == pytest.approx(1.5**3 / 3, rel=1e-12)
    assert path.motion_at(1.5).acceleration_m_per_s2[0] == pytest.approx(3.0, rel=1e-12)


def test_wrong_velocities_are_told_though_the_path_passes_through_the_positions(tmp_path, radar):
    # 10 m/s in positions, 40 m/s stated at both ends of 1 s: 180 m/s^2 for a cubic.
    rows = [
        f"{t},{n},car,{10 * t + 30 * n},0,0,4.5,1.8,1.5,{v},0"
        for t in (0, 1)
        for n, v in ((0, 10), (1, 40))
    ]
    traffic = open_rows(tmp_path, *rows, header=f"{HEADER},vx,vy")

    scenes = FrameScenes(traffic, radar, ego=0)

    (finding,) = [entry for entry in scenes.findings if entry.setting == "traffic.position"]
    assert finding.level == "note"
    assert finding.value.startswith("positions and velocities of 1 path contradict")
    assert finding.value.endswith(": car-1 from 0 s; smooth paths pass through the positions")


@pytest.mark.parametrize("jump_m", [0.5, 300])
def test_velocities_that_no_file_states_contradict_nothing(tmp_path, radar, jump_m):
    # 0.5 m in one step of 0.1 s is 50 m/s^2; 300 m is a jump, which splits the path.
    rows = states(1, STEPS_S, constant(0.0), constant(0.0))
    rows += states(2, STEPS_S, lambda t: 30 + 10 * t + jump_m * (t > 0.95), constant(0.0))

    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)

    assert not [entry for entry in scenes.findings if "contradict" in entry.value]
    rough = [e.value for e in scenes.findings if "need more than 12 m/s^2: car-2" in e.value]
    assert [value.partition(" need")[0] for value in rough] == (
        ["positions of 1 path"] if jump_m < 1 else []
    )


def test_object_with_wrong_velocities_before_and_after_a_gap_is_named_once(tmp_path, radar):
    rows = [f"{t},0,car,0,0,0,4.5,1.8,1.5,0,0" for t in range(13)]
    rows += [
        f"{t},{n},car,{10 * t},{10 * n},0,4.5,1.8,1.5,40,0"
        for n, start in ((1, 0), (2, 1))
        for t in (*range(start, 3), 10, 11, 12)
    ]
    scenes = FrameScenes(open_rows(tmp_path, *rows, header=f"{HEADER},vx,vy"), radar, ego=0)

    (finding,) = [e for e in scenes.findings if "contradict" in e.value]
    assert finding.value.startswith("positions and velocities of 4 paths contradict")
    assert ": car-1 from 0 s, car-2 from 1 s; smooth" in finding.value


def test_objects_exist_only_while_present(tmp_path, radar):
    gap_s = [t for t in STEPS_S if not 0.65 < t < 1.25]
    rows = states(1, STEPS_S, constant(0.0), constant(0.0))
    rows += states(2, gap_s, constant(30.0), constant(0.0))
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)

    present = [len(scenes.scene(number).targets) for number in range(scenes.n_frames)]

    times_s = np.array([scenes.mid_frame_s(number) for number in range(scenes.n_frames)])
    # Present in the steps 0.6 and 1.3 s, and half a step beyond.
    assert present == np.where((times_s > 0.65) & (times_s < 1.25), 0, 1).tolist()


@pytest.mark.parametrize(
    "times_s",
    [
        np.nextafter(STEPS_S, 9),  # 1 ulp later
        np.arange(0, 2.01, 0.05),
        STEPS_S + 0.05,
        np.delete(STEPS_S, [4, 5, 6, 12]),
    ],
    ids=["rounding", "20 Hz", "half a step apart", "rows missing"],
)
@pytest.mark.parametrize("of_ego", [False, True])
def test_objects_of_different_times_are_whole(tmp_path, radar, times_s, of_ego):
    # Both cars keep 10 m/s on straight lines, on which any interpolation is exact.
    times = [STEPS_S, times_s] if of_ego else [times_s, STEPS_S]
    other, ego = (
        [f"{t!r},{number},car,{start_m + 10 * t!r},0,,4.5,1.8,1.5" for t in its_times_s.tolist()]
        for number, start_m, its_times_s in ((2, 30, times[0]), (1, 0, times[1]))
    )
    scenes = FrameScenes(open_rows(tmp_path, *ego, *other), radar, ego=1)

    assert scenes.n_frames == 41
    within = [
        number
        for number in range(scenes.n_frames)
        if max(times[0][0], times[1][0]) - 0.04 < scenes.mid_frame_s(number) < 2.04
    ]
    assert len(within) >= 39
    for number in within:
        (car,) = scenes.scene(number).targets
        assert car.position_m[0] == pytest.approx(30 - 2.25, abs=1e-9)
    bridged = ["traffic.time"] if len(times_s) == len(STEPS_S) - 4 else []
    assert [entry.setting for entry in scenes.findings] == ["traffic.velocity", *bridged]


def test_rows_of_one_time_are_one_step_in_unix_time(tmp_path):
    now_s = 1.7e9 + STEPS_S
    rows = [f"{t!r},1,car,0,0,0,4.5,1.8,1.5" for t in now_s.tolist()]
    rows += [f"{t!r},2,car,9,0,0,4.5,1.8,1.5" for t in np.nextafter(now_s, 0).tolist()]

    objects = open_rows(tmp_path, *rows).objects

    assert objects.sizes["time"] == 21
    assert np.isfinite(objects["x"]).all()


def test_frames_continue_after_a_gap_of_the_ego(tmp_path, radar):
    gap_s = [t for t in STEPS_S if not 0.55 < t < 1.45]
    rows = states(1, gap_s, lambda t: 10 * t, constant(0.0))
    rows += states(2, STEPS_S, lambda t: 30 + 10 * t, constant(0.0))
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)

    n_targets = [len(scenes.scene(number).targets) for number in range(scenes.n_frames)]

    times_s = np.array([scenes.mid_frame_s(number) for number in range(scenes.n_frames)])
    assert n_targets == np.where((times_s > 0.55) & (times_s < 1.45), 0, 1).tolist()
    assert len(n_targets) == 41
    finding = next(entry for entry in scenes.findings if entry.setting == "traffic.ego")
    assert finding.value.startswith("car-1 is absent from 0.55 to 1.45 s")
    later = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1, start_s=1.45)
    assert "traffic.ego" not in [entry.setting for entry in later.findings]


@pytest.mark.parametrize(
    ("of_ego_s", "start_s", "duration_s", "n_frames"),
    [
        ((0.5, 2.0), 0.0, None, 31),  # half a step longer
        ((0.0, 1.0), 0.0, None, 21),
        ((0.0, 1.0), 0.0, 1.5, 21),
        ((0.5, 2.0), 0.5, None, None),
        ((0.0, 1.0), 0.0, 0.8, None),
        ((0.0, 2.0), 0.0, None, None),
    ],
)
def test_ego_that_is_present_for_a_part_is_noted(
    tmp_path, radar, of_ego_s, start_s, duration_s, n_frames
):
    first_s, last_s = of_ego_s
    times_s = [t for t in STEPS_S if first_s - 0.01 < t < last_s + 0.01]
    rows = states(1, times_s, lambda t: 10 * t, constant(0.0))
    rows += states(2, STEPS_S, lambda t: 30 + 10 * t, constant(0.0))

    scenes = FrameScenes(
        open_rows(tmp_path, *rows), radar, ego=1, start_s=start_s, duration_s=duration_s
    )

    notes = [entry.value for entry in scenes.findings if entry.setting == "traffic.ego"]
    expected = (
        f"car-1 is present from {first_s:g} to {last_s:g} s, the trace from 0 to 2 s:"
        f" {n_frames} frames"
    )
    assert notes == ([] if n_frames is None else [expected])
    assert n_frames in (None, scenes.n_frames)


def test_jump_splits_the_path(tmp_path, radar):
    rows = states(1, STEPS_S, constant(0.0), constant(0.0))
    rows += states(2, STEPS_S, lambda t: 30.0 if t < 0.95 else 60.0, constant(0.0))
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)

    positions_m = [scenes.scene(k).targets[0].position_m[0] for k in range(scenes.n_frames)]

    assert set(np.round(positions_m, 6)) == {30 - 2.25, 60 - 2.25}
    assert any("object 2 at 1 s" in str(finding) for finding in scenes.findings)


@pytest.mark.parametrize(
    ("mount", "azimuth_deg"),
    [
        ("front", 0),
        ("front-left", 45),
        ("left", 90),
        ("rear-left", 135),
        ("rear", 180),
        ("rear-right", -135),
        ("right", -90),
        ("front-right", -45),
    ],
)
def test_mounts_look_away_from_the_outline(tmp_path, radar, mount, azimuth_deg):
    # A post 10 m from the corner or side of the mount, along its boresight, is straight ahead.
    azimuth = math.radians(azimuth_deg)
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    place_m = np.sign(np.round(unit, 9)) * [2.25, 0.9] + 10 * unit
    rows = states(1, [0, 1], constant(0.0), constant(0.0), constant(0.0))
    rows += states(
        2, [0, 1], constant(place_m[0]), constant(place_m[1]), constant(0.0), "other", "0.2,0.2,1"
    )
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1, mount=mount)

    (post,) = scenes.scene(0).targets

    assert post.position_m == pytest.approx((10, 0, -0.5), abs=1e-6)
    assert (
        not FrameScenes(
            open_rows(tmp_path, *rows),
            radar,
            ego=1,
            mount=Mounting(
                position_m=(0, 0, 0.5), yaw_rad=math.remainder(azimuth + math.pi, 2 * math.pi)
            ),
        )
        .scene(0)
        .targets
    )


@pytest.mark.parametrize(
    ("kind", "size", "body", "height_m"),
    [
        ("car", ",,", "car", 1.5),
        ("van", "6,2,2.5", "van", 2.5),
        ("truck", "8,2.5,", "truck", 4.0),
        ("bus", "12,2.5,3", "van", 3.0),
        ("motorcycle", "2,0.8,", "car", 1.4),
        ("bicyclist", "1.8,0.6,", "bicyclist", 1.75),
        ("pedestrian", "0.5,0.6,1.6", "pedestrian", 1.6),
        ("other", "1,1,1", "car", 1.0),
    ],
)
def test_classes_become_bodies_of_their_size(tmp_path, radar, kind, size, body, height_m):
    rows = states(1, STEPS_S, constant(0.0), constant(0.0))
    rows += states(7, STEPS_S, constant(20.0), lambda t: 1.2 * t, None, kind, size)
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)

    (target,) = scenes.scene(3).targets

    assert (target.name, target.body.kind()) == (f"{kind}-7", body)
    assert target.body.height_m == height_m
    assert target.heading_rad == pytest.approx(math.pi / 2)  # the course
    if kind != "other":
        assert target.body.speed_m_per_s == pytest.approx(1.2)
    is_known = ",," not in f"{size}," and not size.endswith(",")
    assert any("7" in f.value for f in scenes.findings if f.setting == "traffic.size") != is_known


def test_legs_move_on_from_frame_to_frame(tmp_path, radar):
    rows = states(1, STEPS_S, constant(0.0), constant(0.0))
    rows += states(
        2, STEPS_S, lambda t: 20 + 0.5 * t + 0.25 * t**2, constant(0.0), None, "pedestrian", ",,"
    )
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)
    # The frame duration is short of the period: extrapolate the phase of each frame to the next.
    first, second = (scenes.scene(k).targets[0].body for k in (10, 11))
    period_s = radar.frame.period_s
    hip_m = 0.53 * 1.75  # heights of hips, R. Boulic et al. 1990

    moved = (second.phase_rad - first.phase_rad) % (2 * math.pi)

    speed = (first.speed_m_per_s + second.speed_m_per_s) / 2
    assert moved == pytest.approx(
        2 * math.pi * period_s * math.sqrt(speed / hip_m) / 1.346, rel=0.02
    )


def test_ego_must_be_named_without_a_host(tmp_path, radar):
    rows = states(4, STEPS_S, constant(0.0), constant(0.0))
    rows += states(9, STEPS_S[:5], constant(20.0), constant(0.0))

    with pytest.raises(dc.InvalidSetting, match=r"car-4 \(21 steps\), car-9 \(5 steps\)"):
        FrameScenes(open_rows(tmp_path, *rows), radar)
    with pytest.raises(dc.InvalidSetting, match=r"traffic.ego: 5; expected the id"):
        FrameScenes(open_rows(tmp_path, *rows), radar, ego=5)
    with pytest.raises(dc.InvalidSetting, match=r"car-9 is present until 0.45 s"):
        FrameScenes(open_rows(tmp_path, *rows), radar, ego=9, start_s=1.0)
    with pytest.raises(dc.InvalidSetting, match=r"traffic.mount: roof; expected one of front"):
        FrameScenes(open_rows(tmp_path, *rows), radar, ego=4, mount="roof")


def test_part_of_a_trace_is_selected(tmp_path, radar):
    traffic = open_rows(tmp_path, *states(1, STEPS_S, lambda t: 10 * t, constant(0.0)))

    scenes = FrameScenes(traffic, radar, ego=1, start_s=0.5, duration_s=1.0)

    assert scenes.n_frames == 20  # frames of 50 ms
    assert scenes.mid_frame_s(0) == pytest.approx(0.5 + radar.frame.mid_frame_s)


def test_radar_inside_an_object_is_a_finding(tmp_path, radar):
    rows = states(1, STEPS_S, lambda t: 10 * t, constant(0.0))
    rows += states(2, STEPS_S, constant(17.0), constant(0.0))
    scenes = FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)

    targets = [len(scene.targets) for scene in scenes.scenes()]

    assert 0 in targets
    (finding,) = [f for f in scenes.findings if f.setting == "traffic.mount"]
    # The front of the radar's car, at 10 t + 2.25 m, reaches the rear at 14.75 m after 1.25 s.
    assert "car-2 at 1.25" in str(finding) or "car-2 at 1.3" in str(finding)


def test_impossible_size_names_object_and_time(tmp_path, radar):
    rows = states(1, STEPS_S, constant(0.0), constant(0.0))
    rows += states(2, STEPS_S[3:], constant(17.0), constant(0.0), None, "truck", "80,2.5,4")

    with pytest.raises(dc.InvalidSetting, match=r"object 2: Truck.length_m 80.*from 0.3 s"):
        FrameScenes(open_rows(tmp_path, *rows), radar, ego=1)


def square(x_m, y_m, side_m=2.0):
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * side_m / 2
    return corners + np.array([x_m, y_m])


def test_visible_share_is_that_of_the_angle():
    # The front face of the square at 10 m, 9 m away, covers the one at 20 m up to atan(1/9); that
    # at 20 m, offset by 2 m, from its corner (21, 1) at atan(1/21) to (19, 3) at atan(3/19).
    shares = visible_shares(np.array([square(10, 0), square(20, 2), square(-5, 0)]))

    behind = (math.atan(3 / 19) - math.atan(1 / 9)) / (math.atan(3 / 19) - math.atan(1 / 21))
    assert shares == pytest.approx([1, behind, 0], abs=0.04)  # rays every 0.125 of 6.2 degrees
