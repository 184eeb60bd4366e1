"""Scene warnings and scene validity: aliased, late, hidden and impossible targets."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.patterns.cosine import Cosine
from dechirp.scene.aliasing import apparent_range_and_velocity
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.ego import Ego
from dechirp.scene.scene_warnings import scene_findings
from dechirp.scene.validity import check_scene_echoes_finite, frames_to_check
from dechirp.scene.waypoints import Waypoint


def build_scene_ahead(range_m, velocity_m_per_s=0.0, name="car"):
    """Build a scene of one target straight ahead that recedes."""
    target = dc.Target(
        name=name, position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0)
    )
    return dc.Scene(targets=[target])


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def start_sampling_early(radar):
    """Start sampling after 4.8 us: no echo from less than 700 m arrives late."""
    chirp = replace(radar.frame.chirp, adc_start_s=4.8e-6, ramp_duration_s=32e-6)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


# 75 m (37.5 m real) and 27.7 m/s are unambiguous, and the coupling is 3.9 mm for each m/s.
ALIASED_TARGETS = [
    ("complex", 30.0, 40.0, ["velocity"]),
    ("complex", 90.0, -3.0, ["position"]),
    ("complex", 74.94, 20.0, ["position"]),
    ("complex", 90.0, 40.0, ["velocity", "position"]),
    ("real", 30.0, -40.0, ["velocity"]),
    ("real", 45.0, 40.0, ["velocity", "position"]),
    ("real", 45.0, 5.0, ["position"]),
    ("real", 45.0, -20.0, ["position"]),
    ("real", 100.0, 5.0, ["position"]),
]


@pytest.mark.parametrize(("sampling", "range_m", "velocity", "limits"), ALIASED_TARGETS)
def test_aliased_target_is_detected_where_finding_predicts(
    radar, sampling, range_m, velocity, limits
):
    radar, scene = set_sampling(radar, sampling), build_scene_ahead(range_m, velocity)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        cube = dc.simulate(scene, radar, impairments=[dc.impairments.WhiteNoise(snr=1.0)])
    apparent = apparent_range_and_velocity(dc.truth(scene, radar), radar)
    findings = scene_findings(scene, radar)

    detection = dc.detect(cube, radar).sortby("snr").isel(detection=-1)
    # Standard errors are 0.6 mm and 1 mm/s. Range walk is 1 % of a cell in the frame.
    assert float(detection.range) == pytest.approx(apparent.range_m.item(), abs=5e-3)
    assert float(detection.velocity) == pytest.approx(apparent.velocity_m_per_s.item(), abs=1e-2)
    assert [finding.setting for finding in findings] == [f"scene.targets.car.{x}" for x in limits]
    alias = f"{apparent.range_m.item():.4g} m at {apparent.velocity_m_per_s.item():.4g} m/s"
    assert all(finding.value.endswith(f"is aliased to {alias}") for finding in findings)


def test_mirrored_range_of_real_samples_changes_sign_of_velocity(radar):
    radar = set_sampling(radar, "real")
    slow_apparent, fast_apparent = (
        apparent_range_and_velocity(dc.truth(build_scene_ahead(45.0, v), radar), radar)
        for v in (5.0, 40.0)
    )

    # 45 m is 37.5 m + 7.5 m: its mirror lies 7.5 m below 37.5 m, within about a centimetre.
    assert slow_apparent.range_m.item() == pytest.approx(30.0, abs=0.1)
    assert slow_apparent.velocity_m_per_s.item() == pytest.approx(-5.0, abs=1e-3)
    # 40 m/s changes sign to -40 m/s, and 55.4 m/s are added.
    aliased_velocity = 2 * radar.frame.max_velocity_m_per_s - 40.0
    assert fast_apparent.velocity_m_per_s.item() == pytest.approx(aliased_velocity, abs=5e-3)


def test_aliased_range_is_corrected_for_range_doppler_coupling(radar):
    chirp = radar.frame.chirp
    apparent = apparent_range_and_velocity(dc.truth(build_scene_ahead(90.0, 20.0), radar), radar)

    # Half a frame, 2.24 ms, at 20 m/s moves the target by 45 mm.
    walk_m = 20.0 * radar.frame.mid_frame_s
    assert apparent.range_m.item() == pytest.approx(90.0 + walk_m - chirp.max_range_m, abs=1e-6)


def test_unambiguous_target_is_not_aliased(radar):
    for sampling in ("complex", "real"):
        ground_truth = dc.truth(build_scene_ahead(30.0, -20.0), set_sampling(radar, sampling))
        apparent = apparent_range_and_velocity(ground_truth, set_sampling(radar, sampling))

        assert apparent.range_m.item() == pytest.approx(ground_truth.range.item(), rel=1e-12)
        assert apparent.velocity_m_per_s.item() == pytest.approx(
            ground_truth.velocity.item(), rel=1e-12
        )
    assert scene_findings(build_scene_ahead(30.0, -20.0), start_sampling_early(radar)) == []


def test_warns_of_target_aliased_in_last_frame_only(radar):
    radar = replace(
        start_sampling_early(radar), frame=replace(start_sampling_early(radar).frame, period_s=0.05)
    )
    # At 20 m/s, 70 m become 79 m in 0.45 s: beyond 74.9 m.
    scene = build_scene_ahead(70.0, 20.0)

    assert scene_findings(scene, radar) == []
    (finding,) = scene_findings(scene, radar, n_frames=10)
    assert finding.setting == "scene.targets.car.position"
    assert "at 20 m/s in frame 9 is aliased to 4." in finding.value
    with pytest.warns(dc.PhysicsWarning, match="in frame 9 is aliased to 4."):
        dc.simulate(scene, radar, impairments=(), n_frames=10)


def test_warns_once_of_target_aliased_in_every_frame(radar):
    (finding,) = scene_findings(
        build_scene_ahead(90.0, -1.0), start_sampling_early(radar), n_frames=5
    )

    assert "in frame 0" in finding.value


def test_warns_of_late_echo_in_last_frame_only(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    # Sampling begins after 2 us, the delay of 299.8 m; 28 of 256 samples, 1 dB, last to 719 m.
    echo = [
        f
        for f in scene_findings(build_scene_ahead(710.0, 20.0), radar, n_frames=2)
        if "echo" in f.value
    ]

    assert [finding.value.split(",")[0] for finding in echo] == [
        "echo arrives 4.87 us after ramp start in frame 1"
    ]


@pytest.mark.parametrize(("n_missed", "is_late"), [(27.8, False), (27.9, True)])
def test_echo_is_late_from_1_db_of_missed_samples(radar, n_missed, is_late):
    # 256 samples without 27.84 lose 20 lg(228.16 / 256) = 1 dB.
    chirp = radar.frame.chirp
    delay_s = chirp.adc_start_s + n_missed / chirp.sample_rate_hz
    scene = build_scene_ahead(delay_s * SPEED_OF_LIGHT / 2, 0.0)

    late = [finding for finding in scene_findings(scene, radar) if "echo" in finding.value]

    assert [finding.value.split(", ")[1] for finding in late] == [
        "sampling begins at 2 us" for _ in range(is_late)
    ]


def test_warns_of_target_aliased_between_first_and_last_frame(radar):
    radar = replace(
        start_sampling_early(radar), frame=replace(start_sampling_early(radar).frame, period_s=0.05)
    )
    # Range: 40 m in the first and last frame, 80 m between them.
    points = [Waypoint(time_s=t, position_m=(x, 0, 0)) for t, x in ((5, 80), (10, 40))]
    returning_target = dc.Target(name="car", position_m=(40, 0, 0), waypoints=points)

    (finding,) = scene_findings(dc.Scene(targets=[returning_target]), radar, n_frames=200)
    assert finding.setting == "scene.targets.car.position"
    assert "is aliased to" in finding.value


def test_checks_more_frames_for_curved_paths():
    straight_scene = build_scene_ahead(30.0, 5.0)
    car = straight_scene.targets[0]
    braking_scene = dc.Scene(targets=[replace(car, acceleration_m_per_s2=(-1, 0, 0))])
    turning_scene = replace(straight_scene, ego=Ego(turn_rate_rad_per_s=0.1))

    assert frames_to_check(straight_scene, 1) == [0]
    assert frames_to_check(straight_scene, 1000) == [0, 999]
    for curved_scene in (braking_scene, turning_scene):
        assert frames_to_check(curved_scene, 5) == [0, 1, 2, 3, 4]
        frames = frames_to_check(curved_scene, 1000)
        assert (len(frames), frames[0], frames[-1]) == (33, 0, 999)


def collect_findings(scene, radar, **options):
    """Collect findings by setting, except those about late echoes."""
    findings = scene_findings(scene, radar, **options)
    return {finding.setting: finding.value for finding in findings if "echo" not in finding.value}


def test_warns_of_target_behind_radar(radar):
    rear_scene = dc.Scene(targets=[dc.Target(name="car", position_m=(-20, 1, 0))])
    assert collect_findings(rear_scene, radar) == {
        "scene.targets.car.position": "behind the radar, at x = -20 m"
    }
    # The target is in front of a radar with yaw of 180 degrees.
    assert collect_findings(replace(rear_scene, ego=Ego(yaw_rad=np.pi)), radar) == {}


def test_warns_of_frame_in_which_target_falls_behind(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=0.05))
    scene = dc.Scene(
        targets=[dc.Target(name="car", position_m=(5, 4, 0))],
        ego=Ego(velocity_m_per_s=(20, 0, 0), turn_rate_rad_per_s=0.1),
    )
    # Position after 0.3 s: 5 m, minus 6.05 m of travel, plus 4 m times 0.03 rad of turn.
    assert "behind the radar in frame 6, at x = -0.9" in str(
        collect_findings(scene, radar, n_frames=10)
    )


def test_warns_of_target_outside_antenna_pattern(radar):
    beam = Cosine(
        azimuth_beamwidth_rad=1.0, elevation_beamwidth_rad=1.0, beam_azimuth_rad=np.pi / 3
    )
    steered_radar = replace(radar, hardware=replace(radar.hardware, rx_pattern=beam))
    targets = [
        dc.Target(name=name, position_m=(20, y, 0)) for name, y in (("left", 9), ("right", -20))
    ]
    # 45 deg to the right is 105 deg from the beam, whose gain is zero beyond 90 deg.
    assert collect_findings(dc.Scene(targets=targets), steered_radar) == {
        "scene.targets.right.position": "at azimuth -45 deg, elevation 0 deg, where the pattern of"
        " the antennas has no gain"
    }


def test_warns_of_code_that_forms_beam(radar):
    array = replace(radar.array, tx_m=[(0, 0, 0), (0, 0.0078, 0), (0, 0.0156, 0)])

    def find_code_findings(multiplexing):
        frame = replace(radar.frame, multiplexing=multiplexing)
        return collect_findings(dc.Scene(), replace(radar, frame=frame, array=array))

    beam = PhaseCode(phases_rad=[[0, 0, 1], [0, 0, 1 + np.pi]])
    assert find_code_findings(beam) == {
        "radar.frame.multiplexing": "a code in which transmitters 0 and 1 are not orthogonal over"
        " a round: they form a beam"
    }
    # Phases rounded to whole degrees still separate three transmitters in seven sub-bands.
    degrees = [[np.round(360 * k * slot / 7) for k in range(3)] for slot in range(7)]
    assert find_code_findings(PhaseCode(phases_rad=np.radians(degrees))) == {}
    assert find_code_findings(Bpm(order=(1, 0, 2))) == {}


def test_warns_of_target_inside_array(radar):
    array = dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0.1, 0), (0, 0.5, 0)])
    wide_radar = replace(radar, array=array)
    for position_m, is_inside in (((0.05, 0.3, 0), True), ((0.3, 0.3, 0), False)):
        scene = dc.Scene(targets=[dc.Target(name="car", position_m=position_m)])
        message = collect_findings(scene, wide_radar).get("scene.targets.car.position", "")
        assert message == ("inside the array, 0.07071 m from its centre" if is_inside else "")


@pytest.mark.parametrize("height_m", [0.0, 1.0])
def test_warns_of_body_around_radar(radar, height_m):
    corners_m = [(x, y, z) for x in (-1, 4) for y in (-1, 1) for z in (-height_m, height_m)]
    car = dc.Target(
        name="car", position_m=(0.5, 0, 0), body=PointCloud(positions_m=corners_m, rcs_m2=[1] * 8)
    )
    scene = dc.Scene(targets=[car])

    assert collect_findings(scene, radar)["scene.targets.car.body"].startswith(
        "around the radar: scatterers"
    )
    front_scene = dc.Scene(targets=[replace(car, position_m=(5, 0, 0))])
    assert collect_findings(front_scene, radar) == {}


def test_warns_of_coincident_elements(radar):
    array = dc.Array(rx_m=[(0, 0, 0), (0, 2e-3, 0), (0, 2e-3, 0)])
    coincident_radar = replace(radar, array=array)

    assert collect_findings(dc.Scene(), coincident_radar) == {
        "radar.array.rx": "receivers 1 and 2 are at the same position"
    }


def test_each_scatterer_of_body_is_checked_for_aliasing(radar):
    positions_m = [(0, 0, 0), (50, 0, 0), (60, 0, 0)]
    body = PointCloud(positions_m=positions_m, rcs_m2=(1, 1, 1))
    scene = dc.Scene(targets=[dc.Target(name="train", position_m=(20, 0, 0), body=body)])
    # 70 m are within 74.9 m, 80 m are not.
    assert collect_findings(scene, radar) == {
        "scene.targets.train.position": "80 m at 0 m/s is aliased to 5.052 m at 0 m/s"
    }


def test_warns_once_of_latest_echo(radar):
    chirp = replace(radar.frame.chirp, adc_start_s=0.0)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    targets = [dc.Target(position_m=(x, 0, 0)) for x in (450, 500, 470)]

    findings = scene_findings(dc.Scene(targets=targets), radar)

    (finding,) = [finding for finding in findings if "echo" in finding.value]
    assert finding.setting == "scene.targets.target-2.position"
    assert finding.value.startswith("echo arrives 3.336 us after ramp start")
    assert finding.value.endswith("like those of 2 more targets")


def test_reference_scene_gives_no_findings(reference):
    assert scene_findings(reference.scene, reference.radar) == []


def test_findings_of_many_targets_are_limited_and_counted(radar):
    targets = [dc.Target(position_m=(90, y, 0)) for y in range(50)]
    findings = scene_findings(dc.Scene(targets=targets), start_sampling_early(radar), n_frames=3)

    assert len(findings) == 21
    assert [finding.setting for finding in findings[:2]] == [
        "scene.targets.target-1.position",
        "scene.targets.target-2.position",
    ]
    assert findings[-1].setting == "scene.targets"
    assert findings[-1].value.startswith("30 more like scene.targets.target-1.position: 90 m")


@pytest.mark.parametrize("position_m", [(1e200, 0, 0), (0, -2e9, 0)])
def test_rejects_target_beyond_position_limit(position_m):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.position_m.*from -1e\+09 to 1e\+09"):
        dc.Target(position_m=position_m)


@pytest.mark.parametrize("rcs_m2", [1e-13, 1e13])
def test_rejects_implausible_cross_section(rcs_m2):
    with pytest.raises(dc.InvalidSetting, match=r"from 1e-12 to 1e\+12; check the unit"):
        dc.Target(position_m=(1, 0, 0), rcs_m2=rcs_m2)


def test_rejects_speeds_near_speed_of_light():
    for build in (lambda v: dc.Target(position_m=(1, 0, 0), velocity_m_per_s=v), _build_ego):
        with pytest.raises(dc.InvalidSetting, match="a thousandth of the speed of light"):
            build((3e5, 0, 0))
        with pytest.raises(dc.InvalidSetting, match=r"velocity_m_per_s: 1e\+200 m/s"):
            build((1e200, 0, 0))


def _build_ego(velocity_m_per_s):
    return dc.Ego(velocity_m_per_s=velocity_m_per_s)


def test_rejects_target_within_a_micrometre_of_radar(radar):
    # The square of 1e-200 m underflows to zero: the echo power would be infinite.
    with pytest.raises(dc.InvalidSetting, match="at the radar"):
        dc.truth(build_scene_ahead(1e-200), radar)


def test_rejects_target_on_antenna(radar):
    array = dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0, 0), (0, 0.5, 0)])
    wide_radar = replace(radar, array=array, frame=replace(radar.frame, period_s=1.0))
    target = dc.Target(name="car", position_m=(2, 0.5, 0), velocity_m_per_s=(-1, 0, 0))
    with pytest.raises(dc.InvalidSetting, match=r"targets\.car\.position: at receiver 1 after 2 s"):
        check_scene_echoes_finite(dc.Scene(targets=[target]), wide_radar, n_frames=3)
    offset_target = replace(target, position_m=(2, 0.5, 1e-5))
    check_scene_echoes_finite(dc.Scene(targets=[offset_target]), wide_radar, n_frames=3)


def test_rejects_scatterer_at_radar_but_not_body_origin(radar):
    far_cloud = PointCloud(positions_m=[(10, 0, 0)], rcs_m2=[1])
    scene = dc.Scene(targets=[dc.Target(name="field", position_m=(0, 0, 0), body=far_cloud)])
    check_scene_echoes_finite(scene, radar)
    with pytest.raises(dc.InvalidSetting, match=r"targets\.field\.position: at the radar.* origin"):
        dc.truth(scene, radar)
    near_cloud = PointCloud(positions_m=[(10, 0, 0), (0, 0, 0)], rcs_m2=[1, 1])
    with pytest.raises(
        dc.InvalidSetting, match=r"targets\.field\.position: at the radar after 0 s"
    ):
        check_scene_echoes_finite(
            dc.Scene(targets=[replace(scene.targets[0], body=near_cloud)]), radar
        )


def test_rejects_acceleration_to_near_speed_of_light(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    scene = dc.Scene(
        targets=[dc.Target(name="car", position_m=(9, 0, 0), acceleration_m_per_s2=(5e4, 0, 0))]
    )
    check_scene_echoes_finite(scene, radar, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"targets\.car\.acceleration: .* m/s after 9\."):
        check_scene_echoes_finite(scene, radar, n_frames=10)


def test_rejects_scenario_whose_target_reaches_radar_later(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    scene = build_scene_ahead(2 + radar.frame.mid_frame_s, -1.0)
    dc.Scenario(radar=radar, scene=scene, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"scene\.targets\.car\.position: at the radar"):
        dc.Scenario(radar=radar, scene=scene, n_frames=3)


@pytest.mark.parametrize("name", [3, "", b"car"])
def test_rejects_target_name_that_is_not_text(name):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.name"):
        dc.Target(name=name, position_m=(1, 0, 0))


@pytest.mark.parametrize(
    "targets", [dc.Target(position_m=(1, 0, 0)), None, [(1, 0, 0)], "car", 5, np.array(1.0)]
)
def test_rejects_targets_that_are_not_list_of_targets(targets):
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.targets.*: .* a Target"):
        dc.Scene(targets=targets)


def test_rejection_names_only_the_invalid_target():
    targets = [dc.Target(position_m=(x, 0, 0)) for x in range(1, 200)]
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.targets\.199: None; ") as error:
        dc.Scene(targets=[*targets, None])
    assert len(str(error.value)) < 200


@pytest.mark.parametrize("ego", [None, [1, 2, 3], {"yaw_rad": 1}])
def test_rejects_invalid_ego(ego):
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.ego: .* an Ego"):
        dc.Scene(ego=ego)


def test_scene_accepts_any_iterable_of_targets():
    targets = [dc.Target(position_m=(x, 0, 0)) for x in (1, 2)]

    assert dc.Scene(targets=iter(targets)).targets == tuple(targets)


@pytest.mark.parametrize("n_frames", [0, -1, 1.5, np.nan])
def test_rejects_invalid_number_of_frames_for_ground_truth(radar, n_frames):
    with pytest.raises(dc.InvalidSetting, match=r"n_frames: .*a whole number from 1"):
        dc.truth(build_scene_ahead(10.0), radar, n_frames=n_frames)


def test_warns_of_target_passing_through_radar_within_frame(radar):
    # Target 3 m ahead at frame start and 3 m behind at frame end: it passes through between them.
    half_s = radar.frame.duration_s / 2
    speed = 3.0 / half_s
    target = dc.Target(name="ball", position_m=(3.5, 0, 0), velocity_m_per_s=(-speed, 0, 0))
    findings = [f for f in scene_findings(dc.Scene(targets=[target]), radar) if "inside" in f.value]
    assert [f.setting for f in findings] == ["scene.targets.ball.position"]
    offset_target = replace(target, position_m=(3.5, 0.5, 0))
    assert not [
        f for f in scene_findings(dc.Scene(targets=[offset_target]), radar) if "inside" in f.value
    ]
