"""Walking pedestrian: gait, joints, speeds of the limbs and cross-section."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.pedestrian import Pedestrian
from dechirp.scene.gait import Gait
from dechirp.scene.skeleton import SEGMENT_JOINTS, Joint
from dechirp.scene.target import Target
from dechirp.scene.trajectories import fit_polynomial_paths

N_PHASES = 1000
CYCLES = np.arange(N_PHASES) / N_PHASES
SPEEDS = (0.0, 0.3, 0.8, 1.4, 2.1)  # 2.3 hip heights per second are 2.13 m/s at 1.75 m
SIDES = ("LEFT", "RIGHT")


def gait_period_s(speed_m_per_s, height_m=1.75):
    """Compute the cycle R_C / V_R of the model, with hips at 0.53 of the height."""
    relative = speed_m_per_s / (0.53 * height_m)
    return 1.346 * np.sqrt(relative) / relative


def compute_joints_m(speed_m_per_s, height_m=1.75, cycles=CYCLES):
    positions_m = Gait(height_m=height_m, speed_m_per_s=speed_m_per_s).joint_positions_m(cycles)
    return {joint.name: positions_m[:, joint] for joint in Joint}


def compute_forward_speeds(positions_m, duration_s):
    """Compute forward speeds from positions over one whole period."""
    step_s = duration_s / len(positions_m)
    return (np.roll(positions_m, -1, axis=0) - np.roll(positions_m, 1, axis=0))[..., 0] / (
        2 * step_s
    )


@pytest.mark.parametrize(("speed", "height_m"), [(0.5, 1.75), (1.4, 1.75), (2.0, 1.9), (1.0, 1.2)])
def test_gait_repeats_after_model_cycle_and_mirrors_after_half(speed, height_m):
    body = Pedestrian(speed_m_per_s=speed, height_m=height_m, phase_rad=0.7)
    times_s = np.linspace(0, 1, 40)
    positions_m = body.scatterer_offsets_m(times_s)

    next_cycle_m = body.scatterer_offsets_m(times_s + gait_period_s(speed, height_m))
    assert next_cycle_m == pytest.approx(positions_m, abs=1e-9)
    half_cycle_m = body.scatterer_offsets_m(times_s + gait_period_s(speed, height_m) / 2)
    assert abs(half_cycle_m - positions_m).max() > 0.1
    # Left and right are exchanged after half a cycle.
    mirrored_m = half_cycle_m * (1, -1, 1)
    for part_m in np.moveaxis(mirrored_m, 1, 0):
        assert abs(positions_m - part_m[:, None]).max(axis=(0, 2)).min() < 1e-9


def test_phase_shifts_gait_within_its_cycle():
    early_walker, late_walker = (
        Pedestrian(speed_m_per_s=1.4, phase_rad=phase) for phase in (0, np.pi / 2)
    )
    times_s = np.array([0.0, 0.3])

    assert late_walker.scatterer_offsets_m(times_s) == pytest.approx(
        early_walker.scatterer_offsets_m(times_s + gait_period_s(1.4) / 4), abs=1e-12
    )


@pytest.mark.parametrize("speed", [1.3, 1.4, 2.1])
def test_swinging_feet_reach_two_to_four_times_walking_speed(speed):
    body = Pedestrian(speed_m_per_s=speed)
    offsets_m = body.scatterer_offsets_m(CYCLES * gait_period_s(speed))
    ground_speeds = speed + compute_forward_speeds(offsets_m, gait_period_s(speed))
    is_foot = np.isin(SEGMENT_JOINTS[:, 0], (Joint.LEFT_HEEL, Joint.RIGHT_HEEL))

    peaks = ground_speeds[:, is_foot].max(axis=0) / speed
    assert is_foot.sum() == 4
    assert np.all((peaks > 2) & (peaks < 4))
    # Feet are the fastest parts; the trunk stays within 0.45 m/s of the walking speed.
    assert ground_speeds.max() / speed == pytest.approx(peaks.max(), rel=1e-12)
    is_trunk = SEGMENT_JOINTS[:, 0] == Joint.PELVIS
    assert abs(ground_speeds[:, is_trunk] - speed).max() < 0.45
    assert ground_speeds.mean(axis=0) == pytest.approx(np.full(35, speed), abs=1e-9)


@pytest.mark.parametrize("speed", [1.0, 1.4, 2.1])
def test_foot_on_ground_stands_still(speed):
    # Right foot between flat contact and heel rise; the tables give an error of an eighth.
    heel_m = compute_joints_m(speed)["RIGHT_HEEL"]
    ground_speeds = speed + compute_forward_speeds(heel_m, gait_period_s(speed))

    is_standing = (CYCLES > 0.08) & (CYCLES < 0.5)
    assert abs(ground_speeds[is_standing].mean()) < 0.15 * speed
    assert ground_speeds.max() > 3 * speed


@pytest.mark.parametrize("height_m", [1.1, 1.75, 2.1])
@pytest.mark.parametrize("relative", [0.0, 0.3, 0.5, 1.0, 1.3, 1.6, 2.0, 2.3])
def test_lower_foot_touches_ground(relative, height_m):
    joints_m = compute_joints_m(relative * 0.53 * height_m, height_m)
    soles_m = [joints_m[f"{side}_{end}"][:, 2] for side in SIDES for end in ("HEEL", "TOE")]

    # Residual of the pelvis rise relative to the height: 1.8 cm at 1.75 m.
    assert abs(np.min(soles_m, axis=0)).max() < 0.0103 * height_m
    assert np.max(soles_m) < 0.25 * height_m


@pytest.mark.parametrize("speed", SPEEDS)
def test_joints_bend_in_anatomical_direction(speed):
    joints_m = compute_joints_m(speed)
    for side in SIDES:
        hip, knee, ankle, toe = (
            joints_m[f"{side}_{name}"] for name in ("HIP", "KNEE", "ANKLE", "TOE")
        )
        thigh, shank = (knee - hip)[:, [0, 2]], (ankle - knee)[:, [0, 2]]
        bend = np.degrees(np.arctan2(*thigh.T) + np.pi - np.arctan2(*shank.T) - np.pi)
        bend = (-bend + 180) % 360 - 180
        # Knees bend backwards; the largest angle of the model is 70 degrees.
        assert np.all((bend > 0) & (bend < 72))
        assert np.all(toe[:, 0] > ankle[:, 0] - 0.06)
        shoulder, elbow, wrist = (
            joints_m[f"{side}_{name}"] for name in ("SHOULDER", "ELBOW", "WRIST")
        )
        upper_arm, lower_arm = (elbow - shoulder)[:, [0, 2]], (wrist - elbow)[:, [0, 2]]
        forward = upper_arm[:, 0] * lower_arm[:, 1] - upper_arm[:, 1] * lower_arm[:, 0]
        assert np.all(forward > 0)


def test_arms_swing_opposite_to_legs():
    joints_m = compute_joints_m(1.4)
    for side, opposite_side in (SIDES, SIDES[::-1]):
        hand, foot, opposite_foot = (
            joints_m[name][:, 0]
            for name in (f"{side}_WRIST", f"{side}_ANKLE", f"{opposite_side}_ANKLE")
        )
        assert np.corrcoef(hand, foot)[0, 1] < -0.6
        assert np.corrcoef(hand, opposite_foot)[0, 1] > 0.6


def test_segments_keep_their_lengths():
    joints_m = compute_joints_m(1.4)
    lengths = {"THIGH": ("HIP", "KNEE", 0.245), "SHANK": ("KNEE", "ANKLE", 0.246)}
    lengths |= {"FOOT": ("HEEL", "TOE", 0.152), "ARM": ("SHOULDER", "ELBOW", 0.186)}
    for start, end, share in lengths.values():
        for side in SIDES:
            segment_m = joints_m[f"{side}_{end}"] - joints_m[f"{side}_{start}"]
            # Thighs and shanks lean sideways with the hips, 3 cm at most.
            assert np.linalg.norm(segment_m, axis=1) == pytest.approx(share * 1.75, rel=2e-3)


def test_fifteen_segments_share_cross_section():
    body = Pedestrian(speed_m_per_s=1.4, rcs_m2=0.2)

    # Each half of the trunk has two pairs of joints, one of them common to both.
    assert len(np.unique(SEGMENT_JOINTS, axis=0)) == 15 + 1
    assert body.cross_sections_m2().sum() == pytest.approx(0.2, rel=1e-12)
    assert 10 * np.log10(Pedestrian(speed_m_per_s=1).rcs_m2) == pytest.approx(-8, abs=0.05)
    assert body.scatterer_offsets_m(np.zeros(3)).shape == (3, 35, 3)


def test_pedestrian_moves_smoothly(radar):
    body = Pedestrian(speed_m_per_s=2.0)
    harmonics_m = (
        np.fft.rfft(body.scatterer_offsets_m(CYCLES * gait_period_s(2.0)), axis=0) / N_PHASES
    )
    # Sines of sums of six harmonics: no jump in any derivative.
    assert abs(harmonics_m[40:]).max() < 1e-8
    assert abs(harmonics_m[60:]).max() < 1e-12

    scene = dc.Scene(
        targets=[Target(position_m=(20, 0, -0.6), velocity_m_per_s=(2, 0, 0), body=body)]
    )
    # A frame of 4.5 ms needs at most two polynomials.
    assert all(len(fit_polynomial_paths(scene, radar.frame, 0.1 * k)) <= 2 for k in range(10))


def test_standing_pedestrian_does_not_move():
    body = Pedestrian(speed_m_per_s=0, height_m=1.8)
    offsets_m = body.scatterer_offsets_m(np.array([0.0, 1.0, 77.7]))

    assert body.is_rigid and not Pedestrian(speed_m_per_s=1).is_rigid
    assert (offsets_m == offsets_m[0]).all()
    # The standing pose has a foot angle of 3 degrees.
    assert compute_joints_m(0.0, 1.8)["CROWN"][0, 2] == pytest.approx(1.8, abs=0.03)


def test_pedestrian_settings_round_trip():
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
    assert parse_settings(dump_yaml(target), Target) == target


@pytest.mark.parametrize(
    ("settings", "message"),
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
def test_rejects_invalid_pedestrian(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        Pedestrian(**{"speed_m_per_s": 1.4, **settings})
