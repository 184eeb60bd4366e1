"""RadarScan and RadarTracks of radar_msgs: signs, times and values, against rosbags alone."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.core.errors import DechirpError
from small_radars import small_radar

rosbag2 = pytest.importorskip("rosbags.rosbag2")
rosbag1 = pytest.importorskip("rosbags.rosbag1")
typesys = pytest.importorskip("rosbags.typesys")

pytestmark = pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")

DEFINITIONS = {
    "radar_msgs/msg/RadarReturn": "float32 range\nfloat32 azimuth\nfloat32 elevation\n"
    "float32 doppler_velocity\nfloat32 amplitude\n",
    "radar_msgs/msg/RadarScan": "std_msgs/Header header\nradar_msgs/RadarReturn[] returns\n",
    "radar_msgs/msg/RadarTrack": "unique_identifier_msgs/UUID uuid\ngeometry_msgs/Point position\n"
    "geometry_msgs/Vector3 velocity\ngeometry_msgs/Vector3 acceleration\n"
    "geometry_msgs/Vector3 size\nuint16 classification\nfloat32[6] position_covariance\n"
    "float32[6] velocity_covariance\nfloat32[6] acceleration_covariance\n"
    "float32[6] size_covariance\n",
    "radar_msgs/msg/RadarTracks": "std_msgs/Header header\nradar_msgs/RadarTrack[] tracks\n",
}
SCAN, TRACKS = "radar_msgs/msg/RadarScan", "radar_msgs/msg/RadarTracks"


def type_store(name="ROS2_HUMBLE"):
    store = typesys.get_typestore(getattr(typesys.Stores, name))
    for kind, text in DEFINITIONS.items():
        if name == "ROS1_NOETIC" and "Track" in kind:
            continue
        store.register(typesys.get_types_from_msg(text, kind))
    return store


def header(types, seconds, **more):
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=250_000_000)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id="front", **more)


def build_scan(types, seconds, rows, **more):
    names = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
    returns = [
        types["radar_msgs/msg/RadarReturn"](**dict(zip(names, row, strict=True))) for row in rows
    ]
    return types[SCAN](header=header(types, seconds, **more), returns=returns)


# An approaching car to the left, below the radar, and a receding one to the right.
ROWS = [(30.0, 0.4, -0.1, -12.5, 20.0), (55.0, -0.25, 0.0, 3.25, 11.0)]


def write_bag(path, store, kind, messages):
    with rosbag2.Writer(path, version=8) as bag:
        connection = bag.add_connection("/front/scan", kind, typestore=store)
        for seconds, message in enumerate(messages):
            bag.write(connection, seconds * 10**9, bytes(store.serialize_cdr(message, kind)))


def check_rows(points):
    for name, column in (("range", 0), ("azimuth", 1), ("elevation", 2), ("velocity", 3)):
        expected = [row[column] for row in (*ROWS, ROWS[0])]
        np.testing.assert_allclose(points[name], expected, atol=2e-6, rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(points["amplitude"], [20, 11, 20])
    np.testing.assert_array_equal(points["frame"], [0, 0, 2])
    np.testing.assert_allclose(points["time"], [0, 0, 2])


def test_scans_keep_the_sign_of_doppler_and_angles(tmp_path):
    store = type_store()
    scans = [build_scan(store.types, n, rows) for n, rows in enumerate((ROWS, [], ROWS[:1]))]
    write_bag(tmp_path / "bag", store, SCAN, scans)
    recording = dc.open(tmp_path / "bag")
    assert recording.n_frames == 3
    check_rows(recording.points)
    assert "velocity from doppler_velocity" in " ".join(map(str, recording.findings))


def test_scans_of_ros1_are_read(tmp_path):
    store = type_store("ROS1_NOETIC")
    with rosbag1.Writer(tmp_path / "drive.bag") as bag:
        connection = bag.add_connection("/front/scan", SCAN, typestore=store)
        for n, rows in enumerate((ROWS, [], ROWS[:1])):
            scan = build_scan(store.types, n, rows, seq=n)
            bag.write(connection, n * 10**9, bytes(store.serialize_ros1(scan, SCAN)))
    check_rows(dc.open(tmp_path / "drive.bag").points)


def build_track(types, position_m, velocity_m_per_s):
    vector = types["geometry_msgs/msg/Vector3"]
    return types["radar_msgs/msg/RadarTrack"](
        uuid=types["unique_identifier_msgs/msg/UUID"](uuid=np.arange(16, dtype=np.uint8)),
        position=types["geometry_msgs/msg/Point"](**dict(zip("xyz", position_m, strict=True))),
        velocity=vector(**dict(zip("xyz", velocity_m_per_s, strict=True))),
        acceleration=vector(x=0.0, y=0.0, z=0.0),
        size=vector(x=4.5, y=1.8, z=1.5),
        classification=2,
        **{
            f"{name}_covariance": np.zeros(6, np.float32)
            for name in ("position", "velocity", "acceleration", "size")
        },
    )


def test_tracks_give_positions_and_velocities_along_the_line_of_sight(tmp_path):
    store = type_store()
    types = store.types
    track = build_track(types, (40.0, -30.0, 0.0), (-10.0, 0.0, 0.0))
    message = types[TRACKS](header=header(types, 5), tracks=[track])
    write_bag(tmp_path / "bag", store, TRACKS, [message])
    points = dc.open(tmp_path / "bag").points
    assert points["range"].item() == pytest.approx(50.0)
    assert points["azimuth"].item() == pytest.approx(np.arctan2(-30, 40))
    assert points["velocity"].item() == pytest.approx(-8.0)
    assert points["length"].item() == pytest.approx(4.5)
    assert points["classification"].item() == 2


def native_recording():
    radar = small_radar()
    detections = xr.Dataset(
        {
            "frame": ("detection", np.array([0, 0, 2])),
            "time": ("detection", [0.001, 0.001, 0.041], {"units": "s"}),
            "range": ("detection", [30.0, 55.0, 30.0], {"units": "m"}),
            "azimuth": ("detection", [0.4, np.nan, 0.4], {"units": "rad"}),
            "elevation": ("detection", [np.nan, np.nan, -0.1], {"units": "rad"}),
            "velocity": ("detection", [-12.5, 3.25, -12.5], {"units": "m/s"}),
            "snr": ("detection", [100.0, 10.0, 100.0], {"units": "1"}),
        }
    )
    state = np.array(["x", "vx", "y", "vy"])
    covariance = np.einsum("tf,ij->tfij", np.ones((2, 3)), np.diag([1.0, 2.0, 3.0, 4.0]))
    covariance[..., 0, 2] = covariance[..., 2, 0] = 0.5
    tracks = xr.Dataset(
        {
            **{
                name: (("track", "frame"), np.full((2, 3), value))
                for name, value in (("x", 20.0), ("y", 5.0), ("vx", -3.0), ("vy", 0.25))
            },
            "status": (
                ("track", "frame"),
                np.array([["tentative", "confirmed", "deleted"], ["", "confirmed", "confirmed"]]),
            ),
            "covariance": (("track", "frame", "state", "state_2"), covariance),
        },
        coords={"track": [7, 300], "frame": np.arange(3), "state": state},
    )
    cube = xr.DataArray(
        np.zeros((3, radar.frame.n_chirps_total, 3, 96), np.complex64),
        dims=("frame", "chirp", "rx", "sample"),
        attrs={"units": "1"},
    )
    return dc.recording_from_cube(cube, radar, tables={"detections": detections, "tracks": tracks})


@pytest.mark.parametrize("name", ["drive.ros2", "drive.mcap"])
def test_detections_and_tracks_are_written_as_radar_msgs(name, tmp_path):
    recording = native_recording()
    dc.write(recording, tmp_path / name)
    copy = dc.open(tmp_path / name)
    assert copy.tables["detections"].identical(recording.tables["detections"])
    if name == "drive.mcap":
        return
    store = type_store()
    messages: dict[str, list] = {}
    with rosbag2.Reader(tmp_path / name) as bag:
        for connection, _, data in bag.messages():
            if connection.msgtype in (SCAN, TRACKS):
                content = store.deserialize_cdr(data, connection.msgtype)
                messages.setdefault(connection.msgtype, []).append(content)
    assert [len(scan.returns) for scan in messages[SCAN]] == [2, 0, 1]
    first, second = messages[SCAN][0].returns
    assert (first.range, first.doppler_velocity, first.elevation) == (30.0, -12.5, 0.0)
    assert first.azimuth == pytest.approx(0.4)
    assert first.amplitude == pytest.approx(20.0)
    assert np.isnan(second.azimuth)
    assert messages[SCAN][2].header.stamp.nanosec == 41_000_000
    numbers = [
        [int.from_bytes(bytes(track.uuid.uuid), "big") for track in message.tracks]
        for message in messages[TRACKS]
    ]
    assert numbers == [[7], [7, 300], [300]]
    track = messages[TRACKS][0].tracks[0]
    assert (track.position.x, track.position.y) == (20.0, 5.0)
    assert (track.velocity.x, track.velocity.y) == (-3.0, 0.25)
    np.testing.assert_allclose(track.position_covariance, [1, 0.5, 0, 3, 0, 0])
    np.testing.assert_allclose(track.velocity_covariance, [2, 0, 0, 4, 0, 0])


CORPUS = Path(__file__).parents[1] / "bad_input" / "corpus"


@pytest.mark.parametrize(
    "name", ["bag/radar-scan.db3", "recording/radar-scan.mcap", "recording/radar-tracks.mcap"]
)
def test_damaged_messages_are_read_or_refused(name, tmp_path):
    content = (CORPUS / name).read_bytes()
    rng = np.random.default_rng(11)
    for number in range(60):
        damaged = bytearray(content)
        start = damaged.find(b"front\0")  # the message itself: header and returns or tracks
        for position in rng.integers(start - 30, start + 70, size=2):
            damaged[position] = int(rng.integers(256))
        file = (tmp_path / str(number)).with_suffix(Path(name).suffix)
        file.write_bytes(damaged)
        try:
            points = dc.open(file).points
            assert np.isfinite(points["range"]).all()
        except DechirpError as error:
            assert error.mistakes


def test_signs_of_a_simulated_target_reach_the_messages(tmp_path):
    """A target to the left that recedes has positive azimuth and velocity, by radar_msgs' text."""
    radar = small_radar()
    velocity = np.array([8.0, 4.0, 0.0])
    position = np.array([20.0, 10.0, 0.0])
    target = dc.Target(position_m=tuple(position), velocity_m_per_s=tuple(velocity), rcs_m2=100.0)
    cube = dc.simulate(dc.Scene(targets=[target]), radar, seed=1)
    detections = dc.detect(cube, radar)
    dc.write(
        dc.recording_from_cube(cube, radar, tables={"detections": detections}),
        tmp_path / "drive.ros2",
    )
    with rosbag2.Reader(tmp_path / "drive.ros2") as bag:
        scans = [
            type_store().deserialize_cdr(data, connection.msgtype)
            for connection, _, data in bag.messages()
            if connection.msgtype == SCAN
        ]
    strongest = max(scans[0].returns, key=lambda item: item.amplitude)
    assert strongest.azimuth == pytest.approx(np.arctan2(10, 20), abs=0.05)
    row = detections.isel(detection=int(detections.snr.values.argmax()))
    for name, expected in (
        ("range", np.hypot(20, 10)),
        ("velocity", velocity @ position / np.hypot(20, 10)),
    ):
        assert abs(float(row[name]) - expected) < 5 * float(row[f"{name}_std"]) + 1e-3
    assert strongest.doppler_velocity == pytest.approx(float(row.velocity), rel=1e-6)
    assert strongest.range == pytest.approx(float(row.range), rel=1e-6)


def write_ros1_clouds(path, clouds):
    """Write clouds of fields (name, offset, datatype, count if not 1) and bytes, without rows."""
    store = type_store("ROS1_NOETIC")
    types, kind = store.types, "sensor_msgs/msg/PointCloud2"
    field_type = types["sensor_msgs/msg/PointField"]
    with rosbag1.Writer(path) as bag:
        connection = bag.add_connection("/front/points", kind, typestore=store)
        for seconds, (fields, step, content, is_big_endian, frame_id) in enumerate(clouds):
            width = len(content) // step if step else 0
            cloud = types[kind](
                header=header(types, seconds, seq=seconds),
                height=1 if width else 0,
                width=width,
                fields=[
                    field_type(
                        name=name, offset=offset, datatype=code, count=count[0] if count else 1
                    )
                    for name, offset, code, *count in fields
                ],
                is_bigendian=is_big_endian,
                point_step=step,
                row_step=len(content),
                data=np.frombuffer(content, np.uint8),
                is_dense=True,
            )
            cloud.header.frame_id = frame_id
            bag.write(connection, seconds * 10**9, bytes(store.serialize_ros1(cloud, kind)))


XYZV = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("velocity", 12, 7)]
POINTS = np.array([(10.0, 5.0, 1.0, -3.0), (20.0, -4.0, 0.0, 2.0)])


@pytest.mark.parametrize("empty_fields", [[], XYZV])
def test_empty_clouds_of_ros1_are_frames_without_points(empty_fields, tmp_path):
    """A driver without detections publishes a message of default values: no fields, no bytes."""
    empty = (empty_fields, 0, b"", False, "front")
    full = (XYZV, 16, POINTS.astype("<f4").tobytes(), False, "front")
    write_ros1_clouds(tmp_path / "drive.bag", [empty, full, empty])
    recording = dc.open(tmp_path / "drive.bag")
    assert recording.n_frames == 3
    points = recording.points
    np.testing.assert_array_equal(points["frame"], [1, 1])
    np.testing.assert_allclose(points["velocity"], POINTS[:, 3])
    np.testing.assert_allclose(points["time"], 1.0)
    assert "other topics" not in " ".join(map(str, recording.findings))


def test_clouds_of_ros1_in_other_orders_types_and_bytes_have_the_same_points(tmp_path):
    names, offsets = ("velocity", "z", "y", "x"), (40, 24, 8, 0)
    wide = np.zeros(2, {"names": names, "formats": [">f8"] * 4, "offsets": offsets, "itemsize": 64})
    for column, name in enumerate(("x", "y", "z", "velocity")):
        wide[name] = POINTS[:, column]
    fields = [(name, offset, 8) for name, offset in zip(names, offsets, strict=True)]
    narrow = (XYZV, 16, POINTS.astype("<f4").tobytes(), False, "front")
    write_ros1_clouds(tmp_path / "a.bag", [narrow, (fields, 64, wide.tobytes(), True, "front")])
    points = dc.open(tmp_path / "a.bag").points
    x, y, z, velocity = np.tile(POINTS.T, 2)
    np.testing.assert_allclose(points["range"], np.sqrt(x**2 + y**2 + z**2), rtol=1e-6)
    np.testing.assert_allclose(points["azimuth"], np.arctan2(y, x), rtol=1e-6)
    np.testing.assert_allclose(points["velocity"], velocity)


def test_clouds_that_lose_their_velocities_are_refused_by_name(tmp_path):
    full = (XYZV, 16, POINTS.astype("<f4").tobytes(), False, "front")
    short = (XYZV[:3], 12, POINTS[:, :3].astype("<f4").tobytes(), False, "front")
    write_ros1_clouds(tmp_path / "drive.bag", [full, short])
    with pytest.raises(DechirpError, match="frame 1.*without velocity.*/front/points"):
        dc.open(tmp_path / "drive.bag").points  # noqa: B018


def test_points_of_several_coordinate_frames_are_reported(tmp_path):
    clouds = [(XYZV, 16, POINTS.astype("<f4").tobytes(), False, name) for name in ("front", "rear")]
    write_ros1_clouds(tmp_path / "drive.bag", clouds)
    (finding,) = [
        finding
        for finding in dc.open(tmp_path / "drive.bag").findings
        if "frame_id" in finding.value
    ]
    assert finding.level == "warning"
    assert "'front', 'rear'" in finding.value


def test_returns_without_a_valid_range_are_left_out(tmp_path):
    store = type_store()
    rows = [(value, 0.1, 0.0, 1.0, 2.0) for value in (-5.0, np.nan, np.inf, 7.0)]
    rows.append((3.0, np.inf, np.inf, 1.0, 2.0))
    write_bag(tmp_path / "bag", store, SCAN, [build_scan(store.types, 0, rows)])
    points = dc.open(tmp_path / "bag").points
    np.testing.assert_allclose(points["range"], [7.0])
    np.testing.assert_allclose(points["azimuth"], [0.1], rtol=1e-6)


def test_vertical_velocities_of_tracks_count_along_the_line_of_sight(tmp_path):
    """At (30, 0, 40) m, (0, 0, 5) m/s recede at 5 x 40 / 50 = 4 m/s."""
    store = type_store()
    tracks = [
        build_track(store.types, (30.0, 0.0, 40.0), (0.0, 0.0, 5.0)),
        build_track(store.types, (30.0, 0.0, 40.0), (0.0, 0.0, np.nan)),
    ]
    message = store.types[TRACKS](header=header(store.types, 5), tracks=tracks)
    write_bag(tmp_path / "bag", store, TRACKS, [message])
    points = dc.open(tmp_path / "bag").points
    np.testing.assert_allclose(points["velocity"], [4.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("offset", [13, 2**31 - 4, 2**31 - 1, 2**31, 2**32 - 4])
def test_fields_beyond_their_point_are_refused(offset, tmp_path):
    """At 2 GiB, NumPy's sum of offset and size overflows."""
    fields = [*XYZV[:3], ("velocity", offset, 7)]
    cloud = (fields, 16, POINTS.astype("<f4").tobytes(), False, "front")
    write_ros1_clouds(tmp_path / "drive.bag", [cloud])
    with pytest.raises(DechirpError, match="velocity beyond the 16 bytes of a point"):
        dc.open(tmp_path / "drive.bag")


@pytest.mark.parametrize("names", [("velocity", "Velocity"), ("Velocity", "velocity")])
def test_of_fields_that_differ_in_case_the_lower_case_is_read_with_a_warning(names, tmp_path):
    fields = [*XYZV[:3], *((name, 12 + 4 * n, 7) for n, name in enumerate(names))]
    values = {"velocity": POINTS[:, 3], "Velocity": POINTS[:, 3] + 50}
    rows = np.column_stack([POINTS[:, :3], *(values[name] for name in names)]).astype("<f4")
    write_ros1_clouds(tmp_path / "drive.bag", [(fields, 20, rows.tobytes(), False, "front")])
    recording = dc.open(tmp_path / "drive.bag")
    np.testing.assert_allclose(recording.points["velocity"], POINTS[:, 3])
    (finding,) = [item for item in recording.findings if "differ only in case" in item.value]
    assert finding.level == "warning"
    assert "Velocity is not read" in finding.value


@pytest.mark.parametrize("name", ["x", "velocity", "snr"])
@pytest.mark.parametrize("is_first", [True, False])
def test_fields_of_several_values_are_refused(name, is_first, tmp_path):
    """A velocity may be a vector of three components, which is no radial velocity."""
    names = ("x", "y", "z", "velocity", "snr")
    plain = [(field, 4 * n, 7) for n, field in enumerate(names)]
    vector = [(*field, 3 if field[0] == name else 1) for field in plain]
    content = np.ones((2, 8), "<f4").tobytes()
    clouds = [(fields, 32, content, False, "front") for fields in (vector, plain)]
    write_ros1_clouds(tmp_path / "drive.bag", clouds if is_first else clouds[::-1])
    with pytest.raises(
        DechirpError, match=f"3 values of {name} in a point.*/front/points"
    ) as error:
        dc.open(tmp_path / "drive.bag").points  # noqa: B018
    assert error.value.mistakes[0].expected == "one number in each field of a point"


def test_other_fields_of_several_values_are_left_out(tmp_path):
    fields = [*XYZV, ("spectrum", 16, 7, 3)]
    content = np.ones((2, 7), "<f4").tobytes()
    write_ros1_clouds(tmp_path / "drive.bag", [(fields, 28, content, False, "front")])
    points = dc.open(tmp_path / "drive.bag").points
    assert points.sizes == {"detection": 2}
    assert "spectrum" not in points


def test_other_fields_of_changing_size_are_left_out(tmp_path):
    content = np.ones((2, 7), "<f4").tobytes()
    clouds = [([*XYZV, ("spectrum", 16, 7, n)], 28, content, False, "front") for n in (3, 2)]
    write_ros1_clouds(tmp_path / "drive.bag", clouds)
    points = dc.open(tmp_path / "drive.bag").points
    assert points.sizes == {"detection": 4}
    assert "spectrum" not in points


def test_components_of_several_values_are_refused_only_where_the_velocity_comes_from_them(tmp_path):
    """With a radial velocity, components are other fields."""
    content = np.full((2, 9), 2, "<f4").tobytes()
    fields = [(name, 4 * n, 7) for n, name in enumerate(("x", "y", "vy", "z", "V"))]
    fields.append(("vx", 20, 7, 3))
    write_ros1_clouds(tmp_path / "radial.bag", [(fields, 36, content, False, "front")])
    points = dc.open(tmp_path / "radial.bag").points
    np.testing.assert_array_equal(points["velocity"], 2)
    assert "vx" not in points
    without_radial = [field for field in fields if field[0] != "V"]
    write_ros1_clouds(tmp_path / "parts.bag", [(without_radial, 36, content, False, "front")])
    with pytest.raises(DechirpError, match="3 values of vx in a point"):
        dc.open(tmp_path / "parts.bag/front/points").points  # noqa: B018


def test_stamps_that_go_backwards_are_reported(tmp_path):
    """A clock that is set, or clouds of two radars on one topic."""
    store = type_store()
    scans = [build_scan(store.types, seconds, ROWS) for seconds in (5, 6, 3, 4, 2)]
    write_bag(tmp_path / "bag", store, SCAN, scans)
    recording = dc.open(tmp_path / "bag")
    np.testing.assert_allclose(recording.points["time"][::2], [0, 1, -2, -1, -3])
    (finding,) = [item for item in recording.findings if "backwards" in item.value]
    assert finding.level == "warning"
    assert "2 times" in finding.value
    assert "frame 2, by 3 s" in finding.value
