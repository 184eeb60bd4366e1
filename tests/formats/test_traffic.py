"""Traffic files: positions, velocities from positions, surprising motion and damaged files."""

import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dechirp as dc
from dechirp.traffic.frame_scenes import FrameScenes

HEADER = "time,id,class,x,y,heading,length,width,height"


def write_csv(folder, *rows, header=HEADER):
    path = folder / "traffic.csv"
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def car_row(time_s, x_m, number=7, y_m=0.0, more=""):
    return f"{time_s},{number},car,{x_m},{y_m},0,4.5,1.8,1.5{more}"


def write_osi(folder, messages, name="20200101T000000Z_sv_350_100_1.osi"):
    path = folder / name
    contents = [message.SerializeToString() for message in messages]
    path.write_bytes(b"".join(struct.pack("<I", len(part)) + part for part in contents))
    return path


def make_view(time_s, *, x_m=10.0, vx=None, is_view=True):
    views = pytest.importorskip("osi3.osi_sensorview_pb2")
    truths = pytest.importorskip("osi3.osi_groundtruth_pb2")
    view = views.SensorView()
    truth = view.global_ground_truth if is_view else truths.GroundTruth()
    truth.version.version_major = 3
    truth.timestamp.seconds = int(time_s)
    truth.timestamp.nanos = round((time_s - int(time_s)) * 1e9)
    truth.host_vehicle_id.value = 3
    moving = truth.moving_object.add()
    moving.id.value = 3
    moving.type = moving.TYPE_VEHICLE
    moving.vehicle_classification.type = moving.vehicle_classification.TYPE_HEAVY_TRUCK
    moving.base.position.x, moving.base.position.y, moving.base.position.z = x_m, -2.0, 1.0
    moving.base.orientation.yaw = 0.5
    moving.base.dimension.length = 12.0
    if vx is not None:
        moving.base.velocity.x, moving.base.velocity.y = vx, 0.0
    return view if is_view else truth


@pytest.mark.parametrize("is_view", [True, False])
def test_osi_truth_is_read_from_views_and_from_truths(tmp_path, is_view):
    messages = [make_view(0.1 * step, x_m=10 + step, vx=10, is_view=is_view) for step in range(4)]

    traffic = dc.open_traffic(write_osi(tmp_path, messages))

    assert (traffic.format, traffic.host, traffic.findings) == ("osi-trace", 3, ())
    objects = traffic.objects
    assert objects["kind"].item() == "truck"
    assert np.allclose(objects["time"], [0, 0.1, 0.2, 0.3], rtol=0, atol=1e-9)
    assert objects["x"].values.tolist() == [[10, 11, 12, 13]]
    assert (objects["length"].item(), math.isnan(objects["width"].item())) == (12, True)
    assert objects["heading"].values.tolist() == [[0.5] * 4]


@pytest.mark.parametrize(
    "model_reference", ["", "lights/three.glb", "\n\x02\x08\x07"], ids=["none", "name", "bytes"]
)
def test_truths_with_traffic_lights_are_no_views(tmp_path, model_reference):
    # Field 7 is traffic_light in GroundTruth, and global_ground_truth in SensorView.
    messages = [make_view(0.1 * step, x_m=10 + step, vx=10, is_view=False) for step in range(3)]
    for message in messages:
        for number in (77, 78):
            light = message.traffic_light.add()
            light.id.value = number
            light.base.position.x, light.base.dimension.height = 30.0, 1.0
            light.classification.color = light.classification.COLOR_RED
            if model_reference:
                light.model_reference = model_reference

    traffic = dc.open_traffic(write_osi(tmp_path, messages, name="junction.osi"))

    assert (traffic.host, traffic.findings) == (3, ())
    assert traffic.objects["x"].values.tolist() == [[10, 11, 12]]


def test_views_whose_truth_has_no_time_and_host_have_their_own(tmp_path):
    messages = [make_view(0.1 * step, x_m=10 + step, vx=10) for step in range(3)]
    for message in messages:
        message.timestamp.CopyFrom(message.global_ground_truth.timestamp)
        message.host_vehicle_id.value = 3
        message.global_ground_truth.ClearField("timestamp")
        message.global_ground_truth.ClearField("host_vehicle_id")

    traffic = dc.open_traffic(write_osi(tmp_path, messages))

    assert traffic.host == 3
    assert np.allclose(traffic.objects["time"], [0, 0.1, 0.2], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value"), [("a_sd_1.osi", "an unknown format"), ("objects.osi", "no object")]
)
def test_object_lists_of_sensors_name_the_function_that_reads_them(tmp_path, name, value):
    lists = pytest.importorskip("osi3.osi_sensordata_pb2")
    message = lists.SensorData()
    message.timestamp.seconds = 1
    item = message.moving_object.add()
    item.header.tracking_id.value, item.base.position.x = 4, 5.0
    path = write_osi(tmp_path, [message], name=name)

    with pytest.raises(dc.RecordingError, match=f"{value}; .*read_objects"):
        dc.open_traffic(path)


@pytest.mark.parametrize("is_view", [True, False])
def test_osi_as_text_equals_osi_in_a_trace(tmp_path, is_view):
    messages = [make_view(0.1 * step, x_m=10 + step, vx=10, is_view=is_view) for step in range(4)]
    path = tmp_path / "trace.txth"
    path.write_text("".join(str(message) for message in messages), encoding="utf-8")

    traffic = dc.open_traffic(path)

    expected = dc.open_traffic(write_osi(tmp_path, messages))
    assert traffic.objects.identical(expected.objects)
    assert (traffic.format, traffic.host) == ("osi-trace", 3)


def test_osi_as_text_cut_short_is_read_up_to_the_cut(tmp_path):
    text = "".join(str(make_view(0.1 * step, x_m=10 + step, vx=10)) for step in range(4))
    path = tmp_path / "trace.txth"
    path.write_text(text[:-40], encoding="utf-8")

    traffic = dc.open_traffic(path)

    assert traffic.objects.sizes["time"] == 3
    assert "the file is cut short at message 3" in str(traffic.findings[0])
    path.write_text("version {\n  version_major: three\n}\n", encoding="utf-8")
    with pytest.raises(dc.RecordingError, match=r"message 0: ParseError.*\.txth"):
        dc.open_traffic(path)


COMMON_ROAD = """<?xml version="1.0"?>
<commonRoad commonRoadVersion="2020a" timeStepSize="0.5">
  <dynamicObstacle id="40"><type>bicycle</type>
    <shape><rectangle><length>1.8</length><width>0.6</width></rectangle></shape>
    <initialState><position><point><x>1</x><y>2</y></point></position>
      <orientation><exact>1.5</exact></orientation><time><exact>2</exact></time>
      <velocity><exact>4</exact></velocity></initialState>
    <trajectory><state><position><point><x>1.5</x><y>4</y></point></position>
      <orientation><intervalStart>1</intervalStart><intervalEnd>2</intervalEnd></orientation>
      <time><exact>3</exact></time><velocity><exact>4</exact></velocity></state></trajectory>
  </dynamicObstacle>
  <staticObstacle id="41"><type>parkedVehicle</type><shape><circle><radius>2</radius></circle>
    </shape><initialState><position><point><x>9</x><y>9</y></point></position>
    <time><exact>2</exact></time></initialState></staticObstacle>
</commonRoad>
"""


def test_common_road_states_have_steps_intervals_and_circles(tmp_path):
    path = tmp_path / "scenario.xml"
    path.write_text(COMMON_ROAD, encoding="utf-8")

    traffic = dc.open_traffic(path)

    assert traffic.format == "common-road"
    objects = traffic.objects
    assert objects["kind"].values.tolist() == ["bicyclist", "car"]
    assert objects["time"].values.tolist() == [1.0, 1.5]
    assert np.array_equal(objects["x"], [[1, 1.5], [9, 9]])  # it stays
    assert objects["heading"].values[0].tolist() == [1.5, 1.5]
    assert objects["vy"].values[0] == pytest.approx(4 * math.sin(1.5), rel=1e-15)
    assert objects["length"].values.tolist() == [1.8, 4.0]


def test_missing_velocities_come_from_positions(tmp_path):
    # A parabola: central differences are exact at inner times.
    rows = [car_row(t, 10 + 5 * t + t**2) for t in (0.0, 0.5, 1.0, 1.5)]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    assert traffic.format == "trajectory-csv"
    assert traffic.objects["vx"].values[0, 1:3] == pytest.approx([6, 7], rel=1e-12)
    (finding,) = traffic.findings
    assert "velocities of 1 object are missing" in str(finding) and ": 7" in str(finding)


def test_finding_on_missing_velocities_names_the_fastest_of_many_objects(tmp_path):
    # Object k moves at k m/s.
    rows = [
        f"{t / 10},{number},car,{number * t / 10:.6f},{4 * number},0,4.5,1.8,1.5"
        for t in range(3)
        for number in range(1, 8)
    ]

    (finding,) = dc.open_traffic(write_csv(tmp_path, *rows)).findings

    assert finding.value.startswith("velocities of 7 objects are missing")
    assert finding.value.endswith(
        ": 7 from 0 s (7 m/s), 6 from 0 s (6 m/s), 5 from 0 s (5 m/s), 4 from 0 s (4 m/s)"
        " and 3 more"
    )


def missing_velocity_note(traffic):
    (value,) = [item.value for item in traffic.findings if item.setting == "traffic.velocity"]
    return value.partition("move: ")[2]


@pytest.mark.parametrize("has_zeros", [False, True])
def test_speeds_of_missing_velocities_leave_out_jumps(tmp_path, has_zeros):
    # 11 m/s before and after a jump of 300 m at 0.3 s.
    more, header = (",0,0", f"{HEADER},vx,vy") if has_zeros else ("", HEADER)
    rows = [
        car_row(t / 10, round(1.1 * t + 300 * (t >= 3), 6), number, 8 * number, more)
        for t in range(8)
        for number in (1, 2)
        if number == 2 or t < 2
    ]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows, header=header))

    assert missing_velocity_note(traffic) == "1 from 0 s (11 m/s), 2 from 0 s (11 m/s)"
    assert traffic.objects["vx"].values[1] == pytest.approx(np.full(8, 11.0), rel=1e-9)
    assert any("object 2 at 0.3 s (3011 m/s)" in item.value for item in traffic.findings)


def test_position_between_two_jumps_has_no_velocity(tmp_path):
    rows = [car_row(t / 10, t + 300 * (t == 3)) for t in range(8)]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    expected = [10, 10, 10, np.nan, 10, 10, 10, 10]
    assert traffic.objects["vx"].values[0] == pytest.approx(expected, rel=1e-9, nan_ok=True)


def test_speed_of_missing_velocities_is_that_of_most_steps(tmp_path):
    # The row of 0.3 s has the time 0.75 s: sorted, the car goes back by 4.95 m and forth again.
    rows = [car_row(t / 10 if t != 3 else 0.75, round(1.1 * t, 6)) for t in range(12)]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    assert missing_velocity_note(traffic) == "7 from 0 s (11 m/s)"
    assert any("go back: object 7 at 0.4 s" in item.value for item in traffic.findings)


@pytest.mark.parametrize(("speed", "n_findings"), [(0.0, 1), (10.0, 0)])
def test_velocities_of_zero_of_a_moving_object_are_replaced(tmp_path, speed, n_findings):
    rows = [car_row(t, 10 * t, more=f",{speed},0") for t in range(3)]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows, header=f"{HEADER},vx,vy"))

    assert traffic.objects["vx"].values[0] == pytest.approx([10, 10, 10])
    assert len(traffic.findings) == n_findings


def test_velocities_in_kilometres_per_hour_are_found(tmp_path):
    rows = [car_row(t, 10 * t, more=",36,0") for t in range(5)]

    (finding,) = dc.open_traffic(write_csv(tmp_path, *rows, header=f"{HEADER},vx,vy")).findings

    assert finding.value == "velocities are 3.6 times the changes of positions"
    assert "km/h" in finding.fix


def test_object_at_rest_keeps_its_velocity_of_zero(tmp_path):
    rows = [car_row(t, 25, more=",0,0") for t in range(3)]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows, header=f"{HEADER},vx,vy"))

    assert traffic.findings == ()
    assert traffic.objects["vx"].values.tolist() == [[0, 0, 0]]


def write_diagonal_motion(folder, heading, speed, n_steps=5):
    """Write a car that moves at 30 degrees from the x axis."""
    rows = []
    for step in range(n_steps):
        way_m = 0.1 * step * speed
        x_m, y_m = way_m * math.cos(math.pi / 6), way_m * math.sin(math.pi / 6)
        rows.append(f"{step / 10},7,car,{x_m:.6f},{y_m:.6f},{heading},4.5,1.8,1.5")
    return write_csv(folder, *rows)


@pytest.mark.parametrize(
    ("heading", "angle_deg"),
    [
        ("30", 111),  # degrees: 30 rad are 279, 249 from the motion
        ("1.0", 27),  # within the limit
        ("-0.5236", 60),  # y to the right
        ("3.6652", 180),  # backwards at 15 m/s
    ],
)
def test_headings_that_contradict_the_motion_are_named(tmp_path, heading, angle_deg):
    traffic = dc.open_traffic(write_diagonal_motion(tmp_path, heading, 15.0))

    texts = [str(item) for item in traffic.findings if "of their motion" in str(item)]
    if angle_deg < 30:
        assert not texts
    else:
        assert "headings of 1 vehicle of 1 that move" in texts[0]
        assert f": 7 by {angle_deg} deg;" in texts[0]


def test_headings_that_begin_beyond_one_turn_are_named(tmp_path):
    # 45 rad are 58 degrees, and so near the motion at 30 degrees.
    traffic = dc.open_traffic(write_diagonal_motion(tmp_path, "45", 15.0))

    (finding,) = [item for item in traffic.findings if item.setting == "traffic.heading"]
    assert "headings of 1 object begin beyond one turn: 7 at 45;" in str(finding)


@pytest.mark.parametrize(
    ("heading", "speed"), [("0.5236", 15.0), ("3.6652", 3.0), ("-2", 1.0), ("", 15.0)]
)
def test_reversing_slow_and_unknown_headings_are_no_contradiction(tmp_path, heading, speed):
    traffic = dc.open_traffic(write_diagonal_motion(tmp_path, heading, speed))

    assert not [item for item in traffic.findings if item.setting == "traffic.heading"]


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (
            [*(car_row(t, t) for t in (0, 1, 2, 7)), car_row(4, 0, 8)],
            "gaps in the rows of 1 object: object 7 at 7 s",
        ),
        (  # no object has a row in the gap
            [car_row(t, t, number, 4 * number) for t in (0, 1, 2, 7) for number in (7, 8)],
            "gaps in the rows of 2 objects: object 7 at 7 s",
        ),
        ([car_row(0, 0), car_row(0.1, 50)], "object 7 at 0.1 s (500 m/s)"),
        ([car_row(0, 5), car_row(0, 5.01, 8)], "objects overlap: 7 and 8 at 0 s, by 1.8 m"),
        (  # the rear of car 8, which drives away, is 3.5 m into car 7 for one step
            [
                car_row(t, x_m, number)
                for t, x_m, number in ((0, 0, 7), (0, 1, 8), (1, 0, 7), (1, 9, 8))
            ],
            "objects overlap: 7 and 8 at 0 s, by 1.8 m",
        ),
    ],
)
def test_findings_name_objects_and_times(tmp_path, rows, expected):
    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    assert any(expected in str(finding) for finding in traffic.findings)


@pytest.mark.parametrize("n_missing", [1, 2, 3, 4])
def test_bridged_rows_are_counted(tmp_path, n_missing):
    # Object 1 lacks one row more. After four missing rows is a gap.
    rows = [
        car_row(t / 10, t, number, 4 * number)
        for t in range(30)
        for number in (1, 2)
        if not 10 <= t < 10 + n_missing * (number == 2) and (number, t) != (1, 20)
    ]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    (note,) = [item for item in traffic.findings if item.setting == "traffic.time"]
    assert note.level == "note"
    if n_missing < 4:
        assert note.value == (
            f"bridged {n_missing + 1} missing rows of 2 objects: object 1 after 1.9 s,"
            " object 2 after 0.9 s"
        )
    else:
        assert note.value == "bridged 1 missing row of 1 object: object 1 after 1.9 s"
    is_gap = any("gaps in the rows of 1 object: object 2" in i.value for i in traffic.findings)
    assert is_gap == (n_missing == 4)


def test_rows_of_several_rates_are_not_missing(tmp_path):
    rows = [car_row(t / 20, t / 2, 1) for t in range(40)]
    rows += [car_row(t / 10, t, 2, 4) for t in range(20)]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    assert "traffic.time" not in [item.setting for item in traffic.findings]


def test_overlap_is_that_of_rotated_outlines(tmp_path):
    # Two cars of 4.5 x 1.8 m side by side, 1.95 m apart; one turns by 90 degrees, and then reaches
    # from its centre by 2.25 m, and the other by 0.9 m: 1.2 m too far. Centres 2.9 m apart leave
    # 0.25 m, less than recorded positions and sizes are wrong by.
    def rows(number, y_m, heading_rad):
        return [f"{t},{number},car,0,{y_m},{heading_rad * t},4.5,1.8,1.5" for t in (0, 1)]

    def overlaps_at(y_m):
        path = write_csv(tmp_path, *rows(7, 0, 0), *rows(8, y_m, np.pi / 2))
        text = " ".join(map(str, dc.open_traffic(path).findings))
        return [part.partition(";")[0] for part in text.split("objects overlap: ")[1:]]

    assert overlaps_at(1.95) == ["7 and 8 at 1 s, by 1.2 m"]
    assert overlaps_at(2.9) == []


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([], "no object"),
        ([car_row(0, 0), car_row(0, 1)], "object 7 twice at 0 s"),
        ([car_row(0, "nan")], "object 7 at 0 s: x nan"),
        ([car_row("inf", 0)], "finite times"),
        (["0,7,car,0,0,0,-4.5,1.8,1.5"], "length -4.5 m"),
        (["0,7,tank,0,0,0,4.5,1.8,1.5"], "line 2 (id 7, time 0): class 'tank'"),
        (["0,7.5,car,0,0,0,4.5,1.8,1.5"], "line 2"),
        (["0,7,car,zero,0,0,4.5,1.8,1.5"], "line 2 (id 7, time 0): could not convert"),
        (["0,7,car"], "line 2"),
        ([car_row(0, 0, 2**63)], "ids below 2^63"),
    ],
)
def test_impossible_rows_are_named(tmp_path, rows, expected):
    with pytest.raises(dc.RecordingError) as error_info:
        dc.open_traffic(write_csv(tmp_path, *rows))
    assert expected in str(error_info.value)


def test_times_that_go_back_and_lost_positions_are_named(tmp_path):
    with pytest.raises(
        dc.RecordingError, match="message 1, with object 3, at 0 s after one at 1 s"
    ):
        dc.open_traffic(write_osi(tmp_path, [make_view(1.0), make_view(0.0)]))
    view = make_view(0.0)
    view.global_ground_truth.moving_object[0].base.ClearField("position")
    with pytest.raises(dc.RecordingError, match="object 3 at 0 s without a position"):
        dc.open_traffic(write_osi(tmp_path, [view]))


def test_files_of_other_formats_are_refused(tmp_path):
    other = tmp_path / "traffic.txt"
    other.write_text(HEADER, encoding="utf-8")
    for path, expected in ((other, "unknown format"), (tmp_path / "no.osi", "no such file")):
        with pytest.raises(dc.RecordingError, match=expected):
            dc.open_traffic(path)


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("empty.xml", "", "an empty file"),
        ("empty.csv", "", "an empty file"),
        ("map.xml", "<OpenDRIVE/>", "XML without the element commonRoad at its start"),
        ("few.csv", "time,id,x,y\n", "a CSV without the columns class, heading, length, width"),
        ("no-size.csv", "time,id,class,x,y,heading\n", "no column length, width, height"),
    ],
)
def test_files_without_a_format_name_what_is_missing(tmp_path, name, text, expected):
    (tmp_path / name).write_text(text, encoding="utf-8")

    with pytest.raises(dc.RecordingError, match=expected):
        dc.open_traffic(tmp_path / name)


def write_mcap(folder, messages, schema="osi3.SensorView", compression=None):
    writers = pytest.importorskip("mcap.writer")
    path = folder / "trace.mcap"
    with path.open("wb") as file:
        writer = writers.Writer(
            file, compression=compression or writers.CompressionType.NONE, chunk_size=4096
        )
        writer.start()
        other = writer.register_channel("/rosout", "json", 0)
        writer.add_message(other, 0, b"{}", 0)
        # The descriptor of the schema is not needed: the messages are known.
        schema_id = writer.register_schema(schema, "protobuf", b"")
        channel = writer.register_channel("ground_truth", "protobuf", schema_id)
        for index, message in enumerate(messages):
            writer.add_message(channel, index, message.SerializeToString(), index)
        writer.finish()
    return path


@pytest.mark.parametrize("is_view", [True, False])
@pytest.mark.parametrize("compression", ["NONE", "ZSTD", "LZ4"])
def test_osi_in_mcap_equals_osi_in_a_trace(tmp_path, is_view, compression):
    writers = pytest.importorskip("mcap.writer")
    messages = [make_view(0.1 * step, x_m=10 + step, vx=10, is_view=is_view) for step in range(4)]
    schema = "osi3.SensorView" if is_view else "osi3.GroundTruth"

    packed = dc.open_traffic(
        write_mcap(tmp_path, messages, schema, writers.CompressionType[compression])
    )

    assert (packed.format, packed.host) == ("osi-trace", 3)
    assert packed.objects.identical(dc.open_traffic(write_osi(tmp_path, messages)).objects)


def test_mcap_with_views_of_two_sensors_is_read_once(tmp_path):
    writers = pytest.importorskip("mcap.writer")
    path = tmp_path / "trace.mcap"
    with path.open("wb") as file:
        writer = writers.Writer(file)
        writer.start()
        schema = writer.register_schema("osi3.SensorView", "protobuf", b"")
        channels = [writer.register_channel(name, "protobuf", schema) for name in ("front", "rear")]
        for step in range(3):
            content = make_view(0.1 * step, x_m=10 + step, vx=10).SerializeToString()
            for channel in channels:
                writer.add_message(channel, step, content, step)
        writer.finish()

    traffic = dc.open_traffic(path)

    assert traffic.objects["x"].values.tolist() == [[10, 11, 12]]
    (finding,) = traffic.findings
    assert "2 channels of OSI, of which front is read: front, rear" in str(finding)


def test_mcap_cut_short_is_read_up_to_the_cut(tmp_path):
    messages = [make_view(0.1 * step, x_m=step) for step in range(100)]
    whole = dc.open_traffic(write_mcap(tmp_path, messages)).objects
    path = tmp_path / "trace.mcap"
    content = path.read_bytes()
    path.write_bytes(content[: 2 * len(content) // 3])

    traffic = dc.open_traffic(path)

    n_read = traffic.objects.sizes["time"]
    assert 20 < n_read < 100
    np.testing.assert_array_equal(traffic.objects.x, whole.x.isel(time=slice(n_read)))
    assert traffic.findings[0].setting == "traffic.path"
    assert f"message {n_read}: " in traffic.findings[0].value


@pytest.mark.parametrize("n_lost", [1, 30])
def test_trace_cut_short_is_read_up_to_the_cut(tmp_path, n_lost):
    messages = [make_view(0.1 * step, x_m=10 + step, vx=10) for step in range(4)]
    whole = dc.open_traffic(write_osi(tmp_path, messages)).objects
    path = write_osi(tmp_path, messages)
    path.write_bytes(path.read_bytes()[:-n_lost])

    traffic = dc.open_traffic(path)

    assert traffic.objects.identical(whole.isel(time=slice(3)))
    (finding,) = traffic.findings
    assert finding.level == "warning" and "cut short at message 3: " in finding.value
    assert "up to 0.2 s, the last of object 3" in finding.value


def test_trace_cut_in_its_first_message_is_refused(tmp_path):
    path = write_osi(tmp_path, [make_view(0.0)])
    path.write_bytes(path.read_bytes()[:-1])

    with pytest.raises(dc.RecordingError, match="message 0: .*cut the file"):
        dc.open_traffic(path)


def test_csv_cut_within_a_line_is_read_up_to_it(tmp_path):
    path = write_csv(tmp_path, *(car_row(time, 10 * time, 4) for time in range(3)))
    whole = dc.open_traffic(path).objects
    lines = path.read_text("utf-8").splitlines(keepends=True)
    path.write_text("".join(lines) + lines[-1][:3], encoding="utf-8")

    traffic = dc.open_traffic(path)

    assert traffic.objects.identical(whole)
    assert re.search(r"at line 5 .*, which has no line end: ", traffic.findings[0].value)
    for cut in (lines[-1].rpartition(",")[0], lines[-1].replace("car", "ca")[:-1], "3,1,car,1e"):
        path.write_text("".join(lines[:3]) + cut, encoding="utf-8")
        traffic = dc.open_traffic(path)
        assert traffic.objects.identical(whole.isel(time=slice(2)))
        assert re.search(r"line 4.*, which has no line end: ", traffic.findings[0].value)
        assert "; 2 states up to 1 s" in traffic.findings[0].value
    path.write_text("".join(lines[:3]) + lines[3].replace("car", "lorry"), encoding="utf-8")
    with pytest.raises(dc.RecordingError, match=r"line 4 \(id 4, time 2\): class 'lorry'"):
        dc.open_traffic(path)
    path.write_text("".join(lines[:2]) + lines[2][:3] + "\n" + lines[3], encoding="utf-8")
    with pytest.raises(dc.RecordingError, match=r"line 3 \(id 4, time 1\): "):
        dc.open_traffic(path)


def test_csv_without_a_final_line_end_keeps_its_last_row(tmp_path):
    path = write_csv(tmp_path, *(car_row(time, 10 * time, 4) for time in range(3)))
    whole = dc.open_traffic(path)
    path.write_text(path.read_text("utf-8").removesuffix("\n"), encoding="utf-8")

    traffic = dc.open_traffic(path)

    assert traffic.objects.identical(whole.objects)
    # The last cell may be cut: "1.5" of "1.53".
    (added,) = {finding.value for finding in traffic.findings} - {
        finding.value for finding in whole.findings
    }
    assert added.startswith("the last row has no line end: 2,4,car,20,")


def test_changing_classes_and_sizes_are_reported_and_the_first_counts(tmp_path):
    rows = [car_row(time, 10 * time) for time in range(3)]
    expected = dc.open_traffic(write_csv(tmp_path, *rows)).objects
    rows[1:] = [row.replace("car", "truck") for row in rows[1:]]
    rows[2] = rows[2].removesuffix("1.5") + "1"

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    assert traffic.objects.identical(expected)
    (finding,) = (item for item in traffic.findings if item.setting == "traffic.size")
    assert finding.level == "warning"
    # The first of its changes.
    assert "1 object changes: object 7 at 1 s (class car, then truck)" in finding.value
    sizes_alone = [row.replace("truck", "car") for row in rows]
    (finding,) = (
        item
        for item in dc.open_traffic(write_csv(tmp_path, *sizes_alone)).findings
        if item.setting == "traffic.size"
    )
    assert "object 7 at 2 s (height 1.5 m, then 1.0 m)" in finding.value


@pytest.mark.parametrize("prefix", ["", "\ufeff"])
@pytest.mark.parametrize("separator", [",", " ,", ", ", " , "])
def test_csv_headers_have_blanks_and_byte_order_marks(tmp_path, prefix, separator):
    rows = [car_row(time, 10 * time) for time in range(3)]
    expected = dc.open_traffic(write_csv(tmp_path, *rows)).objects

    header = prefix + HEADER.replace(",", separator)
    objects = dc.open_traffic(write_csv(tmp_path, *rows, header=header)).objects

    assert objects.identical(expected)


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (
            "frame,id,x,y,width,height,xVelocity,yVelocity,laneId",
            r"trajectories of highD; .*time = frame / 25; length = width",
        ),
        ("recordingId,trackId,frame,xCenter,yCenter,heading,width,length", "inD, rounD"),
        ("Vehicle_ID,Frame_ID,Global_Time,Local_X,Local_Y,v_length,v_Width", "NGSIM.*0.3048"),
        ("timestep_time;vehicle_angle;vehicle_id;vehicle_x;vehicle_y", r"SUMO.*radians\(90 -"),
        ("track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad", "INTERACTION.*psi_rad"),
        (HEADER.replace(",height", ""), "no column height; .*may be empty"),
        (HEADER.replace(",", ";"), "separated by semicolons; .*write it with commas"),
    ],
)
def test_other_trajectory_files_are_refused_with_their_conversion(tmp_path, header, expected):
    path = write_csv(tmp_path, "0,1,2", header=header)

    with pytest.raises(dc.RecordingError, match=expected):
        dc.open_traffic(path)


def test_csv_of_data_frames_has_capitals_and_ids_with_a_point(tmp_path):
    path = write_csv(tmp_path, "0,7.0,Car,1,2,0,4,2,", header=HEADER.title())

    objects = dc.open_traffic(path).objects

    assert (objects["id"].item(), objects["kind"].item(), objects["x"].item()) == (7, "car", 1)


@pytest.mark.parametrize("number", ["veh0", "7.5", ""])
def test_csv_ids_that_are_no_numbers_are_named(tmp_path, number):
    path = write_csv(tmp_path, car_row(0, 1, number=number))

    with pytest.raises(dc.RecordingError, match=f"line 2.*id '{number}', which is not a whole"):
        dc.open_traffic(path)


def test_csv_field_beyond_the_limit_of_the_library_is_named(tmp_path):
    path = write_csv(tmp_path, car_row(0, 0), car_row(1, "1" * 200_000))

    with pytest.raises(dc.RecordingError, match="line 3: field larger"):
        dc.open_traffic(path)


def test_csv_with_times_that_go_back_is_sorted_with_a_note(tmp_path):
    rows = [car_row(time, 10 * time, number) for number in (4, 5) for time in (0, 1, 2)]
    assert dc.open_traffic(write_csv(tmp_path, *rows)).findings[0].setting != "traffic.time"
    sorted_objects = dc.open_traffic(write_csv(tmp_path, *rows)).objects
    rows[4], rows[5] = rows[5], rows[4]

    traffic = dc.open_traffic(write_csv(tmp_path, *rows))

    assert traffic.objects.identical(sorted_objects)
    assert traffic.findings[0].value == "times of 1 object go back: object 5 at 1 s"


def test_mcap_without_traffic_is_refused(tmp_path):
    path = write_mcap(tmp_path, [make_view(0.0)], "osi3.SensorData")

    with pytest.raises(dc.RecordingError, match="an unknown format"):
        dc.open_traffic(path)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("<x>1.5</x>", "<x>east</x>", "object 40 after 1 s: .*'east'"),
        ("<position><point><x>1.5</x><y>4</y></point></position>", "", "object 40 after 1 s: .*/x"),
        ("<length>1.8", "<length>long", "object 40: .*'long'"),
        ('timeStepSize="0.5"', 'timeStepSize="-0.5"', "timeStepSize -0.5, not above 0"),
        ('timeStepSize="0.5"', 'timeStepSize="0"', "timeStepSize 0, not above 0"),
    ],
)
def test_faults_of_common_road_name_object_and_time(tmp_path, old, new, expected):
    path = tmp_path / "scenario.xml"
    assert old in COMMON_ROAD
    path.write_text(COMMON_ROAD.replace(old, new), encoding="utf-8")

    with pytest.raises(dc.RecordingError, match=expected):
        dc.open_traffic(path)


def test_common_road_of_another_version_is_refused(tmp_path):
    path = tmp_path / "scenario.xml"
    path.write_text(COMMON_ROAD.replace("2020a", "2017a"), encoding="utf-8")

    with pytest.raises(dc.RecordingError, match="version '2017a'.*2018b or 2020a"):
        dc.open_traffic(path)


@pytest.mark.parametrize("mark", ["<position>", "</trajectory>", "</dynamicObstacle>", "<x>9"])
def test_common_road_cut_short_is_read_up_to_the_cut(tmp_path, mark):
    path = tmp_path / "cut.xml"
    # Two copies of the first obstacle; the cut is in the second one, or in the obstacle after it.
    first, end = COMMON_ROAD.split("  <staticObstacle")
    obstacle = first[first.index("  <dynamicObstacle") :].replace('"40"', '"39"')
    start = first.replace("  <dynamicObstacle", f"{obstacle}  <dynamicObstacle", 1)
    text = f"{start}  <staticObstacle{end}"
    path.write_text(text[: text.rindex(mark) + len(mark) - 1], encoding="utf-8")

    traffic = dc.open_traffic(path)

    n_complete = 2 if mark in ("<x>9", "<position>") else 1
    assert traffic.objects["id"].values.tolist() == [39, 40][:n_complete]
    finding = traffic.findings[0]
    assert (finding.level, finding.setting) == ("warning", "traffic.path")
    assert "cut short at ParseError: " in finding.value
    assert f"up to 1.5 s, the last of object {38 + n_complete}, are read" in finding.value
    path.write_text(COMMON_ROAD[:300], encoding="utf-8")
    with pytest.raises(dc.RecordingError, match="ParseError.*a complete CommonRoad"):
        dc.open_traffic(path)


@given(data=st.data(), kind=st.sampled_from(["osi", "mcap", "xml", "csv"]))
def test_damaged_files_end_in_one_error_or_are_read(data, kind, tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    if kind == "osi":
        path = write_osi(folder, [make_view(0.1 * step) for step in range(3)])
    elif kind == "mcap":
        path = write_mcap(folder, [make_view(0.1 * step) for step in range(3)])
    elif kind == "xml":
        path = folder / "scenario.xml"
        path.write_text(COMMON_ROAD, encoding="utf-8")
    else:
        path = write_csv(folder, *(car_row(t, 10 * t) for t in range(5)))
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])

    try:
        traffic = dc.open_traffic(path)
    except dc.RecordingError as error:
        assert len(str(error)) < 1000
    else:
        assert np.isfinite(traffic.objects["x"].values).any()
        build_some_scenes(traffic)


RADAR = dc.reference().radar


def build_some_scenes(traffic):
    """Build scenes from what was read: they, too, end in one error."""
    try:
        scenes = FrameScenes(traffic, RADAR, ego=int(traffic.objects["id"].values[0]))
        for number in (0, scenes.n_frames - 1):
            scenes.scene(number)
    except dc.DechirpError as error:
        assert len(str(error)) < 1000


def test_floating_car_data_of_sumo_as_xml_states_the_conversion(tmp_path):
    path = tmp_path / "fcd.xml"
    vehicle = '<vehicle id="v0" x="1" y="2" angle="90" type="car" speed="5" pos="5" lane="a_0"/>'
    path.write_text(
        f'<?xml version="1.0"?>\n<fcd-export><timestep time="0">{vehicle}</timestep></fcd-export>',
        encoding="utf-8",
    )

    with pytest.raises(dc.RecordingError, match=r"SUMO floating car data as XML.*xml2csv.*90 -"):
        dc.open_traffic(path)
