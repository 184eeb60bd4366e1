"""Bicyclist body: wheels, pedals, rider, cross section and settings."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.bicyclist import Bicyclist
from dechirp.scene.skeleton import SEGMENT_JOINTS, Joint
from dechirp.scene.target import Target
from dechirp.scene.trajectories import fit_polynomial_paths

RIDER_POINTS = slice(0, 35)
PEDAL_POINTS = slice(59, 61)
WHEEL_POINTS = slice(61, None)
STEP_S = 1e-5


def scatterer_velocities_m_per_s(body, times_s):
    """Return the velocities of the scatterers over ground, (n_times, n_scatterers, 3)."""
    next_m, previous_m = (body.scatterer_offsets_m(times_s + sign * STEP_S) for sign in (1, -1))
    return (next_m - previous_m) / (2 * STEP_S) + (body.speed_m_per_s, 0, 0)


@pytest.mark.parametrize(("speed", "radius_m"), [(5.0, 0.34), (8.0, 0.25)])
def test_wheel_points_move_between_zero_and_twice_the_speed(speed, radius_m):
    body = Bicyclist(speed_m_per_s=speed, wheel_radius_m=radius_m)
    times_s = np.linspace(0, 2 * np.pi * radius_m / speed, 321)
    forward = scatterer_velocities_m_per_s(body, times_s)[:, WHEEL_POINTS, 0]

    # Scatterers pass the top and the ground at one of 321 times, within 0.6 degrees.
    assert forward.min() == pytest.approx(0, abs=1e-3 * speed)
    assert forward.max() == pytest.approx(2 * speed, rel=1e-3)
    assert body.scatterer_offsets_m(times_s)[:, WHEEL_POINTS, 2].min() == pytest.approx(0, abs=1e-4)
    assert body.scatterer_offsets_m(times_s)[:, WHEEL_POINTS, 2].max() == pytest.approx(
        2 * radius_m, rel=1e-3
    )
    # Each spoke takes the place of the next one after a sixteenth of a turn.
    sixteenth_s = 2 * np.pi * radius_m / speed / 16
    spokes_m = body.scatterer_offsets_m(np.array([0.0, sixteenth_s]))[:, WHEEL_POINTS].reshape(
        2, 2, 16, 3, 3
    )
    assert spokes_m[1] == pytest.approx(np.roll(spokes_m[0], -1, axis=1), abs=1e-12)


def test_top_of_wheel_moves_forward():
    body = Bicyclist(speed_m_per_s=5.0)
    velocities = scatterer_velocities_m_per_s(body, np.zeros(1))[0, WHEEL_POINTS]
    heights_m = body.scatterer_offsets_m(np.zeros(1))[0, WHEEL_POINTS, 2]

    assert velocities[:, 0] == pytest.approx(5.0 * heights_m / 0.34, abs=1e-6)


def test_pedals_rotate_at_cadence():
    body = Bicyclist(speed_m_per_s=6.0, development_m=4.0, phase_rad=0.3)
    times_s = np.linspace(0, 0.5, 30)
    offsets_m = body.scatterer_offsets_m(times_s)

    assert body.cadence_hz == 1.5
    # The pose repeats after one turn, and with exchanged legs after half a turn.
    next_turn_m = body.scatterer_offsets_m(times_s + 1 / 1.5)
    assert next_turn_m[:, : WHEEL_POINTS.start] == pytest.approx(
        offsets_m[:, : WHEEL_POINTS.start], abs=1e-12
    )
    half_turn_m = body.scatterer_offsets_m(times_s + 0.5 / 1.5)[:, PEDAL_POINTS]
    assert half_turn_m[:, ::-1] * (1, -1, 1) == pytest.approx(offsets_m[:, PEDAL_POINTS], abs=1e-12)
    # The pedals circle around the crank axle at 0.097 of the height, and move forward at the top.
    radii_m = np.linalg.norm(offsets_m[:, PEDAL_POINTS][..., [0, 2]] - (0, 0.27), axis=-1)
    assert radii_m == pytest.approx(np.full((30, 2), 0.097 * 1.75), rel=1e-12)
    top_position = Bicyclist(speed_m_per_s=6.0, development_m=4.0)
    forward = scatterer_velocities_m_per_s(top_position, np.zeros(1))[0, PEDAL_POINTS, 0] - 6.0
    assert forward == pytest.approx(2 * np.pi * 1.5 * 0.097 * 1.75 * np.array([1, -1]), rel=1e-6)


@pytest.mark.parametrize("height_m", [1.2, 1.75, 2.0])
def test_only_legs_of_rider_move(height_m):
    body = Bicyclist(speed_m_per_s=5.0, height_m=height_m)
    times_s = np.linspace(0, 1 / body.cadence_hz, 200)
    moves_m = np.ptp(body.scatterer_offsets_m(times_s)[:, RIDER_POINTS], axis=0).max(axis=-1)

    is_leg = (SEGMENT_JOINTS >= Joint.LEFT_HIP).all(axis=1)
    is_hip = np.isin(SEGMENT_JOINTS[:, 0], (Joint.LEFT_HIP,)) & np.isin(
        SEGMENT_JOINTS[:, 1], (Joint.RIGHT_HIP,)
    )
    assert moves_m[~is_leg].max() == 0
    assert moves_m[is_leg & ~is_hip].min() > 0.02
    # The feet follow the pedals on circles.
    feet_m = body.scatterer_offsets_m(times_s)[:, RIDER_POINTS][
        :, SEGMENT_JOINTS[:, 0] == Joint.LEFT_HEEL
    ]
    pedal_offset_m = feet_m - body.scatterer_offsets_m(times_s)[:, PEDAL_POINTS][:, :1]
    assert np.ptp(pedal_offset_m, axis=0).max() < 1e-12
    # Thighs and shanks keep their lengths: the three points on each are a third of it apart.
    for joint, share in ((Joint.LEFT_HIP, 0.245), (Joint.RIGHT_KNEE, 0.246)):
        is_limb = (SEGMENT_JOINTS[:, 0] == joint) & ~is_hip
        limb_m = body.scatterer_offsets_m(times_s)[:, RIDER_POINTS][:, is_limb]
        lengths_m = np.linalg.norm(limb_m[:, 2] - limb_m[:, 0], axis=-1) * 1.5
        assert lengths_m == pytest.approx(np.full(200, share * height_m), rel=1e-9)
    # The knees are in front of the line from hip to ankle.
    thigh_m, shank_m = (
        body.scatterer_offsets_m(times_s)[:, RIDER_POINTS][
            :, (SEGMENT_JOINTS[:, 0] == joint) & ~is_hip
        ][..., [0, 2]]
        for joint in (Joint.LEFT_HIP, Joint.LEFT_KNEE)
    )
    thigh_direction_m, shank_direction_m = (
        thigh_m[:, 2] - thigh_m[:, 0],
        shank_m[:, 2] - shank_m[:, 0],
    )
    assert np.all(
        thigh_direction_m[:, 0] * shank_direction_m[:, 1]
        - thigh_direction_m[:, 1] * shank_direction_m[:, 0]
        < 0
    )


def test_coasting_bicyclist_rotates_wheels_only():
    body = Bicyclist(speed_m_per_s=15.0, development_m=None)
    offsets_m = body.scatterer_offsets_m(np.array([0.0, 0.01]))

    assert body.cadence_hz == 0
    assert (offsets_m[0, : WHEEL_POINTS.start] == offsets_m[1, : WHEEL_POINTS.start]).all()
    assert abs(np.diff(offsets_m[:, WHEEL_POINTS], axis=0)).max() > 0.1
    assert Bicyclist(speed_m_per_s=0).is_rigid and not body.is_rigid


def test_cross_section_is_divided_among_parts(radar):
    body = Bicyclist(speed_m_per_s=5.0, n_spokes=20, rcs_m2=0.5)
    shares = body.cross_sections_m2() / 0.5

    assert shares.sum() == pytest.approx(1, rel=1e-12)
    assert shares[RIDER_POINTS].sum() == pytest.approx(0.5, rel=1e-12)
    assert shares[WHEEL_POINTS].sum() == pytest.approx(0.3, rel=1e-12)
    assert (
        body.n_scatterers()
        == WHEEL_POINTS.start + 2 * 3 * 20
        == body.scatterer_offsets_m(np.zeros(1)).shape[1]
    )
    target = Target(position_m=(20, 0, -0.6), velocity_m_per_s=(5, 0, 0), body=body)
    assert len(fit_polynomial_paths(dc.Scene(targets=[target]), radar.frame, 0.3)) <= 4


def test_settings_file_round_trips_bicyclist():
    for gear, development_m in (("4.5 m", 4.5), ("null", None)):
        text = f"""\
position: [20 m, 3 m, -0.6 m]
velocity: [0 m/s, -5 m/s, 0 m/s]
body: {{kind: bicyclist, speed: 18 km/h, wheel_radius: 330 mm, n_spokes: 24, development: {gear},
       phase: 90 deg, rcs: -3 dBsm}}
"""
        target = parse_settings(text, Target)
        assert target.body.speed_m_per_s == pytest.approx(5, rel=1e-15)
        assert (target.body.n_spokes, target.body.development_m) == (24, development_m)
        assert parse_settings(dump_yaml(target), Target) == target


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"height_m": -1.7}, "Bicyclist.height_m: -1.7"),
        ({"speed_m_per_s": -5}, "Bicyclist.speed_m_per_s: -5"),
        ({"speed_m_per_s": 60}, "Bicyclist.speed_m_per_s: 60"),
        ({"wheel_radius_m": 0}, "Bicyclist.wheel_radius_m: 0"),
        ({"wheel_radius_m": 0.7}, "Bicyclist.wheel_radius_m: 0.7"),
        ({"n_spokes": 2.5}, "Bicyclist.n_spokes: 2.5"),
        ({"development_m": 0}, "Bicyclist.development_m: 0"),
        ({"development_m": 1.0}, "development_m: 1 m: 300 crank turns per minute at 5 m/s"),
        ({"phase_rad": np.inf}, "Bicyclist.phase_rad: inf"),
        ({"rcs_m2": -1}, "Bicyclist.rcs_m2: -1"),
    ],
)
def test_rejects_invalid_bicyclist(settings, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        Bicyclist(**{"speed_m_per_s": 5.0, **settings})
