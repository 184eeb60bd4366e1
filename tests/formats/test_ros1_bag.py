"""ROS 1 bags of point clouds, written by `rosbags`."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import RecordingError
from dechirp.recordings.recognise import recognise_formats
from nightly import n_examples

CLOUD = "sensor_msgs/msg/PointCloud2"
CODES = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("velocity", "<f4"), ("snr", "<f4"), ("id", "<u2")]
)


def ros1_store():
    stores = pytest.importorskip("rosbags.typesys")
    return stores.get_typestore(stores.Stores.ROS1_NOETIC)


def build_cloud(store, points, number):
    types = store.types
    fields = [
        types["sensor_msgs/msg/PointField"](
            name=name,
            offset=points.dtype.fields[name][1],
            datatype=CODES[points.dtype[name].str[1:]],
            count=1,
        )
        for name in points.dtype.names
    ]
    stamp = types["builtin_interfaces/msg/Time"](sec=1600, nanosec=50_000_000 * number)
    return types[CLOUD](
        header=types["std_msgs/msg/Header"](seq=7 + number, stamp=stamp, frame_id="front"),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=points.dtype.itemsize,
        row_step=points.nbytes,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def draw_clouds(dtype=POINT, n_frames=4):
    """Draw clouds of 3, 2, 1 and 0 points."""
    rng = np.random.default_rng(6)
    clouds = []
    for number in range(n_frames):
        points = np.zeros(3 - number, dtype)
        for name in dtype.names:
            points[name] = rng.integers(1, 40, len(points))
        clouds.append(points)
    return clouds


def write_bag(path, topics, compression=None):
    """Write clouds by topic, and a text."""
    from rosbags.rosbag1 import Writer

    store = ros1_store()
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer as bag:
        text = bag.add_connection("/notes", "std_msgs/msg/String", typestore=store)
        message = store.types["std_msgs/msg/String"](data="rain")
        bag.write(text, 10**9, store.serialize_ros1(message, "std_msgs/msg/String"))
        for topic, clouds in topics.items():
            connection = bag.add_connection(topic, CLOUD, typestore=store)
            for number, points in enumerate(clouds):
                content = store.serialize_ros1(build_cloud(store, points, number), CLOUD)
                bag.write(connection, (1600 + number) * 10**9, content)
    return path


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
def test_points_of_a_bag_become_detections(tmp_path, compression):
    clouds = draw_clouds()
    lidar = draw_clouds(np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")]))
    bag = write_bag(tmp_path / "drive.bag", {"/front/radar": clouds, "/lidar": lidar}, compression)

    assert recognise_formats(bag) == ("ros1-bag",)
    recording = dc.open(bag)

    points = np.concatenate(clouds)
    x, y, z = (points[name].astype(float) for name in "xyz")
    detections = recording.points
    assert recording.n_frames == 4
    assert np.array_equal(detections.frame, [0, 0, 0, 1, 1, 2])
    assert np.allclose(detections.time, np.array([0, 0, 0, 1, 1, 2]) * 0.05)
    assert np.allclose(detections.range, np.sqrt(x**2 + y**2 + z**2))
    assert np.allclose(detections.azimuth, np.arctan2(y, x))
    assert np.allclose(detections.velocity, points["velocity"])
    assert np.allclose(detections.snr, 10 ** (points["snr"].astype(float) / 10))
    assert np.array_equal(detections.id, points["id"])
    findings = " ".join(finding.value for finding in recording.findings)
    assert "/lidar (sensor_msgs/msg/PointCloud2), /notes (std_msgs/msg/String)" in findings
    assert np.allclose(dc.open(bag / "lidar").points.range[0], np.linalg.norm(lidar[0].tolist()[0]))


def test_bag_without_points_names_its_topics_and_has_no_samples(tmp_path, capsys):
    bag = write_bag(tmp_path / "drive.bag", {})
    with pytest.raises(RecordingError, match=r"no point cloud of a radar: /notes"):
        dc.open(bag)

    bag = write_bag(tmp_path / "points.bag", {"/radar_points": draw_clouds()})
    with pytest.raises(RecordingError, match="detections without samples"):
        dc.open(bag).check_has_samples()


@pytest.mark.parametrize("n_bytes", [13, 14, 200, 4096, 4200, -1, -60])
def test_truncated_bag_is_refused(tmp_path, n_bytes):
    bag = write_bag(tmp_path / "drive.bag", {"/radar_points": draw_clouds()})
    bag.write_bytes(bag.read_bytes()[:n_bytes])

    with pytest.raises(RecordingError, match="a complete ROS 1 bag") as error:
        dc.open(bag)
    assert n_bytes > 13 or n_bytes < 0 or "without messages" in str(error.value)


@pytest.mark.parametrize(
    ("size", "message"), [(100, "100 bytes in a chunk|after the file"), (2**31, "a chunk of 2147")]
)
def test_chunk_is_not_decompressed_beyond_its_declared_size(tmp_path, size, message):
    bag = write_bag(tmp_path / "drive.bag", {"/radar_points": draw_clouds()}, "BZ2")
    content = bytearray(bag.read_bytes())
    place = content.index(b"size=") + 5
    content[place : place + 4] = struct.pack("<I", size)
    bag.write_bytes(content)

    with pytest.raises(RecordingError, match=message):
        dc.open(bag)


@pytest.fixture(scope="module")
def bag_bytes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    return write_bag(folder / "a.bag", {"/radar_points": draw_clouds()}).read_bytes()


@given(data=st.data())
@settings(max_examples=n_examples(150), deadline=None)
def test_mutated_bag_gives_detections_or_error(bag_bytes, tmp_path_factory, data):
    content = bytearray(bag_bytes)
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(content) - 1))
        content[position] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("bag") / "drive.bag"
    file.write_bytes(content)
    try:
        recording = dc.open(file)
    except RecordingError as error:
        assert len(str(error)) < 2000
        return
    assert np.isfinite(recording.points.range).all()


def test_database_of_a_ros2_bag_opens_without_its_folder(tmp_path):
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    clouds = draw_clouds()
    with Writer(tmp_path / "drive", version=9) as bag:
        connection = bag.add_connection("/radar_points", CLOUD, typestore=store)
        for number, points in enumerate(clouds):
            cloud = build_cloud(ros1_store(), points, number)
            header = store.types["std_msgs/msg/Header"](
                stamp=cloud.header.stamp, frame_id=cloud.header.frame_id
            )
            fields = {name: getattr(cloud, name) for name in cloud.__dataclass_fields__}
            del fields["__msgtype__"]
            message = store.types[CLOUD](**{**fields, "header": header})
            bag.write(connection, number * 10**9, store.serialize_cdr(message, CLOUD))
    (database,) = (tmp_path / "drive").glob("*.db3")

    expected = dc.open(tmp_path / "drive").points
    assert recognise_formats(database) == ("ros2-bag",)
    assert dc.open(database).points.identical(expected)
    assert dc.open(database / "radar_points").points.identical(expected)


def test_record_without_fields_is_refused_with_the_name_of_the_field(tmp_path):
    path = tmp_path / "zeros.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(4000))
    with pytest.raises(RecordingError, match=r"not readable \(damaged, without the field op\)"):
        dc.open(path)
