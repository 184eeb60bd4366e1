"""Writer and reader of point clouds in MCAP files and ROS 2 bags, native and foreign."""

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
from dechirp.recordings.writers.point_clouds import iter_ros2_messages
from dechirp.recordings.writers.ros_messages import build_cloud_message, build_text_message
from formats.corruption import assert_cube_or_error, corrupted_bytes
from nightly import n_examples, nightly

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
FILE_NAMES = ("drive.mcap", "drive.ros2")

UNKNOWN = np.nan
DETECTIONS = xr.Dataset(
    {
        # Frames 0, 2 and 4 have no detections.
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


def make_recording(**tables):
    shape = (N_FRAMES, 4, 2, 8)
    cube = label_cube(np.zeros(shape, np.complex64), RADAR, units="1")
    return recording_from_cube(cube, RADAR, tables=tables)


RECORDING = make_recording(detections=DETECTIONS, truth=TRUTH, ego=EGO)


def assert_tables_equal(dataset, expected):
    xr.testing.assert_identical(dataset, expected)
    for name, variable in expected.variables.items():
        kinds = (dataset[name].dtype, variable.dtype)
        assert kinds[0] == kinds[1] or kinds[0].kind == kinds[1].kind == "U", name


def read_clouds_with_rosbags(path, topic):
    """Iterate over the decoded clouds of a topic: (time, message)."""
    from rosbags.rosbag2 import Reader

    with Reader(path) as bag:
        connections = [connection for connection in bag.connections if connection.topic == topic]
        for connection, time_ns, data in bag.messages(connections=connections):
            yield time_ns, ros.ros2_message_type_store().deserialize_cdr(data, connection.msgtype)


def decode_positions(cloud):
    """Decode x, y, z of each point at the offsets of its fields."""
    offsets = {field.name: field.offset for field in cloud.fields}
    content = bytes(cloud.data)
    return [
        [
            struct.unpack_from("<f", content, n * cloud.point_step + offsets[axis])[0]
            for axis in "xyz"
        ]
        for n in range(cloud.width)
    ]


POSITIONS = {
    0: [],
    1: [
        [0.0, 10.0, 0.0],  # left of the radar
        [np.cos(0.1) / 3, np.sin(0.1) / 3, 0.0],  # no elevation: at the height of the radar
        [UNKNOWN, UNKNOWN, UNKNOWN],  # no azimuth, no position
    ],
    2: [],
    3: [[20 * np.cos(0.5) ** 2, -20 * np.cos(0.5) * np.sin(0.5), 20 * np.sin(0.5)]],
    4: [],
}


def assert_positions(clouds):
    assert len(clouds) == N_FRAMES
    for frame, cloud in enumerate(clouds):
        assert cloud.header.frame_id == "radar"
        assert cloud.is_dense == (frame != 1)
        expected = np.array(POSITIONS[frame]).reshape(-1, 3)
        positions = np.array(decode_positions(cloud)).reshape(-1, 3)
        np.testing.assert_allclose(positions, expected, rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("name", FILE_NAMES)
def test_round_trip_keeps_detections_truth_and_radar(tmp_path, name):
    progress = []
    paths = dc.write(RECORDING, tmp_path / name, progress=lambda *counts: progress.append(counts))
    assert paths == (tmp_path / name,)
    assert progress == [(frame + 1, N_FRAMES) for frame in range(N_FRAMES)]

    copy = dc.open(tmp_path / name)

    assert copy.n_frames == N_FRAMES
    assert copy.radar == RADAR
    assert copy.contents.units == "1"
    assert_tables_equal(copy.points, DETECTIONS)
    assert list(copy.tables) == ["detections", "truth", "ego"]
    for key, table in (("detections", DETECTIONS), ("truth", TRUTH), ("ego", EGO)):
        assert_tables_equal(copy.tables[key], table)
    assert not copy.sizes
    assert not copy.findings


@pytest.mark.parametrize("name", FILE_NAMES)
def test_converted_bag_is_equal_and_selection_starts_at_frame_0(tmp_path, name):
    dc.write(RECORDING, tmp_path / name)
    second_path = tmp_path / FILE_NAMES[1 - FILE_NAMES.index(name)]
    dc.write(dc.open(tmp_path / name), second_path)
    dc.write(dc.open(second_path, frames=(3, 5)), tmp_path / f"part.{name}")

    assert_tables_equal(dc.open(second_path).tables["truth"], TRUTH)
    partial_copy = dc.open(tmp_path / f"part.{name}")
    assert partial_copy.n_frames == 2
    np.testing.assert_array_equal(partial_copy.points.range, [20.0])
    np.testing.assert_array_equal(partial_copy.points.frame, [0])
    np.testing.assert_allclose(partial_copy.points.time, [0.0], atol=1e-12)


@pytest.mark.parametrize("name", FILE_NAMES)
def test_recording_without_detections_keeps_frames(tmp_path, name):
    no_detections = DETECTIONS.isel(detection=slice(0))
    dc.write(make_recording(detections=no_detections), tmp_path / name)

    copy = dc.open(tmp_path / name)

    assert copy.n_frames == N_FRAMES
    assert_tables_equal(copy.points, no_detections)


@pytest.mark.parametrize("name", FILE_NAMES)
def test_given_radar_takes_precedence_over_file(tmp_path, name):
    dc.write(RECORDING, tmp_path / name)
    given_radar = replace(RADAR, frame=replace(RADAR.frame, period_s=0.1))

    assert dc.open(tmp_path / name, radar=given_radar).radar == given_radar


@pytest.mark.parametrize("name", FILE_NAMES)
def test_rosbags_reads_equal_positions_and_times(tmp_path, name):
    dc.write(RECORDING, tmp_path / name)

    clouds = list(read_clouds_with_rosbags(tmp_path / name, "/radar/detections"))

    assert_positions([cloud for _, cloud in clouds])
    middle_ns = round(RADAR.frame.mid_frame_s * 1e9)
    # Time of the detections if any, else the frame centre.
    frames_ns = [middle_ns, 50_000_000, 100_000_000 + middle_ns, 150_000_000]
    assert [time_ns for time_ns, _ in clouds] == [*frames_ns, 200_000_000 + middle_ns]
    stamps = [cloud.header.stamp for _, cloud in clouds]
    assert [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps] == [
        time_ns for time_ns, _ in clouds
    ]


def test_mcap_ros2_decodes_equal_positions(tmp_path):
    ros2 = pytest.importorskip("mcap_ros2.reader")
    dc.write(RECORDING, tmp_path / "drive.mcap")

    with (tmp_path / "drive.mcap").open("rb") as file:
        clouds = list(ros2.read_ros2_messages(file, topics=["/radar/detections"]))

    assert_positions([decoded_message.ros_msg for decoded_message in clouds])
    cloud = clouds[1].ros_msg
    columns = {field.name for field in cloud.fields}
    # Numbers and texts without a field type are stored in separate arrays.
    assert columns == {*DETECTIONS.variables, "x", "y", "z", "intensity"}
    offset = next(field for field in cloud.fields if field.name == "intensity").offset
    levels = [
        struct.unpack_from("<f", bytes(cloud.data), n * cloud.point_step + offset)[0]
        for n in range(3)
    ]
    assert levels == pytest.approx([20.0, 10.0, -np.inf])


def test_truth_is_cloud_of_targets_per_frame(tmp_path):
    dc.write(RECORDING, tmp_path / "drive.ros2")

    clouds = [
        cloud for _, cloud in read_clouds_with_rosbags(tmp_path / "drive.ros2", "/radar/truth")
    ]

    positions = np.array([decode_positions(cloud) for cloud in clouds])
    assert positions.shape == (N_FRAMES, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(positions, axis=-1).T, TRUTH.range, rtol=1e-6)


# --- Foreign files --------------------------------------------------------------------


def make_foreign_cloud(rows, *, fields, topic="/front/points", time_ns=10**18):
    points = np.array(rows, dtype=[(name, "<f4") for name in fields])
    return build_cloud_message(topic, time_ns, points)


def write_mcap(path, messages):
    from mcap.writer import Writer

    with path.open("wb") as file:
        bag = Writer(file)
        bag.start(profile="ros2")
        for message in messages:
            schema = bag.register_schema(message.type, "ros2msg", b"unread")
            channel = bag.register_channel(message.topic, "cdr", schema)
            bag.add_message(channel, message.time_ns, message.data, message.time_ns)
        bag.finish()


def write_bag(path, messages):
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topics = {}
        for message in messages:
            if message.topic not in topics:
                topics[message.topic] = bag.add_connection(
                    message.topic, message.type, typestore=ros.ros2_message_type_store()
                )
            bag.write(topics[message.topic], message.time_ns, message.data)


@pytest.mark.parametrize("write", [write_mcap, write_bag])
def test_foreign_points_become_detections_with_findings(tmp_path, write):
    fields = ("x", "y", "z", "Doppler", "snr", "rcs", "gain")
    rows = [(3.0, 4.0, 0.0, -2.0, 20.0, 1.5, 0.0), (UNKNOWN,) * 7]
    lidar = make_foreign_cloud([(1.0, 1.0, 1.0)], fields=("x", "y", "z"), topic="/lidar")
    messages = [
        build_text_message("/notes", "rain"),
        lidar,
        make_foreign_cloud(rows, fields=fields),
        make_foreign_cloud(rows[:1], fields=fields, time_ns=10**18 + 5 * 10**7),
    ]
    write(tmp_path / "drive", messages)

    recording = dc.open(tmp_path / "drive")

    assert recording.n_frames == 2
    assert recording.contents.radar is None
    points = recording.points
    assert [*points][-2:] == ["rcs", "gain"]
    np.testing.assert_allclose(points.range, [5.0, 5.0])
    np.testing.assert_allclose(points.azimuth, [np.arctan2(4, 3)] * 2)
    np.testing.assert_allclose(points.velocity, [-2.0, -2.0])
    np.testing.assert_allclose(points.snr, [100.0, 100.0])
    np.testing.assert_allclose(points.rcs, [1.5, 1.5])
    np.testing.assert_allclose(points.time, [0.0, 0.05])
    findings = " ".join(finding.value for finding in recording.findings)
    assert "velocity from Doppler" in findings
    assert "/lidar (sensor_msgs/msg/PointCloud2), /notes (std_msgs/msg/String)" in findings
    lidar_recording = dc.open(tmp_path / "drive" / "lidar")
    assert lidar_recording.n_frames == 1
    assert "no velocity, no snr in dB" in lidar_recording.findings[0].value
    assert lidar_recording.findings[0].level == "warning"


def test_reads_big_endian_padded_points(tmp_path):
    message = make_foreign_cloud([(0.0, 0.0, 0.0, 0.0)], fields=("x", "y", "z", "v"))
    cloud = ros.decode_message(message)
    rows = np.zeros((2, 3, 4), ">f4")  # the third point of each row is padding
    rows[..., 0] = [[1, 2, 99], [3, 4, 99]]
    big_endian_cloud = ros.create_message(
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
    write_mcap(tmp_path / "a.mcap", [message._replace(data=ros.encode_message(big_endian_cloud))])

    np.testing.assert_allclose(dc.open(tmp_path / "a.mcap").points.range, [1, 2, 3, 4])


@pytest.mark.parametrize(
    ("messages", "mistake"),
    [
        ([build_text_message("/notes", "rain")], r"no points|/notes \(std_msgs/msg/String\)"),
        (
            [make_foreign_cloud([(1.0, 2.0)], fields=("x", "v"))],
            "points with fields x, v on /front/points",
        ),
        ([], "no messages"),
        ([build_text_message("/radar/description", '{"dechirp_exchange": 9}')], "version 9"),
    ],
)
def test_file_without_radar_points_error_lists_topics(tmp_path, messages, mistake):
    write_mcap(tmp_path / "a.mcap", messages)

    with pytest.raises(RecordingError, match=mistake):
        dc.open(tmp_path / "a.mcap")


def test_rejects_cloud_with_oversized_shape(tmp_path):
    message = make_foreign_cloud([(1.0, 2.0, 3.0, 4.0)], fields=("x", "y", "z", "v"))
    cloud = ros.decode_message(message)
    for changes in ({"width": 2**31}, {"height": 2**31, "row_step": 0}, {"point_step": 2**20}):
        parts = {name: getattr(cloud, name) for name in cloud.__dataclass_fields__}
        data = ros.encode_message(ros.create_message(ros.CLOUD, **{**parts, **changes}))
        write_mcap(tmp_path / "a.mcap", [message._replace(data=data)])

        with pytest.raises(RecordingError, match="not readable"):
            dc.open(tmp_path / "a.mcap")


# --- Rejected content -----------------------------------------------------------------


def test_rejects_samples_without_detections(tmp_path):
    with pytest.raises(DechirpError, match=r"dechirp run IN --out FOLDER"):
        dc.write(make_recording(truth=TRUTH), tmp_path / "drive.mcap")

    assert not list(tmp_path.iterdir())


def test_table_with_one_number_per_frame_is_kept(tmp_path):
    ego = xr.Dataset({"range": ("frame", np.arange(5.0)), "frame": ("frame", np.arange(5))})
    for name in FILE_NAMES:
        dc.write(make_recording(detections=DETECTIONS, ego=ego), tmp_path / name)

        xr.testing.assert_identical(dc.open(tmp_path / name).tables["ego"], ego)


def test_rejects_detections_with_several_axes(tmp_path):
    two_dimensional = xr.Dataset(
        {"range": (("frame", "place"), np.ones((5, 2))), "frame": np.arange(5)}
    )
    for detections in (
        two_dimensional,
        two_dimensional.isel(place=0),
        DETECTIONS.rename(detection="row"),
    ):
        with pytest.raises(DechirpError, match="not rows of one axis"):
            dc.write(make_recording(detections=detections), tmp_path / "drive.mcap")


def test_rejects_detections_out_of_frame_order(tmp_path):
    for detections in (
        DETECTIONS.isel(detection=[3, 0]),
        DETECTIONS.assign(frame=DETECTIONS.frame + 2),
    ):
        with pytest.raises(DechirpError, match="not in order of frames"):
            dc.write(make_recording(detections=detections), tmp_path / "drive.mcap")


@pytest.mark.parametrize("name", FILE_NAMES)
def test_rejects_topic_of_native_recording(tmp_path, name):
    dc.write(RECORDING, tmp_path / name)

    with pytest.raises(RecordingError, match=f"open {name}"):
        dc.open(tmp_path / name / "radar" / "truth")


@pytest.mark.parametrize("name", FILE_NAMES)
def test_inspect_shows_detections_and_run_rejects_them(tmp_path, name, capsys):
    dc.write(RECORDING, tmp_path / name)
    out = tmp_path / "looked"

    with pytest.raises(SystemExit) as exit_info:
        main(["inspect", str(tmp_path / name), "--out", str(out), "--json"])

    assert not exit_info.value.code
    document = json.loads(capsys.readouterr().out)
    assert document["dims"] == {"frame": N_FRAMES, "detection": 4}
    assert (out / "map.png").stat().st_size > 0
    with pytest.raises(SystemExit) as exit_info:
        main(["run", str(tmp_path / name), "--out", str(tmp_path / "ran")])
    assert exit_info.value.code == 2
    assert "contains detections without samples" in capsys.readouterr().err


def test_missing_library_error_names_package(tmp_path, monkeypatch):
    dc.write(RECORDING, tmp_path / "drive.mcap")
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    ros.ros2_message_type_store.cache_clear()

    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
        dc.open(tmp_path / "drive.mcap")
    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
        dc.write(RECORDING, tmp_path / "other.ros2")


@contextmanager
def limit_file_size(n_bytes):
    """Limit the size of files: longer writes fail as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@nightly
@pytest.mark.parametrize("name", FILE_NAMES)
def test_full_disk_keeps_existing_file(tmp_path, name):
    dc.write(make_recording(detections=DETECTIONS), tmp_path / name)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # rosbags does not close its database
        with limit_file_size(2000), pytest.raises(DechirpError, match="not writable"):
            dc.write(RECORDING, tmp_path / name)
        gc.collect()

    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert_tables_equal(dc.open(tmp_path / name).points, DETECTIONS)
    assert list(dc.open(tmp_path / name).tables) == ["detections"]


def test_replaces_native_bag_only(tmp_path):
    dc.write(make_recording(detections=DETECTIONS), tmp_path / "drive.ros2")
    dc.write(RECORDING, tmp_path / "drive.ros2")
    assert "truth" in dc.open(tmp_path / "drive.ros2").tables

    (tmp_path / "drive.ros2" / "notes.txt").write_text("mine")
    with pytest.raises(DechirpError, match=r"a folder with notes\.txt"):
        dc.write(RECORDING, tmp_path / "drive.ros2")


# --- Damaged files --------------------------------------------------------------------


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bag")
    dc.write(RECORDING, folder / "drive.ros2")
    return folder / "drive.ros2"


@settings(max_examples=n_examples(80), deadline=None)
@given(data=st.data())
def test_corrupted_bag_gives_detections_or_error(bag, data):
    file = data.draw(st.sampled_from(sorted(bag.iterdir())))
    content = file.read_bytes()
    try:
        file.write_bytes(data.draw(corrupted_bytes(content)))
        assert_cube_or_error(bag)
    finally:
        file.write_bytes(content)


MESSAGES = tuple(iter_ros2_messages(RECORDING))


@settings(max_examples=n_examples(150), deadline=None)
@given(data=st.data())
def test_corrupted_message_gives_detections_or_error(tmp_path_factory, data):
    """Corrupt messages before the MCAP checksums, which would otherwise catch the damage first."""
    messages = list(MESSAGES)
    index = data.draw(st.integers(0, len(messages) - 1))
    messages[index] = messages[index]._replace(
        data=data.draw(corrupted_bytes(bytes(messages[index].data)))
    )
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    write_mcap(path, messages)

    assert_cube_or_error(path)


def test_rejects_truncated_mcap(tmp_path):
    dc.write(RECORDING, tmp_path / "drive.mcap")
    content = (tmp_path / "drive.mcap").read_bytes()
    for end in range(8, len(content), 97):
        (tmp_path / "cut.mcap").write_bytes(content[:end])
        with pytest.raises(RecordingError):
            dc.open(tmp_path / "cut.mcap")


def test_mcap_chunk_beyond_declared_size_is_not_decompressed(tmp_path):
    import zstandard

    dc.write(RECORDING, tmp_path / "drive.mcap")
    content = (tmp_path / "drive.mcap").read_bytes()
    packed = zstandard.compress(bytes(2**27))
    offset = content.index(b"zstd")
    for declared_size in (2**40, 2**20):
        chunk = bytearray(content[: offset + 4] + struct.pack("<Q", len(packed)) + packed)
        # Position before the checksum and the word zstd.
        struct.pack_into("<Q", chunk, offset - 16, declared_size)
        (tmp_path / "bomb.mcap").write_bytes(chunk)

        tracemalloc.start()
        with pytest.raises(RecordingError, match="not readable"):
            dc.open(tmp_path / "bomb.mcap")
        assert tracemalloc.get_traced_memory()[1] < 2**24
        tracemalloc.stop()


def test_rejects_bag_with_files_outside_folder(tmp_path):
    dc.write(RECORDING, tmp_path / "a.ros2")
    dc.write(RECORDING, tmp_path / "b.ros2")
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


def test_rejects_database_with_generated_columns(tmp_path):
    dc.write(RECORDING, tmp_path / "a.ros2")
    file = tmp_path / "a.ros2" / "a.db3"
    file.unlink()
    database = sqlite3.connect(file)
    database.execute("CREATE TABLE topics (id INTEGER, name TEXT, type TEXT)")
    database.execute(
        "CREATE TABLE messages (id INTEGER, topic_id INTEGER, timestamp INTEGER,"
        " data BLOB AS (zeroblob(900000000)))"
    )
    database.execute("INSERT INTO topics VALUES (1, '/radar/x', 'sensor_msgs/msg/PointCloud2')")
    database.execute("INSERT INTO messages VALUES (1, 1, 0)")
    database.commit()
    database.close()

    with pytest.raises(RecordingError, match="too big"):
        dc.open(tmp_path / "a.ros2")


def test_compressed_bag_error_gives_decompression_command(tmp_path):
    dc.write(RECORDING, tmp_path / "a.ros2")
    file = tmp_path / "a.ros2" / "metadata.yaml"
    file.write_text(file.read_text().replace("compression_mode: ''", "compression_mode: file"))

    with pytest.raises(RecordingError, match="ros2 bag convert"):
        dc.open(tmp_path / "a.ros2")
