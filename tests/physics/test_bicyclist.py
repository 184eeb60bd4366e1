"""A bicyclist who rides."""

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump
from dechirp.config.loading import parse_settings
from dechirp.scene.bodies.bicyclist import Bicyclist
from dechirp.scene.skeleton import SEGMENT_JOINTS, Joint
from dechirp.scene.target import Target
from dechirp.scene.trajectories import fit_paths

RIDER = slice(0, 35)
PEDALS = slice(59, 61)
WHEELS = slice(61, None)
STEP_S = 1e-5


def velocities_m_per_s(body, times_s):
    """Of the scatterers over the ground, (n_times, n_scatterers, 3)."""
    ahead_m, behind_m = (body.offsets_m(times_s + way * STEP_S) for way in (1, -1))
    return (ahead_m - behind_m) / (2 * STEP_S) + (body.speed_m_per_s, 0, 0)


@pytest.mark.parametrize(("speed", "radius_m"), [(5.0, 0.34), (8.0, 0.25)])
def test_wheels_roll_from_standing_to_twice_the_speed(speed, radius_m):
    body = Bicyclist(speed_m_per_s=speed, wheel_radius_m=radius_m)
    times_s = np.linspace(0, 2 * np.pi * radius_m / speed, 321)
    forward = velocities_m_per_s(body, times_s)[:, WHEELS, 0]

    # Points pass the top and the ground in one of 321 times, within 0.6 degrees.
    assert forward.min() == pytest.approx(0, abs=1e-3 * speed)
    assert forward.max() == pytest.approx(2 * speed, rel=1e-3)
    assert body.offsets_m(times_s)[:, WHEELS, 2].min() == pytest.approx(0, abs=1e-4)
    assert body.offsets_m(times_s)[:, WHEELS, 2].max() == pytest.approx(2 * radius_m, rel=1e-3)
    # One spoke is as the next a sixteenth of a turn later.
    sixteenth_s = 2 * np.pi * radius_m / speed / 16
    spokes_m = body.offsets_m(np.array([0.0, sixteenth_s]))[:, WHEELS].reshape(2, 2, 16, 3, 3)
    assert spokes_m[1] == pytest.approx(np.roll(spokes_m[0], -1, axis=1), abs=1e-12)


def test_what_is_on_top_of_a_wheel_goes_ahead():
    body = Bicyclist(speed_m_per_s=5.0)
    velocities = velocities_m_per_s(body, np.zeros(1))[0, WHEELS]
    heights_m = body.offsets_m(np.zeros(1))[0, WHEELS, 2]

    assert velocities[:, 0] == pytest.approx(5.0 * heights_m / 0.34, abs=1e-6)


def test_pedals_turn_at_the_cadence_of_the_gear():
    body = Bicyclist(speed_m_per_s=6.0, development_m=4.0, phase_rad=0.3)
    times_s = np.linspace(0, 0.5, 30)
    offsets_m = body.offsets_m(times_s)

    assert body.cadence_hz == 1.5
    # The rider repeats after a turn and pedals with the other leg half a turn later.
    again_m = body.offsets_m(times_s + 1 / 1.5)
    assert again_m[:, : WHEELS.start] == pytest.approx(offsets_m[:, : WHEELS.start], abs=1e-12)
    half_m = body.offsets_m(times_s + 0.5 / 1.5)[:, PEDALS]
    assert half_m[:, ::-1] * (1, -1, 1) == pytest.approx(offsets_m[:, PEDALS], abs=1e-12)
    # About the crank axle, 0.097 of the height long, to the front when on top.
    radii_m = np.linalg.norm(offsets_m[:, PEDALS][..., [0, 2]] - (0, 0.27), axis=-1)
    assert radii_m == pytest.approx(np.full((30, 2), 0.097 * 1.75), rel=1e-12)
    on_top = Bicyclist(speed_m_per_s=6.0, development_m=4.0)
    forward = velocities_m_per_s(on_top, np.zeros(1))[0, PEDALS, 0] - 6.0
    assert forward == pytest.approx(2 * np.pi * 1.5 * 0.097 * 1.75 * np.array([1, -1]), rel=1e-6)


@pytest.mark.parametrize("height_m", [1.2, 1.75, 2.0])
def test_the_rider_pedals_with_the_legs_alone(height_m):
    body = Bicyclist(speed_m_per_s=5.0, height_m=height_m)
    times_s = np.linspace(0, 1 / body.cadence_hz, 200)
    moves_m = np.ptp(body.offsets_m(times_s)[:, RIDER], axis=0).max(axis=-1)

    of_legs = (SEGMENT_JOINTS >= Joint.LEFT_HIP).all(axis=1)
    of_hips = np.isin(SEGMENT_JOINTS[:, 0], (Joint.LEFT_HIP,)) & np.isin(
        SEGMENT_JOINTS[:, 1], (Joint.RIGHT_HIP,)
    )
    assert moves_m[~of_legs].max() == 0
    assert moves_m[of_legs & ~of_hips].min() > 0.02
    # Feet go with the pedals, on circles.
    feet_m = body.offsets_m(times_s)[:, RIDER][:, SEGMENT_JOINTS[:, 0] == Joint.LEFT_HEEL]
    apart_m = feet_m - body.offsets_m(times_s)[:, PEDALS][:, :1]
    assert np.ptp(apart_m, axis=0).max() < 1e-12
    # Thighs and shanks keep their lengths: three points on each are a third apart.
    for joint, share in ((Joint.LEFT_HIP, 0.245), (Joint.RIGHT_KNEE, 0.246)):
        chosen = (SEGMENT_JOINTS[:, 0] == joint) & ~of_hips
        limb_m = body.offsets_m(times_s)[:, RIDER][:, chosen]
        lengths_m = np.linalg.norm(limb_m[:, 2] - limb_m[:, 0], axis=-1) * 1.5
        assert lengths_m == pytest.approx(np.full(200, share * height_m), rel=1e-9)
    # Knees are ahead of the line from hip to ankle.
    thigh_m, shank_m = (
        body.offsets_m(times_s)[:, RIDER][:, (SEGMENT_JOINTS[:, 0] == joint) & ~of_hips][
            ..., [0, 2]
        ]
        for joint in (Joint.LEFT_HIP, Joint.LEFT_KNEE)
    )
    along, after = thigh_m[:, 2] - thigh_m[:, 0], shank_m[:, 2] - shank_m[:, 0]
    assert np.all(along[:, 0] * after[:, 1] - along[:, 1] * after[:, 0] < 0)


def test_who_does_not_pedal_rolls():
    body = Bicyclist(speed_m_per_s=15.0, development_m=None)
    offsets_m = body.offsets_m(np.array([0.0, 0.01]))

    assert body.cadence_hz == 0
    assert (offsets_m[0, : WHEELS.start] == offsets_m[1, : WHEELS.start]).all()
    assert abs(np.diff(offsets_m[:, WHEELS], axis=0)).max() > 0.1
    assert Bicyclist(speed_m_per_s=0).is_rigid and not body.is_rigid


def test_a_bicyclist_shares_its_cross_section_among_its_parts(radar):
    body = Bicyclist(speed_m_per_s=5.0, n_spokes=20, rcs_m2=0.5)
    shares = body.cross_sections_m2() / 0.5

    assert shares.sum() == pytest.approx(1, rel=1e-12)
    assert shares[RIDER].sum() == pytest.approx(0.5, rel=1e-12)
    assert shares[WHEELS].sum() == pytest.approx(0.3, rel=1e-12)
    assert body.n_scatterers() == WHEELS.start + 2 * 3 * 20 == body.offsets_m(np.zeros(1)).shape[1]
    target = Target(position_m=(20, 0, -0.6), velocity_m_per_s=(5, 0, 0), body=body)
    assert len(fit_paths(dc.Scene(targets=[target]), radar.frame, 0.3)) <= 4


def test_settings_files_say_how_a_bicyclist_rides():
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
        assert parse_settings(dump(target), Target) == target


@pytest.mark.parametrize(
    ("given", "message"),
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
def test_a_bicyclist_that_cannot_be_is_refused(given, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        Bicyclist(**{"speed_m_per_s": 5.0, **given})
