"""Sensor model: OSI views in, detections and tracks out; hand computations of small worlds."""

import math
import os
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.findings import PhysicsWarning
from dechirp.traffic.osi_views import OsiViews
from nightly import nightly
from sample_osi_views import make_view

EXAMPLES = Path(__file__).parents[2] / "examples"
SensorView = pytest.importorskip("osi3.osi_sensorview_pb2").SensorView


@pytest.fixture(scope="module")
def radar() -> dc.Radar:
    """3 x 4 antennas in a row, 77 GHz, 0.6 m and 0.5 m/s a cell."""
    radar = dc.load(EXAMPLES / "mimo.yaml").radar
    assert radar is not None
    return replace(radar, frame=replace(radar.frame, n_chirps=64))


def test_sensor_model_states_positions_and_velocities_relative_to_the_radar(radar):
    # The host stands at (100, 50) and looks along +y; a car 40 m before its bumper drives away at
    # 5 m/s. The radar is 2.25 m before the centre.
    model = dc.SensorModel(radar, kind="samples", seed=1)
    for step in range(6):
        time_s = 0.1 * step
        view = make_view(
            time_s,
            {"id": 1, "x": 100.0, "y": 50.0, "yaw": math.pi / 2},
            {"id": 7, "x": 100.0, "y": 50 + 2.25 + 40 + 2.25 + 5 * time_s, "yaw": math.pi / 2,
             "vx": 0.0, "vy": 5.0},
        )  # fmt: skip
        data = model.step(view)
    assert data.timestamp.nanos == 500_000_000
    detections = data.feature_data.radar_sensor[0].detection
    assert detections
    # The car's tail is at 42.5 m; its echo comes from its box, 4.5 m long. Radial velocities are
    # positive towards the sensor; the wheels' points move at 0 to 10 m/s.
    for detection in detections:
        assert 42 < detection.position.distance < 48
        assert -10.5 < detection.radial_velocity < 0.5
        assert abs(detection.position.azimuth) < 0.05
    confirmed = [m for m in data.moving_object if m.header.existence_probability == 1]
    assert confirmed
    best = min(confirmed, key=lambda m: abs(m.base.velocity.x - 5))
    assert best.base.velocity.x == pytest.approx(5.0, abs=0.3)
    assert best.base.position.y == pytest.approx(0.0, abs=1.0)


@nightly
def test_same_views_and_seed_yield_the_same_data(radar):
    views = [
        make_view(0.1 * k, {"id": 1}, {"id": 2, "x": 30 + k, "vx": 10.0}).SerializeToString()
        for k in range(3)
    ]

    def run(seed, kind):
        model = dc.SensorModel(radar, kind=kind, seed=seed)
        return [model.step(view).SerializeToString(deterministic=True) for view in views]

    for kind in ("samples", "statistical"):
        assert run(3, kind) == run(3, kind)
        assert run(3, kind) != run(4, kind)


def test_statistical_sensor_detects_where_samples_do(radar):
    # Both see the same car, well above the threshold: its nearest detection lies on its tail, whose
    # corners and panel are within 0.6 m, a cell.
    nearest = {}
    for kind in ("samples", "statistical"):
        model = dc.SensorModel(radar, kind=kind, seed=2)
        ranges = []
        for k in range(5):
            result = model.measure(
                make_view(0.1 * k, {"id": 1, "vx": 20.0, "x": 2.0 * k},
                          {"id": 2, "x": 30 + 2.0 * k, "vx": 20.0})
            )  # fmt: skip
            ranges.append(float(result.detections.range.min()))
        nearest[kind] = np.median(ranges)
    tail_m = 30 - 2.25 - 2.25
    for kind, range_m in nearest.items():
        assert tail_m - 0.6 < range_m < tail_m + 1.2, kind


def test_velocities_missing_or_zero_come_from_positions():
    # x = 20 t + t^2: with the change of the mean velocity, constant acceleration is exact.
    for stated in ({}, {"vx": 0.0, "vy": 0.0}):
        views, velocities = OsiViews(), []
        for k in range(4):
            t = 0.1 * k
            read = views.read(make_view(t, {"id": 1}, {"id": 2, "x": 20 * t + t**2, **stated}))
            views.accept()
            velocities.append(read.objects[0].motion.velocity_m_per_s[0])
        assert velocities[0] == 0
        np.testing.assert_allclose(velocities[2:], [20.4, 20.6], rtol=1e-9)


def test_stated_velocities_and_objects_at_rest_are_kept():
    views = OsiViews()
    for k in range(3):
        read = views.read(
            make_view(
                0.1 * k,
                {"id": 1},
                {"id": 2, "x": 20.0 + k, "vx": 9.0, "vy": 0.0},  # positions would say 10 m/s
                {"id": 3, "x": 30.0 + 0.001 * k, "vx": 0.0, "vy": 0.0},
            )
        )
        views.accept()
    assert [o.motion.velocity_m_per_s[0] for o in read.objects] == [9.0, 0.0]


def test_mounting_position_of_the_view_counts_from_the_rear_axle(radar):
    # Rear axle 1.4 m behind and 0.45 m below the centre of a box 1.5 m high; the radar 3.8 m before
    # and 0.2 m above the axle: 2.4 m before the centre, 0.5 m above the ground.
    view = make_view(0.0, {"id": 1, "rear": (-1.4, 0.0, -0.45)}, {"id": 2, "x": 30.0})
    view.mounting_position.position.x, view.mounting_position.position.z = 3.8, 0.2
    view.mounting_position.orientation.yaw = 0.1
    view.mounting_position.orientation.pitch = 0.02
    mounting = OsiViews().read(view).mounting
    assert mounting is not None
    np.testing.assert_allclose(mounting.position_m, (2.4, 0.0, 0.5), atol=1e-12)
    assert (mounting.yaw_rad, mounting.pitch_rad) == (0.1, -0.02)
    data = dc.SensorModel(radar, kind="statistical").step(view)
    assert data.mounting_position.position.x == pytest.approx(3.8)
    assert data.mounting_position.position.z == pytest.approx(0.2)
    assert data.mounting_position.orientation.pitch == pytest.approx(0.02)


def test_moving_radar_adds_the_turn_of_its_vehicle(radar):
    # A host that turns at 0.5 rad/s with the radar 2.25 m before its centre moves it by 1.125 m/s
    # to the left. Seen by a radar that looks left, a car at rest there approaches at that speed.
    mount = dc.Mounting(position_m=(2.25, 0.0, 0.5), yaw_rad=math.pi / 2)
    model = dc.SensorModel(radar, mount=mount, seed=1)
    result = model.measure(
        make_view(0.0, {"id": 1, "yaw_rate": 0.5}, {"id": 2, "x": 2.25, "y": 25.0})
    )
    np.testing.assert_allclose(result.scene.target_velocities_m_per_s([0.0])[0, 0, 0], -1.125)
    assert result.detections.velocity.values == pytest.approx(-1.125, abs=0.1)


def test_errors_name_object_and_time_and_the_model_continues(radar):
    model = dc.SensorModel(radar, kind="statistical")
    model.step(make_view(0.5, {"id": 1}, {"id": 2, "x": 30.0}))
    no_host = make_view(0.6, {"id": 1}, {"id": 2, "x": 30.0})
    no_host.ClearField("host_vehicle_id")
    no_host.global_ground_truth.ClearField("host_vehicle_id")
    no_time = make_view(0.6, {"id": 7}, {"id": 2, "x": 30.0})
    no_time.ClearField("timestamp")
    no_time.global_ground_truth.ClearField("timestamp")
    old = make_view(0.6, {"id": 1})
    old.version.version_major = 2
    for view, texts in (
        (make_view(0.4, {"id": 1}), ("0.4 s, with object 1, after one at 0.5 s",)),
        (make_view(0.5, {"id": 1}), ("0.5 s, with object 1, after one at 0.5 s",)),
        (no_host, ("0.6 s, with object 1, without host", "set SensorView.host_vehicle_id")),
        (no_time, ("a view, with object 7, without timestamp", "set SensorView.timestamp")),
        (make_view(0.6, {"id": 1, "host": 9}), ("host vehicle 9", "0.6 s")),
        (make_view(0.6, {"id": 1}, {"id": 2, "length": -1.0}), ("object 2 at 0.6 s", "length -1")),
        (make_view(0.6, {"id": 1}, {"id": 2, "length": 0.01}), ("object 2 at 0.6 s", "length_m")),
        (make_view(0.6, {"id": 1}, {"id": 2, "x": math.nan}), ("object 2 at 0.6 s",)),
        (make_view(0.6, {"id": 1}, {"id": 2, "vx": 4e8}), ("object 2 at 0.6 s", "velocity")),
        (make_view(0.6, {"id": 1}, {"id": 2}, {"id": 2}), ("object 2 twice at 0.6 s",)),
        (old, ("a view at 0.6 s, with object 1, of OSI version 2",)),
        (b"\xff\x01", ("2 bytes",)),
        ("view", ("a str",)),
    ):
        with pytest.raises(dc.InvalidSetting) as error:
            model.step(view)
        for text in texts:
            assert text in str(error.value)
    assert model.step(make_view(0.6, {"id": 1}, {"id": 2, "x": 30.0})).timestamp.nanos == 600000000


def test_scenarios_of_traffic_step_with_their_trackers(tmp_path):
    path = tmp_path / "trace.csv"
    row = "1,car,0,0,0,4.5,1.8,1.5"
    path.write_text(f"time,id,class,x,y,heading,length,width,height\n0,{row}\n1,{row}\n", "utf-8")
    scenario = dc.traffic.traffic_scenario(path, ["traffic.ego=1", "radar.frame.n_chirps=32"])
    assert scenario.n_frames < scenario.tracker.confirm_after[0]

    model = dc.SensorModel(scenario, kind="statistical")
    for k in range(4):
        view = make_view(0.05 * k, {"id": 1}, {"id": 2, "x": 20.0 + 0.2 * k, "vx": 4.0})
        tracks = model.measure(view).tracks

    assert [track.status for track in tracks] == ["confirmed"]


def test_changing_classes_and_sizes_are_reported(radar):
    model = dc.SensorModel(radar, kind="statistical")
    with pytest.warns(PhysicsWarning, match="object 2 at 0.2 s: car of 4.55 x .* car of 6 x "):
        for k in range(4):
            length = 4.5 + 0.05 * k if k < 2 else 6.0
            model.step(make_view(0.1 * k, {"id": 1}, {"id": 2, "x": 30.0, "length": length}))
    assert [finding.setting for finding in model.findings].count("view.change") == 1


def test_surprising_views_give_one_finding_for_each_object(radar):
    model = dc.SensorModel(radar, kind="statistical")
    with pytest.warns(PhysicsWarning):
        for k in range(3):
            view = make_view(
                0.1 * k,
                {"id": 1},
                {"id": 2, "x": 30.0 + k, "length": None},
                {"id": 3, "x": 60.0 * (k + 1)},
                {"id": 4, "x": 2.0},
            )
            stationary = view.global_ground_truth.stationary_object.add()
            stationary.id.value, stationary.base.position.x = 9, 50.0
            model.step(view)
    texts = [str(finding) for finding in model.findings]
    for subject, text in (
        ("size", "object 2 at 0 s without length"),
        ("velocity", "object 2 at 0 s is missing"),
        ("position", "object 3 jumps by 60 m at 0.1 s"),
        ("mounting_position", "inside object 4 from 0 s on"),
        ("stationary", "1 stationary object at 0 s: 1 wall"),
    ):
        assert sum(t.startswith(f"view.{subject}:") and text in t for t in texts) == 1
    assert len(texts) == len(set(texts))


def test_object_sent_again_with_a_new_id_is_reported_once():
    views, findings = OsiViews(), []
    for k in range(3):
        car = {"x": 30.0 + k, "vx": 10.0}
        apart = {"x": 60.0, "y": 3.5, "vx": 0.0}
        view = make_view(
            0.1 * k, {"id": 1, "vx": 0.0}, {"id": 2, **car}, {"id": 3, **apart}, {"id": 8, **car}
        )
        findings += views.read(view).findings
        views.accept()

    (finding,) = findings
    assert finding.level == "warning" and finding.setting == "view.overlap"
    assert finding.value == "object 8 overlaps object 2 at 0 s, by 1.8 m"  # the width
    assert finding.fix.startswith("correct their positions or sizes, or remove one of them")


def test_component_of_velocity_that_is_not_set_is_zero():
    moving = OsiViews().read(make_view(0.0, {"id": 1}, {"id": 2, "x": 30.0, "vx": 10.0}))

    np.testing.assert_array_equal(moving.objects[0].motion.velocity_m_per_s, [10.0, 0.0])
    velocities = [item.value for item in moving.findings if item.setting == "view.velocity"]
    assert velocities == ["the velocity of object 1 at 0 s is missing"]


def test_empty_world_has_false_alarms_at_most(radar):
    for kind in ("samples", "statistical"):
        data = dc.SensorModel(radar, kind=kind).step(make_view(0.0, {"id": 1}))
        # At 1e-6 in 64 x 256 cells more than 3 of them happen once in 10^9 frames.
        assert len(data.feature_data.radar_sensor[0].detection) <= 3
        assert not data.moving_object or len(data.moving_object) <= 3


def test_settings_are_checked(radar):
    for arguments, text in (
        ({"kind": "ideal"}, "SensorModel.kind"),
        ({"mount": "roof"}, "traffic.mount"),
        ({"seed": -1}, "SensorModel.seed"),
    ):
        with pytest.raises(dc.InvalidSetting, match=text):
            dc.SensorModel(radar, **arguments)


@nightly
@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")
def test_mutated_views_are_refused_or_measured(radar):
    # Bytes of a valid view with one changed, cut or doubled: a result or a DechirpError.
    rng = np.random.default_rng(5)
    model = dc.SensorModel(radar, kind="statistical", seed=1)
    n_refused = 0
    for k in range(150):
        view = make_view(0.1 * k, {"id": 1, "vx": 10.0, "x": k}, {"id": 2, "x": 30.0 + k})
        content = bytearray(view.SerializeToString())
        place = int(rng.integers(len(content)))
        kind = rng.integers(3)
        if kind == 0:
            content[place] = int(rng.integers(256))
        elif kind == 1:
            del content[place:]
        else:
            content[place:place] = content[place : place + 8]
        try:
            model.step(bytes(content))
        except dc.DechirpError:
            n_refused += 1
    assert 20 < n_refused < 150
    assert model.step(make_view(100.0, {"id": 1}, {"id": 2, "x": 30.0})).timestamp.seconds == 100


def test_recorded_views_of_a_standing_car_are_measured_at_its_place(radar):
    # Host at x = 10 m, its radar 0.646 m behind its centre; a car 5 x 2 m at 25 m, turned by 135
    # degrees: its box lies 13.2 to 18.1 m before the radar, and it stands.
    folder = os.environ.get("DECHIRP_WITNESS_DATA")
    traces = sorted(Path(folder or "").glob("osi_traces/*.osi")) if folder else []
    if not traces:
        pytest.skip("needs osi_traces of DECHIRP_WITNESS_DATA")
    content, offset, model = traces[0].read_bytes(), 0, dc.SensorModel(radar, seed=1)
    for _ in range(4):
        (n_bytes,) = struct.unpack_from("<I", content, offset)
        data = model.step(content[offset + 4 : offset + 4 + n_bytes])
        offset += 4 + n_bytes
        detections = data.feature_data.radar_sensor[0].detection
        assert any(
            13.0 < item.position.distance < 18.5 and abs(item.radial_velocity) < 0.1
            for item in detections
        )
    assert data.mounting_position.position.x == pytest.approx(0.5)
