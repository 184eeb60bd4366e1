"""What a user is told of scenes that surprise, and of scenes that cannot be."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.patterns.cosine import CosinePattern
from dechirp.scene.aliasing import apparent_truth
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.ego import Ego
from dechirp.scene.scene_warnings import scene_findings
from dechirp.scene.validity import check_scene, frames_to_check
from dechirp.scene.waypoints import Waypoint


def ahead(range_m, velocity_m_per_s=0.0, name="car"):
    """A scene of one target straight ahead that recedes."""
    target = dc.Target(
        name=name, position_m=(range_m, 0, 0), velocity_m_per_s=(velocity_m_per_s, 0, 0)
    )
    return dc.Scene(targets=[target])


def sampled(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def early(radar):
    """The radar with sampling from 4.8 us on: no echo from within 700 m comes late."""
    chirp = replace(radar.frame.chirp, adc_start_s=4.8e-6, ramp_duration_s=32e-6)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


# 75 m (37.5 m real) and 27.7 m/s are unambiguous, and the coupling is 3.9 mm for each m/s.
FOLDING = [
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


@pytest.mark.parametrize(("sampling", "range_m", "velocity", "limits"), FOLDING)
def test_a_target_that_folds_is_detected_where_the_warning_says(
    radar, sampling, range_m, velocity, limits
):
    radar, scene = sampled(radar, sampling), ahead(range_m, velocity)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dc.PhysicsWarning)
        cube = dc.simulate(scene, radar, impairments=[dc.impairments.WhiteNoise(snr=1.0)])
    place = apparent_truth(dc.truth(scene, radar), radar)
    told = scene_findings(scene, radar)

    found = dc.detect(cube, radar).sortby("snr").isel(detection=-1)
    # Standard errors are 0.6 mm and 1 mm/s. A range moves by 1 % of a cell in the frame.
    assert float(found.range) == pytest.approx(place.range_m.item(), abs=5e-3)
    assert float(found.velocity) == pytest.approx(place.velocity_m_per_s.item(), abs=1e-2)
    assert [finding.setting for finding in told] == [f"scene.targets.car.{x}" for x in limits]
    where = f"is aliased to {place.range_m.item():.4g} m at {place.velocity_m_per_s.item():.4g} m/s"
    assert all(finding.value.endswith(where) for finding in told)


def test_the_mirror_half_of_a_real_spectrum_turns_the_sign_of_the_velocity(radar):
    radar = sampled(radar, "real")
    slow, fast = (apparent_truth(dc.truth(ahead(45.0, v), radar), radar) for v in (5.0, 40.0))

    # 45 m is 37.5 m and 7.5 m: its mirror lies 7.5 m below 37.5 m, to a centimetre or so.
    assert slow.range_m.item() == pytest.approx(30.0, abs=0.1)
    assert slow.velocity_m_per_s.item() == pytest.approx(-5.0, abs=1e-3)
    # 40 m/s turned to -40 m/s, and 55.4 m/s added.
    folded = 2 * radar.frame.max_velocity_m_per_s - 40.0
    assert fast.velocity_m_per_s.item() == pytest.approx(folded, abs=5e-3)


def test_the_range_of_a_fold_is_free_of_coupling(radar):
    chirp = radar.frame.chirp
    folded = apparent_truth(dc.truth(ahead(90.0, 20.0), radar), radar)

    # Half a frame at 20 m/s, 2.24 ms of it, moves it on by 45 mm.
    on_m = 20.0 * radar.frame.mid_frame_s
    assert folded.range_m.item() == pytest.approx(90.0 + on_m - chirp.max_range_m, abs=1e-6)


def test_a_target_within_the_limits_is_seen_where_it_is(radar):
    for sampling in ("complex", "real"):
        known = dc.truth(ahead(30.0, -20.0), sampled(radar, sampling))
        place = apparent_truth(known, sampled(radar, sampling))

        assert place.range_m.item() == pytest.approx(known.range.item(), rel=1e-12)
        assert place.velocity_m_per_s.item() == pytest.approx(known.velocity.item(), rel=1e-12)
    assert scene_findings(ahead(30.0, -20.0), early(radar)) == []


def test_a_target_that_folds_in_the_last_frame_only_is_announced(radar):
    radar = replace(early(radar), frame=replace(early(radar).frame, period_s=0.05))
    # At 20 m/s, 70 m become 79 m in 0.45 s: beyond 74.9 m.
    scene = ahead(70.0, 20.0)

    assert scene_findings(scene, radar) == []
    (finding,) = scene_findings(scene, radar, n_frames=10)
    assert finding.setting == "scene.targets.car.position"
    assert "at 20 m/s in frame 9 is aliased to 4." in finding.value
    with pytest.warns(dc.PhysicsWarning, match="in frame 9 is aliased to 4."):
        dc.simulate(scene, radar, impairments=(), n_frames=10)


def test_a_target_that_folds_in_every_frame_is_announced_once(radar):
    (finding,) = scene_findings(ahead(90.0, -1.0), early(radar), n_frames=5)

    assert "in frame 0" in finding.value


def test_an_echo_that_comes_late_in_the_last_frame_only_is_announced(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    # Sampling begins after 2 us, the delay of 299.8 m.
    echo = [f for f in scene_findings(ahead(290.0, 20.0), radar, n_frames=2) if "echo" in f.value]

    assert [finding.value.split(",")[0] for finding in echo] == [
        "echo arrives 2.068 us after ramp start in frame 1"
    ]


def test_a_target_that_folds_only_on_its_way_is_announced(radar):
    radar = replace(early(radar), frame=replace(early(radar).frame, period_s=0.05))
    # At 40 m in the first frame and in the last, at 80 m between them.
    points = [Waypoint(time_s=t, position_m=(x, 0, 0)) for t, x in ((5, 80), (10, 40))]
    there_and_back = dc.Target(name="car", position_m=(40, 0, 0), waypoints=points)

    (finding,) = scene_findings(dc.Scene(targets=[there_and_back]), radar, n_frames=200)
    assert finding.setting == "scene.targets.car.position"
    assert "is aliased to" in finding.value


def test_frames_are_looked_at_where_something_may_come_up():
    straight = ahead(30.0, 5.0)
    car = straight.targets[0]
    braking = dc.Scene(targets=[replace(car, acceleration_m_per_s2=(-1, 0, 0))])
    turning = replace(straight, ego=Ego(turn_rate_rad_per_s=0.1))

    assert frames_to_check(straight, 1) == [0]
    assert frames_to_check(straight, 1000) == [0, 999]
    for curved in (braking, turning):
        assert frames_to_check(curved, 5) == [0, 1, 2, 3, 4]
        frames = frames_to_check(curved, 1000)
        assert (len(frames), frames[0], frames[-1]) == (33, 0, 999)


def told(scene, radar, **options):
    """Findings by setting; that sampling begins before the echo comes is left out."""
    found = scene_findings(scene, radar, **options)
    return {finding.setting: finding.value for finding in found if "echo" not in finding.value}


def test_a_target_behind_the_radar_is_announced(radar):
    behind = dc.Scene(targets=[dc.Target(name="car", position_m=(-20, 1, 0))])
    assert told(behind, radar) == {"scene.targets.car.position": "behind the radar, at x = -20 m"}
    # It is the radar that must look there.
    assert told(replace(behind, ego=Ego(yaw_rad=np.pi)), radar) == {}


def test_a_target_that_falls_behind_is_announced_of_the_frame_it_does(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=0.05))
    scene = dc.Scene(
        targets=[dc.Target(name="car", position_m=(5, 4, 0))],
        ego=Ego(velocity_m_per_s=(20, 0, 0), turn_rate_rad_per_s=0.1),
    )
    # After 0.3 s: 5 m, less 6.05 m of way, and 4 m of 0.03 rad to the side of the turn.
    assert "behind the radar in frame 6, at x = -0.9" in str(told(scene, radar, n_frames=10))


def test_a_target_ahead_that_no_beam_sees_is_announced(radar):
    beam = CosinePattern(
        azimuth_beamwidth_rad=1.0, elevation_beamwidth_rad=1.0, beam_azimuth_rad=np.pi / 3
    )
    turned = replace(radar, hardware=replace(radar.hardware, rx_pattern=beam))
    targets = [
        dc.Target(name=name, position_m=(20, y, 0)) for name, y in (("left", 9), ("right", -20))
    ]
    # 45 deg to the right are 105 deg from the beam, which sees as far as 90.
    assert told(dc.Scene(targets=targets), turned) == {
        "scene.targets.right.position": "at azimuth -45 deg, elevation 0 deg, where the pattern of"
        " the antennas has no gain"
    }


def test_a_code_that_forms_a_beam_is_announced(radar):
    array = replace(radar.array, tx_m=[(0, 0, 0), (0, 0.0078, 0), (0, 0.0156, 0)])

    def sending(multiplexing):
        frame = replace(radar.frame, multiplexing=multiplexing)
        return told(dc.Scene(), replace(radar, frame=frame, array=array))

    beam = PhaseCode(phases_rad=[[0, 0, 1], [0, 0, 1 + np.pi]])
    assert sending(beam) == {
        "radar.frame.multiplexing": "a code in which transmitters 0 and 1 are not orthogonal over"
        " a round: they form a beam"
    }
    # Rounded to whole degrees, three transmitters in seven sub-bands are apart.
    degrees = [[np.round(360 * k * slot / 7) for k in range(3)] for slot in range(7)]
    assert sending(PhaseCode(phases_rad=np.radians(degrees))) == {}
    assert sending(Bpm(order=(1, 0, 2))) == {}


def test_a_target_between_the_antennas_is_announced(radar):
    array = dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0.1, 0), (0, 0.5, 0)])
    wide = replace(radar, array=array)
    for position_m, inside in (((0.05, 0.3, 0), True), ((0.3, 0.3, 0), False)):
        scene = dc.Scene(targets=[dc.Target(name="car", position_m=position_m)])
        got = told(scene, wide).get("scene.targets.car.position", "")
        assert got == ("inside the array, 0.07071 m from its centre" if inside else "")


@pytest.mark.parametrize("height_m", [0.0, 1.0])
def test_a_body_around_the_radar_is_announced(radar, height_m):
    corners_m = [(x, y, z) for x in (-1, 4) for y in (-1, 1) for z in (-height_m, height_m)]
    car = dc.Target(
        name="car", position_m=(0.5, 0, 0), body=PointCloud(positions_m=corners_m, rcs_m2=[1] * 8)
    )
    scene = dc.Scene(targets=[car])

    assert told(scene, radar)["scene.targets.car.body"].startswith("around the radar: scatterers")
    ahead_of_it = dc.Scene(targets=[replace(car, position_m=(5, 0, 0))])
    assert told(ahead_of_it, radar) == {}


def test_elements_at_one_place_are_announced(radar):
    array = dc.Array(rx_m=[(0, 0, 0), (0, 2e-3, 0), (0, 2e-3, 0)])
    like = replace(radar, array=array)

    assert told(dc.Scene(), like) == {
        "radar.array.rx": "receivers 1 and 2 are at the same position"
    }


def test_the_scatterers_of_a_body_are_looked_at_one_by_one(radar):
    places_m = [(0, 0, 0), (50, 0, 0), (60, 0, 0)]
    body = PointCloud(positions_m=places_m, rcs_m2=(1, 1, 1))
    scene = dc.Scene(targets=[dc.Target(name="train", position_m=(20, 0, 0), body=body)])
    # 70 m are within 74.9 m, 80 m are not.
    assert told(scene, radar) == {
        "scene.targets.train.position": "80 m at 0 m/s is aliased to 5.052 m at 0 m/s"
    }


def test_echoes_that_come_late_are_told_of_once_of_the_latest(radar):
    chirp = replace(radar.frame.chirp, adc_start_s=0.0)
    radar = replace(radar, frame=replace(radar.frame, chirp=chirp))
    targets = [dc.Target(position_m=(x, 0, 0)) for x in (10, 30, 20)]

    (finding,) = scene_findings(dc.Scene(targets=targets), radar)

    assert finding.setting == "scene.targets.target-2.position"
    assert finding.value.startswith("echo arrives 0.2001 us after ramp start")
    assert finding.value.endswith("like those of 2 more targets")


def test_what_befalls_many_targets_is_told_of_some_and_counted(radar):
    targets = [dc.Target(position_m=(90, y, 0)) for y in range(50)]
    found = scene_findings(dc.Scene(targets=targets), early(radar), n_frames=3)

    assert len(found) == 21
    assert [finding.setting for finding in found[:2]] == [
        "scene.targets.target-1.position",
        "scene.targets.target-2.position",
    ]
    assert found[-1].setting == "scene.targets"
    assert found[-1].value.startswith("30 more like scene.targets.target-1.position: 90 m")


@pytest.mark.parametrize("position_m", [(1e200, 0, 0), (0, -2e9, 0)])
def test_a_target_beyond_the_moon_is_refused(position_m):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.position_m.*from -1e\+09 to 1e\+09"):
        dc.Target(position_m=position_m)


@pytest.mark.parametrize("rcs_m2", [1e-13, 1e13])
def test_a_cross_section_of_no_thing_is_refused(rcs_m2):
    with pytest.raises(dc.InvalidSetting, match=r"from 1e-12 to 1e\+12; check the unit"):
        dc.Target(position_m=(1, 0, 0), rcs_m2=rcs_m2)


def test_neither_target_nor_radar_may_come_near_the_speed_of_light():
    for make in (lambda v: dc.Target(position_m=(1, 0, 0), velocity_m_per_s=v), _ego):
        with pytest.raises(dc.InvalidSetting, match="a thousandth of the speed of light"):
            make((3e5, 0, 0))
        with pytest.raises(dc.InvalidSetting, match=r"velocity_m_per_s: 1e\+200 m/s"):
            make((1e200, 0, 0))


def _ego(velocity_m_per_s):
    return dc.Ego(velocity_m_per_s=velocity_m_per_s)


def test_a_target_nearer_than_a_micrometre_is_on_the_radar(radar):
    # The square of 1e-200 m is zero: its power would be infinite.
    with pytest.raises(dc.InvalidSetting, match="at the radar"):
        dc.truth(ahead(1e-200), radar)


def test_a_target_on_an_antenna_is_refused_by_its_name(radar):
    array = dc.Array(tx_m=[(0, 0, 0)], rx_m=[(0, 0, 0), (0, 0.5, 0)])
    wide = replace(radar, array=array, frame=replace(radar.frame, period_s=1.0))
    on = dc.Target(name="car", position_m=(2, 0.5, 0), velocity_m_per_s=(-1, 0, 0))
    with pytest.raises(dc.InvalidSetting, match=r"targets\.car\.position: at receiver 1 after 2 s"):
        check_scene(dc.Scene(targets=[on]), wide, n_frames=3)
    beside = replace(on, position_m=(2, 0.5, 1e-5))
    check_scene(dc.Scene(targets=[beside]), wide, n_frames=3)


def test_a_body_may_have_its_origin_at_the_radar_but_no_scatterer(radar):
    far = PointCloud(positions_m=[(10, 0, 0)], rcs_m2=[1])
    scene = dc.Scene(targets=[dc.Target(name="field", position_m=(0, 0, 0), body=far)])
    check_scene(scene, radar)
    with pytest.raises(dc.InvalidSetting, match=r"targets\.field\.position: at the radar.* origin"):
        dc.truth(scene, radar)
    near = PointCloud(positions_m=[(10, 0, 0), (0, 0, 0)], rcs_m2=[1, 1])
    with pytest.raises(
        dc.InvalidSetting, match=r"targets\.field\.position: at the radar after 0 s"
    ):
        check_scene(dc.Scene(targets=[replace(scene.targets[0], body=near)]), radar)


def test_a_target_must_not_be_accelerated_to_near_the_speed_of_light(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    scene = dc.Scene(
        targets=[dc.Target(name="car", position_m=(9, 0, 0), acceleration_m_per_s2=(5e4, 0, 0))]
    )
    check_scene(scene, radar, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"targets\.car\.acceleration: .* m/s after 9\."):
        check_scene(scene, radar, n_frames=10)


def test_a_scenario_with_a_target_on_the_radar_later_on_is_refused(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    scene = ahead(2 + radar.frame.mid_frame_s, -1.0)
    dc.Scenario(radar=radar, scene=scene, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"scene\.targets\.car\.position: at the radar"):
        dc.Scenario(radar=radar, scene=scene, n_frames=3)


@pytest.mark.parametrize("name", [3, "", b"car"])
def test_a_name_that_is_no_text_is_refused(name):
    with pytest.raises(dc.InvalidSetting, match=r"Target\.name"):
        dc.Target(name=name, position_m=(1, 0, 0))


@pytest.mark.parametrize(
    "targets", [dc.Target(position_m=(1, 0, 0)), None, [(1, 0, 0)], "car", 5, np.array(1.0)]
)
def test_targets_of_a_scene_are_a_list_of_targets(targets):
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.targets.*: .* a Target"):
        dc.Scene(targets=targets)


def test_one_that_is_no_target_among_many_is_named_alone():
    many = [dc.Target(position_m=(x, 0, 0)) for x in range(1, 200)]
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.targets\.199: None; ") as refused:
        dc.Scene(targets=[*many, None])
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("ego", [None, [1, 2, 3], {"yaw_rad": 1}])
def test_the_radars_own_way_is_an_ego(ego):
    with pytest.raises(dc.InvalidSetting, match=r"Scene\.ego: .* an Ego"):
        dc.Scene(ego=ego)


def test_a_scene_takes_any_collection_of_targets():
    targets = [dc.Target(position_m=(x, 0, 0)) for x in (1, 2)]

    assert dc.Scene(targets=iter(targets)).targets == tuple(targets)


@pytest.mark.parametrize("n_frames", [0, -1, 1.5, np.nan])
def test_the_truth_about_no_count_of_frames_is_refused(radar, n_frames):
    with pytest.raises(dc.InvalidSetting, match=r"n_frames: .*a whole number from 1"):
        dc.truth(ahead(10.0), radar, n_frames=n_frames)


def test_a_target_that_passes_through_the_radar_within_a_frame_is_said(radar):
    # 3 m ahead at the start, 3 m behind at the end: at neither, nor in the middle, is it near.
    half_s = radar.frame.duration_s / 2
    speed = 3.0 / half_s
    target = dc.Target(name="ball", position_m=(3.5, 0, 0), velocity_m_per_s=(-speed, 0, 0))
    told = [f for f in scene_findings(dc.Scene(targets=[target]), radar) if "inside" in f.value]
    assert [f.setting for f in told] == ["scene.targets.ball.position"]
    beside = replace(target, position_m=(3.5, 0.5, 0))
    assert not [f for f in scene_findings(dc.Scene(targets=[beside]), radar) if "inside" in f.value]
