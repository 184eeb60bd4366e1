"""A pedestrian who walks."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.pedestrian import Pedestrian
from dechirp.scene.gait import Gait
from dechirp.scene.skeleton import SEGMENT_JOINTS, Joint
from dechirp.scene.target import Target
from dechirp.scene.trajectories import fit_paths

N_PHASES = 1000
CYCLES = np.arange(N_PHASES) / N_PHASES
SPEEDS = (0.0, 0.3, 0.8, 1.4, 2.1)  # 2.3 heights of the hips a second are 2.13 m/s at 1.75 m
SIDES = ("LEFT", "RIGHT")


def period_s(speed_m_per_s, height_m=1.75):
    """R_C / V_R of the model, with hips at 0.53 of the height."""
    relative = speed_m_per_s / (0.53 * height_m)
    return 1.346 * np.sqrt(relative) / relative


def joints_m(speed_m_per_s, height_m=1.75, cycles=CYCLES):
    found = Gait(height_m=height_m, speed_m_per_s=speed_m_per_s).joint_positions_m(cycles)
    return {joint.name: found[:, joint] for joint in Joint}


def speeds_m_per_s(places_m, duration_s):
    """Forward, of places over one whole period."""
    step_s = duration_s / len(places_m)
    return (np.roll(places_m, -1, axis=0) - np.roll(places_m, 1, axis=0))[..., 0] / (2 * step_s)


@pytest.mark.parametrize(("speed", "height_m"), [(0.5, 1.75), (1.4, 1.75), (2.0, 1.9), (1.0, 1.2)])
def test_a_pedestrian_repeats_after_the_cycle_of_the_model_and_mirrors_after_half(speed, height_m):
    body = Pedestrian(speed_m_per_s=speed, height_m=height_m, phase_rad=0.7)
    times_s = np.linspace(0, 1, 40)
    now_m = body.offsets_m(times_s)

    again_m = body.offsets_m(times_s + period_s(speed, height_m))
    assert again_m == pytest.approx(now_m, abs=1e-9)
    half_m = body.offsets_m(times_s + period_s(speed, height_m) / 2)
    assert abs(half_m - now_m).max() > 0.1
    # Left and right change places.
    mirrored_m = half_m * (1, -1, 1)
    for place_m in np.moveaxis(mirrored_m, 1, 0):
        assert abs(now_m - place_m[:, None]).max(axis=(0, 2)).min() < 1e-9


def test_a_phase_is_a_part_of_the_cycle_at_time_zero():
    early, late = (Pedestrian(speed_m_per_s=1.4, phase_rad=phase) for phase in (0, np.pi / 2))
    times_s = np.array([0.0, 0.3])

    assert late.offsets_m(times_s) == pytest.approx(
        early.offsets_m(times_s + period_s(1.4) / 4), abs=1e-12
    )


@pytest.mark.parametrize("speed", [1.3, 1.4, 2.1])
def test_feet_in_the_air_go_ahead_at_two_to_four_times_the_walking_speed(speed):
    body = Pedestrian(speed_m_per_s=speed)
    offsets_m = body.offsets_m(CYCLES * period_s(speed))
    over_ground = speed + speeds_m_per_s(offsets_m, period_s(speed))
    of_feet = np.isin(SEGMENT_JOINTS[:, 0], (Joint.LEFT_HEEL, Joint.RIGHT_HEEL))

    peaks = over_ground[:, of_feet].max(axis=0) / speed
    assert of_feet.sum() == 4
    assert np.all((peaks > 2) & (peaks < 4))
    # No part is faster, and the trunk keeps within 0.45 m/s of the walking speed.
    assert over_ground.max() / speed == pytest.approx(peaks.max(), rel=1e-12)
    of_trunk = SEGMENT_JOINTS[:, 0] == Joint.PELVIS
    assert abs(over_ground[:, of_trunk] - speed).max() < 0.45
    assert over_ground.mean(axis=0) == pytest.approx(np.full(35, speed), abs=1e-9)


@pytest.mark.parametrize("speed", [1.0, 1.4, 2.1])
def test_a_foot_on_the_ground_stands(speed):
    # The right one, from when it is flat to when its heel rises; the tables leave an eighth.
    heel_m = joints_m(speed)["RIGHT_HEEL"]
    over_ground = speed + speeds_m_per_s(heel_m, period_s(speed))

    standing = (CYCLES > 0.08) & (CYCLES < 0.5)
    assert abs(over_ground[standing].mean()) < 0.15 * speed
    assert over_ground.max() > 3 * speed


@pytest.mark.parametrize("height_m", [1.1, 1.75, 2.1])
@pytest.mark.parametrize("relative", [0.0, 0.3, 0.5, 1.0, 1.3, 1.6, 2.0, 2.3])
def test_the_lower_foot_is_on_the_ground(relative, height_m):
    found_m = joints_m(relative * 0.53 * height_m, height_m)
    soles_m = [found_m[f"{side}_{end}"][:, 2] for side in SIDES for end in ("HEEL", "TOE")]

    # What the pelvis' rise leaves over, in shares of the height: 1.8 cm at 1.75 m.
    assert abs(np.min(soles_m, axis=0)).max() < 0.0103 * height_m
    assert np.max(soles_m) < 0.25 * height_m


@pytest.mark.parametrize("speed", SPEEDS)
def test_joints_bend_the_way_they_can(speed):
    found_m = joints_m(speed)
    for side in SIDES:
        hip, knee, ankle, toe = (
            found_m[f"{side}_{name}"] for name in ("HIP", "KNEE", "ANKLE", "TOE")
        )
        thigh, shank = (knee - hip)[:, [0, 2]], (ankle - knee)[:, [0, 2]]
        bend = np.degrees(np.arctan2(*thigh.T) + np.pi - np.arctan2(*shank.T) - np.pi)
        bend = (-bend + 180) % 360 - 180
        # Backward at the knee; 70 degrees is the largest of the model.
        assert np.all((bend > 0) & (bend < 72))
        assert np.all(toe[:, 0] > ankle[:, 0] - 0.06)
        shoulder, elbow, wrist = (
            found_m[f"{side}_{name}"] for name in ("SHOULDER", "ELBOW", "WRIST")
        )
        upper, lower = (elbow - shoulder)[:, [0, 2]], (wrist - elbow)[:, [0, 2]]
        forward = upper[:, 0] * lower[:, 1] - upper[:, 1] * lower[:, 0]
        assert np.all(forward > 0)


def test_arms_swing_against_the_legs():
    found_m = joints_m(1.4)
    for side, other in (SIDES, SIDES[::-1]):
        hand, foot, far = (
            found_m[name][:, 0] for name in (f"{side}_WRIST", f"{side}_ANKLE", f"{other}_ANKLE")
        )
        assert np.corrcoef(hand, foot)[0, 1] < -0.6
        assert np.corrcoef(hand, far)[0, 1] > 0.6


def test_segments_keep_their_lengths():
    found_m = joints_m(1.4)
    lengths = {"THIGH": ("HIP", "KNEE", 0.245), "SHANK": ("KNEE", "ANKLE", 0.246)}
    lengths |= {"FOOT": ("HEEL", "TOE", 0.152), "ARM": ("SHOULDER", "ELBOW", 0.186)}
    for start, end, share in lengths.values():
        for side in SIDES:
            apart_m = found_m[f"{side}_{end}"] - found_m[f"{side}_{start}"]
            # Thighs and shanks lean to the side with the hips, 3 cm at most.
            assert np.linalg.norm(apart_m, axis=1) == pytest.approx(share * 1.75, rel=2e-3)


def test_a_pedestrian_has_fifteen_segments_that_share_its_cross_section():
    body = Pedestrian(speed_m_per_s=1.4, rcs_m2=0.2)

    # The trunk's halves have two pairs of joints each, one of which they share.
    assert len(np.unique(SEGMENT_JOINTS, axis=0)) == 15 + 1
    assert body.cross_sections_m2().sum() == pytest.approx(0.2, rel=1e-12)
    assert 10 * np.log10(Pedestrian(speed_m_per_s=1).rcs_m2) == pytest.approx(-8, abs=0.05)
    assert body.offsets_m(np.zeros(3)).shape == (3, 35, 3)


def test_a_pedestrian_moves_smoothly(radar):
    body = Pedestrian(speed_m_per_s=2.0)
    harmonics_m = np.fft.rfft(body.offsets_m(CYCLES * period_s(2.0)), axis=0) / N_PHASES
    # Sines of sums of six harmonics: no jump in any derivative.
    assert abs(harmonics_m[40:]).max() < 1e-8
    assert abs(harmonics_m[60:]).max() < 1e-12

    scene = dc.Scene(
        targets=[Target(position_m=(20, 0, -0.6), velocity_m_per_s=(2, 0, 0), body=body)]
    )
    # A frame of 4.5 ms is followed by few polynomials.
    assert all(len(fit_paths(scene, radar.frame, 0.1 * k)) <= 2 for k in range(10))


def test_who_stands_does_not_move():
    body = Pedestrian(speed_m_per_s=0, height_m=1.8)
    offsets_m = body.offsets_m(np.array([0.0, 1.0, 77.7]))

    assert body.is_rigid and not Pedestrian(speed_m_per_s=1).is_rigid
    assert (offsets_m == offsets_m[0]).all()
    # On the balls of the feet, by 3 degrees.
    assert joints_m(0.0, 1.8)["CROWN"][0, 2] == pytest.approx(1.8, abs=0.03)


def test_settings_files_say_how_a_pedestrian_walks():
    text = """\
name: walker
position: [20 m, 3 m, -0.6 m]
velocity: [0 m/s, -1.2 m/s, 0 m/s]
body: {kind: pedestrian, height: 160 cm, speed: 1.2 m/s, phase: 90 deg, rcs: -10 dBsm}
"""
    target = parse_settings(text, Target)

    assert (target.body.height_m, target.body.speed_m_per_s) == (1.6, 1.2)
    assert target.body.phase_rad == pytest.approx(np.pi / 2, rel=1e-15)
    assert target.body.rcs_m2 == pytest.approx(0.1, rel=1e-15)
    assert parse_settings(dump(target), Target) == target


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"height_m": -1.7}, "Pedestrian.height_m: -1.7"),
        ({"height_m": 175}, "Pedestrian.height_m: 175"),
        ({"speed_m_per_s": -1}, "Pedestrian.speed_m_per_s: -1"),
        ({"speed_m_per_s": 2.2}, "speed_m_per_s: 2.2 m/s; expected at most 2.13 m/s at a hei"),
        ({"speed_m_per_s": np.nan}, "Pedestrian.speed_m_per_s: nan"),
        ({"phase_rad": 90}, "Pedestrian.phase_rad: 90"),
        ({"rcs_m2": 0}, "Pedestrian.rcs_m2: 0"),
    ],
)
def test_a_pedestrian_who_cannot_be_is_refused(given, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        Pedestrian(**{"speed_m_per_s": 1.4, **given})
