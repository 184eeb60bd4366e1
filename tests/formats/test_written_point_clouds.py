"""Detections written as clouds of points come back equal, and others read the same places."""

import gc
import json
import resource
import sqlite3
import struct
import sys
import tracemalloc
import warnings
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.cube import label_cube
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.recordings.in_memory import recording_from_cube
from dechirp.recordings.messages import ros
from dechirp.recordings.writers.point_clouds import iter_messages
from dechirp.recordings.writers.ros_messages import cloud_message, text_message
from formats.any_bytes import damaged, gives_a_cube_or_says_why

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

CHIRP = Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    ramp_duration_s=30e-6,
    sample_rate_hz=10e6,
    n_samples=8,
    sampling="complex",
)
RADAR = Radar(
    frame=Frame(chirp=CHIRP, n_chirps=4, interval_s=40e-6, period_s=0.05),
    array=Array(rx_m=((0.0, 0.0, 0.0), (0.0, 0.002, 0.0))),
)
N_FRAMES = 5
NAMES = ("drive.mcap", "drive.ros2")

UNKNOWN = np.nan
DETECTIONS = xr.Dataset(
    {
        # Nothing was detected in frames 0, 2 and 4.
        "frame": ("detection", np.array([1, 1, 1, 3]), {"units": "1"}),
        "time": ("detection", [0.05, 0.05, 0.05, 0.15], {"units": "s"}),
        "range": ("detection", [10.0, 1 / 3, 50.0, 20.0], {"units": "m"}),
        "velocity": ("detection", [-3.0, 0.1, UNKNOWN, 7.0], {"units": "m/s"}),
        "azimuth": ("detection", [np.pi / 2, 0.1, UNKNOWN, -0.5], {"units": "rad"}),
        "elevation": ("detection", [0.0, UNKNOWN, UNKNOWN, 0.5], {"units": "rad"}),
        "snr": ("detection", [100.0, 10.0, 0.0, 1e4], {"units": "1"}),
        "cluster": ("detection", np.array([2**40, -1, 0, 1]), {"units": "1"}),
        "sure": ("detection", [True, False, True, True]),
        "seen": ("detection", np.float32([0.1, 0.2, 0.3, 0.4])),
        "motion": ("detection", ["moving", "", "überholt", "static"]),
    },
    attrs={"chain": "a test"},
)
TRUTH = xr.Dataset(
    {
        "range": (("target", "frame"), np.arange(10.0).reshape(2, 5) + 1, {"units": "m"}),
        "azimuth": (("target", "frame"), np.full((2, 5), 0.1), {"units": "rad"}),
        "elevation": (("target", "frame"), np.zeros((2, 5)), {"units": "rad"}),
    },
    coords={
        "target": ["Fußgänger", "car"],
        "frame": np.arange(5),
        "time": ("frame", np.arange(5) / 20, {"units": "s"}),
    },
)
EGO = xr.Dataset(
    {
        "vx": ("frame", np.arange(5.0), {"units": "m/s"}),
        "covariance": (("frame", "a", "b"), np.arange(20.0).reshape(5, 2, 2)),
        "gain": ("rx", np.array([1 + 2j, complex(np.inf, UNKNOWN)], np.complex64)),
        "huge": ("rx", np.array([2**62 + 1, -1])),
    }
)


def recording(**tables):
    shape = (N_FRAMES, 4, 2, 8)
    cube = label_cube(np.zeros(shape, np.complex64), RADAR, units="full scale")
    return recording_from_cube(cube, RADAR, tables=tables)


WHOLE = recording(detections=DETECTIONS, truth=TRUTH, ego=EGO)


def same(read, written):
    xr.testing.assert_identical(read, written)
    for name, variable in written.variables.items():
        kinds = (read[name].dtype, variable.dtype)
        assert kinds[0] == kinds[1] or kinds[0].kind == kinds[1].kind == "U", name


def clouds_seen_by_rosbags(path, topic):
    """Decoded clouds of a topic: (time, message)."""
    from rosbags.rosbag2 import Reader

    with Reader(path) as bag:
        wanted = [one for one in bag.connections if one.topic == topic]
        for connection, time_ns, data in bag.messages(connections=wanted):
            yield time_ns, ros.message_types().deserialize_cdr(data, connection.msgtype)


def places_of(cloud):
    """x, y, z of each point, by the offsets that its fields name."""
    at = {field.name: field.offset for field in cloud.fields}
    content = bytes(cloud.data)
    return [
        [struct.unpack_from("<f", content, n * cloud.point_step + at[axis])[0] for axis in "xyz"]
        for n in range(cloud.width)
    ]


PLACES = {
    0: [],
    1: [
        [0.0, 10.0, 0.0],  # to the left
        [np.cos(0.1) / 3, np.sin(0.1) / 3, 0.0],  # no elevation: on the level of the radar
        [UNKNOWN, UNKNOWN, UNKNOWN],  # no direction, no place
    ],
    2: [],
    3: [[20 * np.cos(0.5) ** 2, -20 * np.cos(0.5) * np.sin(0.5), 20 * np.sin(0.5)]],
    4: [],
}


def must_be_in_place(clouds):
    assert len(clouds) == N_FRAMES
    for frame, cloud in enumerate(clouds):
        assert cloud.header.frame_id == "radar"
        assert cloud.is_dense == (frame != 1)
        expected = np.array(PLACES[frame]).reshape(-1, 3)
        found = np.array(places_of(cloud)).reshape(-1, 3)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_detections_truth_and_radar_read_back_equal(tmp_path, name):
    done = []
    written = dc.write(WHOLE, tmp_path / name, progress=lambda *counts: done.append(counts))
    assert written == (tmp_path / name,)
    assert done == [(frame + 1, N_FRAMES) for frame in range(N_FRAMES)]

    read = dc.open(tmp_path / name)

    assert read.n_frames == N_FRAMES
    assert read.radar == RADAR
    assert read.contents.units == "full scale"
    same(read.points, DETECTIONS)
    assert list(read.tables) == ["detections", "truth", "ego"]
    for table, written in (("detections", DETECTIONS), ("truth", TRUTH), ("ego", EGO)):
        same(read.tables[table], written)
    assert not read.sizes
    assert not read.findings


@pytest.mark.parametrize("name", NAMES)
def test_what_was_read_is_written_again_and_a_part_begins_at_0(tmp_path, name):
    dc.write(WHOLE, tmp_path / name)
    other = tmp_path / NAMES[1 - NAMES.index(name)]
    dc.write(dc.open(tmp_path / name), other)
    dc.write(dc.open(other, frames=(3, 5)), tmp_path / f"part.{name}")

    same(dc.open(other).tables["truth"], TRUTH)
    part = dc.open(tmp_path / f"part.{name}")
    assert part.n_frames == 2
    np.testing.assert_array_equal(part.points.range, [20.0])
    np.testing.assert_array_equal(part.points.frame, [0])
    np.testing.assert_allclose(part.points.time, [0.0], atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_a_recording_in_which_nothing_was_detected_keeps_its_frames(tmp_path, name):
    nothing = DETECTIONS.isel(detection=slice(0))
    dc.write(recording(detections=nothing), tmp_path / name)

    read = dc.open(tmp_path / name)

    assert read.n_frames == N_FRAMES
    same(read.points, nothing)


@pytest.mark.parametrize("name", NAMES)
def test_a_radar_that_is_given_wins(tmp_path, name):
    dc.write(WHOLE, tmp_path / name)
    other = replace(RADAR, frame=replace(RADAR.frame, period_s=0.1))

    assert dc.open(tmp_path / name, radar=other).radar == other


@pytest.mark.parametrize("name", NAMES)
def test_rosbags_reads_the_same_places_at_the_times_of_the_frames(tmp_path, name):
    dc.write(WHOLE, tmp_path / name)

    seen = list(clouds_seen_by_rosbags(tmp_path / name, "/radar/detections"))

    must_be_in_place([cloud for _, cloud in seen])
    middle_ns = round(RADAR.frame.mid_frame_s * 1e9)
    # Of its detections where there are any, else the middle of the frame.
    frames_ns = [middle_ns, 50_000_000, 100_000_000 + middle_ns, 150_000_000]
    assert [time_ns for time_ns, _ in seen] == [*frames_ns, 200_000_000 + middle_ns]
    stamps = [cloud.header.stamp for _, cloud in seen]
    assert [one.sec * 10**9 + one.nanosec for one in stamps] == [time_ns for time_ns, _ in seen]


def test_foxglove_decodes_the_same_places_with_the_definitions_in_the_file(tmp_path):
    ros2 = pytest.importorskip("mcap_ros2.reader")
    dc.write(WHOLE, tmp_path / "drive.mcap")

    with (tmp_path / "drive.mcap").open("rb") as file:
        seen = list(ros2.read_ros2_messages(file, topics=["/radar/detections"]))

    must_be_in_place([one.ros_msg for one in seen])
    first = seen[1].ros_msg
    columns = {field.name for field in first.fields}
    # A number that no field holds, and texts of no length, travel as arrays of their own.
    assert columns == {*DETECTIONS.variables, "x", "y", "z", "intensity"}
    at = next(field for field in first.fields if field.name == "intensity").offset
    levels = [
        struct.unpack_from("<f", bytes(first.data), n * first.point_step + at)[0] for n in range(3)
    ]
    assert levels == pytest.approx([20.0, 10.0, -np.inf])


def test_truth_is_a_cloud_of_all_targets_in_each_frame(tmp_path):
    dc.write(WHOLE, tmp_path / "drive.ros2")

    seen = [cloud for _, cloud in clouds_seen_by_rosbags(tmp_path / "drive.ros2", "/radar/truth")]

    found = np.array([places_of(cloud) for cloud in seen])
    assert found.shape == (N_FRAMES, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1).T, TRUTH.range, rtol=1e-6)


# ---- other radars' files


def foreign_cloud(rows, *, fields, topic="/front/points", time_ns=10**18):
    points = np.array(rows, dtype=[(name, "<f4") for name in fields])
    return cloud_message(topic, time_ns, points)


def write_mcap(path, sent):
    from mcap.writer import Writer

    with path.open("wb") as file:
        bag = Writer(file)
        bag.start(profile="ros2")
        for message in sent:
            schema = bag.register_schema(message.type, "ros2msg", b"unread")
            channel = bag.register_channel(message.topic, "cdr", schema)
            bag.add_message(channel, message.time_ns, message.data, message.time_ns)
        bag.finish()


def write_bag(path, sent):
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {}
        for message in sent:
            if message.topic not in topics:
                topics[message.topic] = bag.add_connection(
                    message.topic, message.type, typestore=ros.message_types()
                )
            bag.write(topics[message.topic], message.time_ns, message.data)


@pytest.mark.parametrize("write", [write_mcap, write_bag])
def test_points_of_another_radar_become_detections_and_say_what_was_taken(tmp_path, write):
    fields = ("x", "y", "z", "Doppler", "snr", "rcs", "gain")
    rows = [(3.0, 4.0, 0.0, -2.0, 20.0, 1.5, 0.0), (UNKNOWN,) * 7]
    lidar = foreign_cloud([(1.0, 1.0, 1.0)], fields=("x", "y", "z"), topic="/lidar")
    sent = [
        text_message("/notes", "rain"),
        lidar,
        foreign_cloud(rows, fields=fields),
        foreign_cloud(rows[:1], fields=fields, time_ns=10**18 + 5 * 10**7),
    ]
    write(tmp_path / "drive", sent)

    read = dc.open(tmp_path / "drive")

    assert read.n_frames == 2
    assert read.contents.radar is None
    points = read.points
    assert [*points][-2:] == ["rcs", "gain"]
    np.testing.assert_allclose(points.range, [5.0, 5.0])
    np.testing.assert_allclose(points.azimuth, [np.arctan2(4, 3)] * 2)
    np.testing.assert_allclose(points.velocity, [-2.0, -2.0])
    np.testing.assert_allclose(points.snr, [100.0, 100.0])
    np.testing.assert_allclose(points.rcs, [1.5, 1.5])
    np.testing.assert_allclose(points.time, [0.0, 0.05])
    said = " ".join(finding.value for finding in read.findings)
    assert "velocity from Doppler" in said
    assert "/lidar (sensor_msgs/msg/PointCloud2), /notes (std_msgs/msg/String)" in said
    named = dc.open(tmp_path / "drive" / "lidar")
    assert named.n_frames == 1
    assert "velocity from nothing" in named.findings[0].value
    assert named.findings[0].level == "warning"


def test_points_of_big_endian_rows_with_padding_are_read(tmp_path):
    message = foreign_cloud([(0.0, 0.0, 0.0, 0.0)], fields=("x", "y", "z", "v"))
    cloud = ros.decode_message(message)
    rows = np.zeros((2, 3, 4), ">f4")  # the third of each row is padding
    rows[..., 0] = [[1, 2, 99], [3, 4, 99]]
    other = ros.create_message(
        ros.CLOUD,
        header=cloud.header,
        height=2,
        width=2,
        fields=cloud.fields,
        is_bigendian=True,
        point_step=16,
        row_step=48,
        data=np.frombuffer(rows.tobytes(), np.uint8),
        is_dense=True,
    )
    write_mcap(tmp_path / "a.mcap", [message._replace(data=ros.encode_message(other))])

    np.testing.assert_allclose(dc.open(tmp_path / "a.mcap").points.range, [1, 2, 3, 4])


@pytest.mark.parametrize(
    ("sent", "value"),
    [
        ([text_message("/notes", "rain")], r"no points|/notes \(std_msgs/msg/String\)"),
        (
            [foreign_cloud([(1.0, 2.0)], fields=("x", "v"))],
            "points with fields x, v on /front/points",
        ),
        ([], "no topics"),
        ([text_message("/radar/description", '{"dechirp_exchange": 9}')], "version 9"),
    ],
)
def test_a_file_without_points_of_a_radar_says_what_it_has(tmp_path, sent, value):
    write_mcap(tmp_path / "a.mcap", sent)

    with pytest.raises(RecordingError, match=value):
        dc.open(tmp_path / "a.mcap")


def test_a_cloud_that_says_it_is_larger_than_it_is_is_refused(tmp_path):
    message = foreign_cloud([(1.0, 2.0, 3.0, 4.0)], fields=("x", "y", "z", "v"))
    cloud = ros.decode_message(message)
    for wrong in ({"width": 2**31}, {"height": 2**31, "row_step": 0}, {"point_step": 2**20}):
        parts = {name: getattr(cloud, name) for name in cloud.__dataclass_fields__}
        data = ros.encode_message(ros.create_message(ros.CLOUD, **{**parts, **wrong}))
        write_mcap(tmp_path / "a.mcap", [message._replace(data=data)])

        with pytest.raises(RecordingError, match="not readable"):
            dc.open(tmp_path / "a.mcap")


# ---- what cannot be written


def test_samples_alone_are_refused_with_the_way_to_detections(tmp_path):
    with pytest.raises(DechirpError, match=r"dechirp run IN --out FOLDER"):
        dc.write(recording(truth=TRUTH), tmp_path / "drive.mcap")

    assert not list(tmp_path.iterdir())


def test_a_table_of_one_number_a_frame_comes_back_as_it_was(tmp_path):
    ego = xr.Dataset({"range": ("frame", np.arange(5.0)), "frame": ("frame", np.arange(5))})
    for name in NAMES:
        dc.write(recording(detections=DETECTIONS, ego=ego), tmp_path / name)

        xr.testing.assert_identical(dc.open(tmp_path / name).tables["ego"], ego)


def test_detections_that_are_no_rows_of_one_axis_are_refused(tmp_path):
    wrong = xr.Dataset({"range": (("frame", "place"), np.ones((5, 2))), "frame": np.arange(5)})
    for one in (wrong, wrong.isel(place=0), DETECTIONS.rename(detection="row")):
        with pytest.raises(DechirpError, match="not rows of one axis"):
            dc.write(recording(detections=one), tmp_path / "drive.mcap")


def test_detections_out_of_the_order_of_frames_are_refused(tmp_path):
    for wrong in (DETECTIONS.isel(detection=[3, 0]), DETECTIONS.assign(frame=DETECTIONS.frame + 2)):
        with pytest.raises(DechirpError, match="not in order of frames"):
            dc.write(recording(detections=wrong), tmp_path / "drive.mcap")


@pytest.mark.parametrize("name", NAMES)
def test_our_own_are_named_without_a_topic(tmp_path, name):
    dc.write(WHOLE, tmp_path / name)

    with pytest.raises(RecordingError, match=f"open {name}"):
        dc.open(tmp_path / name / "radar" / "truth")


@pytest.mark.parametrize("name", NAMES)
def test_inspect_shows_detections_and_run_says_that_there_are_no_samples(tmp_path, name, capsys):
    dc.write(WHOLE, tmp_path / name)
    out = tmp_path / "looked"

    with pytest.raises(SystemExit) as ended:
        main(["inspect", str(tmp_path / name), "--out", str(out), "--json"])

    assert not ended.value.code
    document = json.loads(capsys.readouterr().out)
    assert document["dims"] == {"frame": N_FRAMES, "detection": 4}
    assert (out / "map.png").stat().st_size > 0
    with pytest.raises(SystemExit) as ended:
        main(["run", str(tmp_path / name), "--out", str(tmp_path / "ran")])
    assert ended.value.code == 2
    assert "contains detections without samples" in capsys.readouterr().err


def test_a_missing_library_is_named(tmp_path, monkeypatch):
    dc.write(WHOLE, tmp_path / "drive.mcap")
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    ros.message_types.cache_clear()

    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
        dc.open(tmp_path / "drive.mcap")
    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
        dc.write(WHOLE, tmp_path / "other.ros2")


@contextmanager
def files_of_at_most(n_bytes):
    """A disk with so little room that every larger file fails, in this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_leaves_what_was_there(tmp_path, name):
    dc.write(recording(detections=DETECTIONS), tmp_path / name)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # rosbags leaves its database open
        with files_of_at_most(2000), pytest.raises(DechirpError, match="not writable"):
            dc.write(WHOLE, tmp_path / name)
        gc.collect()

    assert [file.name for file in tmp_path.iterdir()] == [name]
    same(dc.open(tmp_path / name).points, DETECTIONS)
    assert list(dc.open(tmp_path / name).tables) == ["detections"]


def test_a_bag_takes_the_place_of_its_own_earlier_one_alone(tmp_path):
    dc.write(recording(detections=DETECTIONS), tmp_path / "drive.ros2")
    dc.write(WHOLE, tmp_path / "drive.ros2")
    assert "truth" in dc.open(tmp_path / "drive.ros2").tables

    (tmp_path / "drive.ros2" / "notes.txt").write_text("mine")
    with pytest.raises(DechirpError, match=r"a folder with notes\.txt"):
        dc.write(WHOLE, tmp_path / "drive.ros2")


# ---- what is damaged


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bag")
    dc.write(WHOLE, folder / "drive.ros2")
    return folder / "drive.ros2"


@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_any_damage_to_a_bag_gives_detections_or_says_why(bag, data):
    file = data.draw(st.sampled_from(sorted(bag.iterdir())))
    whole = file.read_bytes()
    try:
        file.write_bytes(data.draw(damaged(whole)))
        gives_a_cube_or_says_why(bag)
    finally:
        file.write_bytes(whole)


MESSAGES = tuple(iter_messages(WHOLE))


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_any_damage_to_a_message_gives_detections_or_says_why(tmp_path_factory, data):
    """Behind the sums of an MCAP file, which hide damage from what reads the messages."""
    sent = list(MESSAGES)
    place = data.draw(st.integers(0, len(sent) - 1))
    sent[place] = sent[place]._replace(data=data.draw(damaged(bytes(sent[place].data))))
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    write_mcap(path, sent)

    gives_a_cube_or_says_why(path)


def test_an_mcap_that_was_cut_off_anywhere_is_refused(tmp_path):
    dc.write(WHOLE, tmp_path / "drive.mcap")
    whole = (tmp_path / "drive.mcap").read_bytes()
    for end in range(8, len(whole), 97):
        (tmp_path / "cut.mcap").write_bytes(whole[:end])
        with pytest.raises(RecordingError):
            dc.open(tmp_path / "cut.mcap")


def test_a_chunk_that_unpacks_to_more_than_it_says_is_not_unpacked(tmp_path):
    import zstandard

    dc.write(WHOLE, tmp_path / "drive.mcap")
    whole = (tmp_path / "drive.mcap").read_bytes()
    packed = zstandard.compress(bytes(2**27))
    at = whole.index(b"zstd")
    for says in (2**40, 2**20):
        chunk = bytearray(whole[: at + 4] + struct.pack("<Q", len(packed)) + packed)
        struct.pack_into("<Q", chunk, at - 16, says)  # before the sum and the word zstd
        (tmp_path / "bomb.mcap").write_bytes(chunk)

        tracemalloc.start()
        with pytest.raises(RecordingError, match="not readable"):
            dc.open(tmp_path / "bomb.mcap")
        assert tracemalloc.get_traced_memory()[1] < 2**24
        tracemalloc.stop()


def test_a_bag_names_no_files_outside_of_it(tmp_path):
    dc.write(WHOLE, tmp_path / "a.ros2")
    dc.write(WHOLE, tmp_path / "b.ros2")
    bag = tmp_path / "a.ros2"
    (bag / "a.db3").unlink()
    (bag / "a.db3").symlink_to(tmp_path / "b.ros2" / "b.db3")
    with pytest.raises(RecordingError, match="link to another"):
        dc.open(bag)

    (bag / "a.db3").unlink()
    metadata = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(metadata.replace("- a.db3", "- ../b.ros2/b.db3"))
    with pytest.raises(RecordingError, match=r"no b\.db3"):
        dc.open(bag)


def test_a_database_whose_values_are_made_up_by_its_columns_is_refused(tmp_path):
    dc.write(WHOLE, tmp_path / "a.ros2")
    file = tmp_path / "a.ros2" / "a.db3"
    file.unlink()
    made = sqlite3.connect(file)
    made.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT)")
    made.execute(
        "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER,"
        " data BLOB AS (zeroblob(900000000)))"
    )
    made.execute("INSERT INTO topics VALUES (1, '/radar/x', 'sensor_msgs/msg/PointCloud2')")
    made.execute("INSERT INTO messages VALUES (1, 1, 0)")
    made.commit()
    made.close()

    with pytest.raises(RecordingError, match="too big"):
        dc.open(tmp_path / "a.ros2")


def test_a_compressed_bag_says_how_to_unpack_it(tmp_path):
    dc.write(WHOLE, tmp_path / "a.ros2")
    file = tmp_path / "a.ros2" / "metadata.yaml"
    file.write_text(file.read_text().replace("compression_mode: ''", "compression_mode: file"))

    with pytest.raises(RecordingError, match="ros2 bag convert"):
        dc.open(tmp_path / "a.ros2")
