"""Bodies of several scatterers: motion, point clouds, aspect-dependent cross sections, settings."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.config.dumping import dump_yaml
from dechirp.config.loading import parse_settings
from dechirp.core.errors import InvalidFile
from dechirp.core.values import frozen_dataclass
from dechirp.radar.budget import received_power_w
from dechirp.scene.bodies.base import Body
from dechirp.scene.bodies.point_cloud import PointCloud
from dechirp.scene.bodies.points import Oscillation, Points, Rotation, Scatterer
from dechirp.scene.ego import Ego
from dechirp.scene.rcs import scatterer_cross_sections_m2, target_cross_sections_m2
from dechirp.scene.rcs_table import RcsTable
from dechirp.scene.scene import Scene
from dechirp.scene.target import Target
from dechirp.scene.truth import truth
from dechirp.scene.waypoints import Waypoint


def make_scatterer(**fields):
    return Scatterer(**{"position_m": (1, 0.5, 0.3), "rcs_m2": 0.1, **fields})


def offsets_m(scatterer, times_s):
    return Points(scatterers=(scatterer,)).scatterer_offsets_m(np.asarray(times_s))[:, 0]


def test_rotation_moves_top_of_wheel_forward_on_a_circle():
    rim = make_scatterer(
        position_m=(1, 0.8, 0.6), rotation=Rotation(center_m=(1, 0.5, 0.3), rate_rad_per_s=50)
    )
    times_s = np.linspace(0, 2 * np.pi / 50, 9)
    path_m = offsets_m(rim, times_s)

    # After a quarter turn the point is in front of the axle, then below, then behind.
    assert path_m[2] == pytest.approx((1.3, 0.8, 0.3), abs=1e-12)
    assert path_m[4] == pytest.approx((1, 0.8, 0), abs=1e-12)
    assert path_m[6] == pytest.approx((0.7, 0.8, 0.3), abs=1e-12)
    assert path_m[8] == pytest.approx(path_m[0], abs=1e-12)
    radii_m = np.hypot(path_m[:, 0] - 1, path_m[:, 2] - 0.3)
    assert radii_m == pytest.approx(np.full(9, 0.3), abs=1e-12)


def test_rotation_normalises_its_axis():
    for axis in ((0, 0, 1), (0, 0, 1e6), (0, 0, 1e-6)):
        rotation = Rotation(center_m=(0, 0, 0), axis=axis, rate_rad_per_s=np.pi)
        positions_m = offsets_m(make_scatterer(position_m=(0.2, 0, 0.7), rotation=rotation), [0.5])
        assert positions_m[0] == pytest.approx((0, 0.2, 0.7), abs=1e-12)


def test_oscillation_is_cosine_about_rest_position():
    oscillation = Oscillation(amplitude_m=(0.3, 0, -0.1), frequency_hz=2, phase_rad=np.pi / 2)
    positions_m = offsets_m(make_scatterer(oscillation=oscillation), [0, 0.125, 0.25])

    for position_m, phase_cosine in zip(positions_m, (1, 0, -1), strict=True):
        assert position_m == pytest.approx(
            (1 + 0.3 * phase_cosine, 0.5, 0.3 - 0.1 * phase_cosine), abs=1e-12
        )


def test_rotation_and_oscillation_combine():
    rotation, oscillation = (
        Rotation(center_m=(0, 0, 0), rate_rad_per_s=3),
        Oscillation(amplitude_m=(0, 0, 0.1), frequency_hz=1),
    )
    combined_m = offsets_m(make_scatterer(rotation=rotation, oscillation=oscillation), [0.1, 0.7])
    separate_sum_m = offsets_m(make_scatterer(rotation=rotation), [0.1, 0.7]) + offsets_m(
        make_scatterer(oscillation=oscillation), [0.1, 0.7]
    )

    assert combined_m == pytest.approx(separate_sum_m - (1, 0.5, 0.3), abs=1e-12)


POSITIONS_M = np.array([(1.0, 2.0, 3.0), (-4.0, 5.0, -6.0)])


def test_point_cloud_equals_body_of_points():
    cloud = PointCloud(positions_m=POSITIONS_M, rcs_m2=np.array([0.5, 2.0]))
    points = Points(
        scatterers=[
            Scatterer(position_m=p, rcs_m2=s) for p, s in zip(POSITIONS_M, (0.5, 2), strict=True)
        ]
    )
    times_s = np.array([0.0, 1.0])

    assert (cloud.scatterer_offsets_m(times_s) == points.scatterer_offsets_m(times_s)).all()
    assert (cloud.cross_sections_m2() == points.cross_sections_m2()).all()
    assert cloud.is_rigid and points.is_rigid
    assert cloud == PointCloud(positions_m=POSITIONS_M.tolist(), rcs_m2=(0.5, 2))


def test_point_cloud_copies_its_arrays():
    positions_m, rcs_m2 = POSITIONS_M.copy(), np.array([0.5, 2.0])
    cloud = PointCloud(positions_m=positions_m, rcs_m2=rcs_m2)
    positions_m[:], rcs_m2[:] = 0, 0

    assert cloud.scatterer_offsets_m(np.zeros(1))[0].tolist() == POSITIONS_M.tolist()
    with pytest.raises(ValueError, match="read-only"):
        cloud.scatterer_offsets_m(np.zeros(1))[0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        cloud.cross_sections_m2()[0] = 1


def test_scatterers_are_ordered_by_target():
    body = PointCloud(positions_m=POSITIONS_M, rcs_m2=(0.5, 2))
    scene = Scene(
        targets=[
            Target(position_m=(10, 0, 0), rcs_m2=7),
            Target(position_m=(20, 0, 0), body=body, heading_rad=np.pi / 2),
            Target(position_m=(30, 0, 0), rcs_m2=9),
        ]
    )

    assert scene.target_index_of_scatterer.tolist() == [0, 1, 1, 2]
    assert scatterer_cross_sections_m2(scene, 0.0, 0.0039).tolist() == [7, 0.5, 2, 9]
    assert target_cross_sections_m2(scene, [0.0, 1.0], 0.0039).tolist() == [[7, 2.5, 9]] * 2
    # The body x axis points left: x becomes y, and y becomes -x.
    assert scene.scatterer_positions_m([0.0])[0] == pytest.approx(
        np.array([(10, 0, 0), (18, 1, 3), (15, -4, -6), (30, 0, 0)]), abs=1e-12
    )


ASPECT_TABLE = RcsTable(
    azimuth_rad=(-np.pi, -np.pi / 2, 0, np.pi / 2, np.pi), rcs_m2=((1, 100, 10, 50, 1),)
)


@pytest.mark.parametrize(
    ("settings", "rcs_m2"),
    [
        ({"heading_rad": np.pi}, 10),  # front aspect
        ({}, 1),  # rear aspect
        ({"heading_rad": np.pi / 2}, 50),  # drives to the left: left aspect
        ({"heading_rad": -np.pi / 2}, 100),
        ({"velocity_m_per_s": (-3, 0, 0)}, 10),
        ({"heading_rad": 3 * np.pi / 4}, np.sqrt(10 * 50)),  # midpoint in decibels
        ({"heading_rad": -np.pi / 4}, np.sqrt(1 * 100)),
    ],
)
def test_cross_section_depends_on_aspect_angle(settings, rcs_m2):
    scene = Scene(targets=[Target(position_m=(20, 0, 0), rcs_table=ASPECT_TABLE, **settings)])

    assert scatterer_cross_sections_m2(scene, 0.0, 0.0039)[0] == pytest.approx(rcs_m2, rel=1e-9)


def test_aspect_angle_depends_on_radar_position_not_orientation():
    target = Target(position_m=(0, 20, 0), rcs_table=ASPECT_TABLE, heading_rad=np.pi / 2)
    for yaw_rad in (0.0, 1.0, np.pi / 2):
        scene = Scene(targets=[target], ego=Ego(yaw_rad=yaw_rad))
        assert scatterer_cross_sections_m2(scene, 0.0, 0.0039)[0] == pytest.approx(1, rel=1e-9)
    # The radar has passed the target: it is 20 m ahead and to its left.
    passed_scene = Scene(targets=[target], ego=Ego(velocity_m_per_s=(-20, 40, 0)))
    assert scatterer_cross_sections_m2(passed_scene, 1.0, 0.0039)[0] == pytest.approx(
        np.sqrt(10 * 50), rel=1e-9
    )


def test_cross_section_depends_on_elevation_aspect():
    table = RcsTable(
        azimuth_rad=(0,), elevation_rad=(-np.pi / 2, 0, np.pi / 2), rcs_m2=((1,), (10,), (1000,))
    )
    for z_m, rcs_m2 in ((0, 10), (-20, np.sqrt(10 * 1000)), (20, np.sqrt(10))):
        scene = Scene(targets=[Target(position_m=(20, 0, z_m), rcs_table=table)])
        assert scatterer_cross_sections_m2(scene, 0.0, 0.0039)[0] == pytest.approx(rcs_m2, rel=1e-9)


def test_cross_section_varies_along_curved_path():
    points = [
        Waypoint(time_s=1, position_m=(20, 10, 0)),
        Waypoint(time_s=2, position_m=(30, 15, 0)),
    ]
    target = Target(position_m=(25, 0, 0), rcs_table=ASPECT_TABLE, waypoints=points)
    scene = Scene(targets=[target])
    cross_sections_m2 = target_cross_sections_m2(scene, [0.0, 0.5, 2.0], 0.0039)[:, 0]

    expected_m2 = [
        scatterer_cross_sections_m2(scene, time_s, 0.0039)[0] for time_s in (0.0, 0.5, 2.0)
    ]
    assert cross_sections_m2 == pytest.approx(expected_m2, rel=1e-12)
    assert np.ptp(cross_sections_m2) > 1


def test_truth_snr_uses_total_cross_section_at_each_frame(radar):
    radar = replace(radar, frame=replace(radar.frame, period_s=1.0))
    body = PointCloud(positions_m=POSITIONS_M, rcs_m2=(0.5, 2))
    passing = Target(
        position_m=(20, 5, 0), velocity_m_per_s=(0, -8, 0), rcs_table=ASPECT_TABLE, heading_rad=0.0
    )
    scene = Scene(targets=[Target(position_m=(20, 0, 0), body=body), passing])
    expected = truth(scene, radar, n_frames=3)

    echo_w = received_power_w(radar, range_m=20.0, rcs_m2=2.5)
    noise_w = received_power_w(radar, range_m=20.0, rcs_m2=1.0)
    body_snr = truth(scene, radar, n_frames=3, noise_power_w=float(noise_w)).snr[0]
    assert body_snr.values == pytest.approx(echo_w / noise_w * radar.integration_gain, rel=1e-9)
    rcs_m2 = target_cross_sections_m2(scene, expected.time.values, 0.0039)[:, 1]
    ratios = expected.snr[1] * expected.range[1] ** 4 / rcs_m2
    assert ratios.values == pytest.approx(np.full(3, ratios.values[0]), rel=1e-9)


def test_white_noise_refers_to_echo_of_all_scatterers(radar):
    body = PointCloud(positions_m=POSITIONS_M, rcs_m2=(0.5, 2))
    noise = dc.impairments.WhiteNoise(snr=4)
    for target, rcs_m2 in (
        (Target(position_m=(20, 0, 0), body=body), 2.5),
        (Target(position_m=(20, 0, 0), rcs_table=ASPECT_TABLE), 1),
    ):
        echo_w = received_power_w(radar, range_m=20.0, rcs_m2=rcs_m2)
        noise_w = noise.noise_power_w(Scene(targets=[target]), radar)
        assert noise_w == pytest.approx(echo_w / 4, rel=1e-9)


SCENE_YAML = """\
ego: {position: [1 m, 0 m, 0.5 m], yaw: 10 deg, pitch: -2 deg, roll: 1 deg,
      velocity: [20 m/s, 0 m/s, 0 m/s], turn_rate: 5 deg/s}
targets:
  - name: car
    position: [30 m, 2 m, 0 m]
    waypoints: [{time: 1 s, position: [40 m, 2 m, 0 m]}, {time: 2 s, position: [48 m, 4 m, 0 m]}]
    fluctuation: swerling-3
    body:
      kind: points
      scatterers:
        - {position: [1 m, 0.8 m, 0.6 m], rcs: -20 dBsm,
           rotation: {center: [1 m, 0.8 m, 0.3 m], axis: [0, 1, 0], rate: 90 deg/s}}
        - {position: [0 m, 0 m, 1 m], rcs: 10 dBsm,
           oscillation: {amplitude: [1 mm, 0 m, 0 m], frequency: 30 Hz, phase: 90 deg}}
  - {name: heap, position: [20 m, -5 m, 0 m], heading: 30 deg,
     body: {kind: point-cloud, positions: [[0, 0, 0], [1 m, 0, 0]], rcs: [1 m^2, 0.5 m^2]}}
  - {name: van, position: [60 m, 0 m, 0 m], acceleration: [-3 m/s^2, 0 m/s^2, 0 m/s^2],
     velocity: [5 m/s, 0 m/s, 0 m/s],
     rcs_table: {azimuth: [-90 deg, 0 deg, 90 deg], rcs: [[20 dBsm, 10 dBsm, 20 dBsm]]}}
"""


def test_settings_file_round_trips_scene():
    scene = parse_settings(SCENE_YAML, Scene)
    car, heap, van = scene.targets

    assert scene.ego.turn_rate_rad_per_s == pytest.approx(np.radians(5), rel=1e-15)
    assert car.waypoints[1] == Waypoint(time_s=2, position_m=(48, 4, 0))
    assert car.body.scatterers[0].rotation.rate_rad_per_s == pytest.approx(np.pi / 2, rel=1e-15)
    assert car.body.scatterers[1].oscillation.amplitude_m == (1e-3, 0, 0)
    assert heap.body == PointCloud(positions_m=((0, 0, 0), (1, 0, 0)), rcs_m2=(1, 0.5))
    assert van.acceleration_m_per_s2 == (-3, 0, 0)
    assert van.rcs_table.rcs_m2 == ((100, 10, 100),)
    assert parse_settings(dump_yaml(scene), Scene) == scene


@pytest.mark.parametrize(
    ("valid_text", "invalid_text", "setting", "line"),
    [
        ("{time: 2 s,", "{time: 0.5 s,", "targets.car.waypoints.1.time", 6),
        ("rate: 90 deg/s", "rate: 90 deg", "targets.car.body.scatterers.0.rotation.rate", 12),
        ("-3 m/s^2", "-3 m/s", "targets.van.acceleration.0", 17),
        ("kind: point-cloud", "kind: clod", "targets.heap.body.kind", 16),
        ("[1 m^2, 0.5 m^2]", "[1 m^2]", "targets.heap.body.rcs", 16),
        ("0 deg, 90 deg]", "0 deg, -9 deg]", "targets.van.rcs_table.azimuth.2", 19),
        ("fluctuation: swerling-3", "rcs: 20 dBsm", "targets.car.body", 8),
    ],
)
def test_scene_mistake_is_reported_with_setting_and_line(valid_text, invalid_text, setting, line):
    with pytest.raises(InvalidFile) as error:
        parse_settings(SCENE_YAML.replace(valid_text, invalid_text), Scene)

    (mistake,) = error.value.mistakes
    assert (mistake.setting, mistake.line) == (setting, line)


@pytest.mark.parametrize(
    ("positions_m", "rcs_m2", "message"),
    [
        ([(0, 0, np.nan)], [1], "PointCloud.positions_m: nan; expected finite"),
        ([(0, 0)], [1], r"PointCloud.positions_m: an array of the shape \(1, 2\)"),
        (np.zeros((0, 3)), [], r"PointCloud.positions_m: an empty array \(0, 3\)"),
        ([(0, 0, 0)], [np.inf], "PointCloud.rcs_m2: inf"),
        ([(0, 0, 0)], [-1], "PointCloud.rcs_m2: -1.0; expected finite and above 0"),
        ([(0, 0, 0)], [1, 2], r"PointCloud.rcs_m2: shape \(2,\)"),
        ([(0, 0, 0)], [1e-30], "PointCloud.rcs_m2: .* a minimum of 1e-30"),
        ([(0, 0, "x")], [1], "PointCloud.positions_m"),
    ],
)
def test_rejects_invalid_point_cloud(positions_m, rcs_m2, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        PointCloud(positions_m=positions_m, rcs_m2=rcs_m2)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Points(scatterers=()), "Points.scatterers"),
        (lambda: Points(scatterers=[(1, 2, 3)]), "Points.scatterers"),
        (lambda: Points(scatterers=np.array(1.0)), "Points.scatterers"),
        (lambda: make_scatterer(position_m=(1, 2)), "Scatterer.position_m"),
        (lambda: make_scatterer(rcs_m2=0), "Scatterer.rcs_m2"),
        (lambda: make_scatterer(rotation=10.0), "Scatterer.rotation: 10.0; .* a Rotation"),
        (lambda: make_scatterer(oscillation=[1, 2]), "Scatterer.oscillation: .* Oscillation"),
        (
            lambda: Rotation(center_m=(0, 0, 0), axis=(0, 0, 0), rate_rad_per_s=1),
            "Rotation.axis: .*a vector of positive length",
        ),
        (lambda: Rotation(center_m=(0, 0, 0), rate_rad_per_s=np.nan), "Rotation.rate_rad_per_s"),
        (lambda: Oscillation(amplitude_m=(1, 0, 0), frequency_hz=-1), "Oscillation.frequency_hz"),
        (
            lambda: Oscillation(amplitude_m=(10, 0, 0), frequency_hz=1e4),
            "a thousandth of the speed of light",
        ),
        (
            lambda: make_scatterer(rotation=Rotation(center_m=(9, 0, 0), rate_rad_per_s=9e4)),
            "Scatterer.rotation: .* m/s on its circle",
        ),
    ],
)
def test_rejects_invalid_scatterer(make, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        make()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rcs_m2": 5, "rcs_table": ASPECT_TABLE}, "rcs_table: cannot be combined with rcs_m2"),
        (
            {"rcs_m2": 5, "body": PointCloud(positions_m=POSITIONS_M, rcs_m2=(1, 1))},
            "body: cannot be combined with",
        ),
        (
            {"rcs_table": ASPECT_TABLE, "body": PointCloud(positions_m=POSITIONS_M, rcs_m2=(1, 1))},
            "rcs_table: cannot be combined with body",
        ),
    ],
)
def test_rejects_target_with_two_cross_section_models(settings, message):
    with pytest.raises(dc.InvalidSetting, match=rf"Target\.{message}"):
        Target(position_m=(10, 0, 0), **settings)


def test_rejects_unsorted_aspect_table():
    with pytest.raises(dc.InvalidSetting, match=r"RcsTable\.azimuth_rad\.2"):
        RcsTable(azimuth_rad=(0, 1, 0.5), rcs_m2=((1, 1, 1),))


@frozen_dataclass
class ThirdPartyBody(Body):
    """Represent a body of another package."""

    rcs: tuple[float, ...]

    def scatterer_offsets_m(self, times_s):
        return np.zeros((len(times_s), 1, 3))

    def cross_sections_m2(self):
        return np.array(self.rcs)


@pytest.mark.parametrize(
    ("rcs", "message"),
    [
        ((np.nan,), "a cross section of nan m"),
        ((-1.0,), "a cross section of -1 m"),
        ((), "a body without scatterers"),
        ((1.0, 1.0), r"positions of the shape \(2, 1, 3\); expected finite positions"),
    ],
)
def test_invalid_third_party_body_is_rejected_with_target_name(radar, rcs, message):
    scene = Scene(targets=[Target(name="bus", position_m=(10, 0, 0), body=ThirdPartyBody(rcs=rcs))])
    with pytest.raises(dc.InvalidSetting, match=rf"^scene\.targets\.bus\.body: .*{message}"):
        dc.truth(scene, radar)
        scene.scatterer_positions_m([0.0, 1.0])
