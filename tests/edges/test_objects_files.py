"""Object lists in files: OSI, points and tables, by suffix, whole or not at all."""

import csv
import json
import re
import struct
import sys
from pathlib import Path

import duckdb
import numpy as np
import pytest
import trimesh
from osi3trace.osi_trace import OSITrace
from scipy.spatial.transform import Rotation

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.results.object_lists.can_logs import write_can_log
from dechirp.results.object_lists.files import check_output_path, read_objects, write_objects
from dechirp.results.object_lists.list_columns import COLUMNS, build_object_list
from dechirp.results.object_lists.osi import osi_messages, read_osi, write_osi
from dechirp.results.object_lists.point_cloud_files import write_points
from dechirp.results.object_lists.priority import sort_by_priority
from dechirp.results.object_lists.tables import write_table
from objects_made import must_be_equal, objects_at, one

SINGLE = {"relative": 2.0**-24, "snr": 1e-6}
CODED = (".blf", ".asc", ".log")
SUFFIXES = (*CODED, ".osi", ".pcd", ".ply", ".csv", ".parquet")


def tracks_of(objects):
    """Say that they are tracks, which OSI tells without their ratios."""
    status = np.where(objects.status == "detection", "tentative", objects.status)
    return objects.assign(status=("object", status), snr=("object", np.full(len(status), np.nan)))


def test_tracks_in_osi_read_back_exactly(tmp_path):
    found = tracks_of(objects_at(7, 0, 3))
    found["number"] = found.number[::-1]

    write_objects(found, tmp_path / "tracks.osi")
    again = read_objects(tmp_path / "tracks.osi")

    must_be_equal(again, sort_by_priority(found), {})
    assert again.cycle_frame.values.tolist() == [0, 1, 2]
    assert again.cycle_time.values.tolist() == pytest.approx([0.0, 0.05, 0.1], abs=1e-9)


def test_detections_in_osi_read_back_exactly(tmp_path):
    found = objects_at(7, 3)
    open_ = np.full(10, np.nan)
    found = found.assign(
        status=("object", ["detection"] * 10), length=("object", open_), width=("object", open_)
    )

    write_objects(found, tmp_path / "detections.osi")

    # The most important first, though OSI has them in the order of their numbers.
    must_be_equal(read_objects(tmp_path / "detections.osi"), sort_by_priority(found), {})


def test_osi_turns_the_radial_velocity_and_the_elevation_round():
    # 10 m ahead, 10 to the left, 5 up; coming at 3 m/s along the line of sight of 15 m.
    at = np.array([10.0, 10.0, 5.0])
    velocity = -3.0 * at / 15
    found = one(x=10, y=10, z=5, vx=velocity[0], vy=velocity[1], snr=100.0, status="detection")

    (message,) = osi_messages(found)

    (radar,) = message.feature_data.radar_sensor[0].detection
    assert radar.radial_velocity == pytest.approx(3.0)  # towards the sensor
    assert radar.position.distance == pytest.approx(15.0)
    assert radar.position.azimuth == pytest.approx(np.pi / 4)  # left
    assert radar.position.elevation == pytest.approx(-np.arcsin(5 / 15))  # nose down is positive
    assert radar.snr == pytest.approx(20.0)
    # Turned about z, then about the new y, both right-handed, the x-axis points there.
    angles = [radar.position.azimuth, radar.position.elevation]
    turned = Rotation.from_euler("ZY", angles).apply([15, 0, 0])
    np.testing.assert_allclose(turned, at, atol=1e-12)


def test_radar_detections_of_others_are_read_by_their_angles(tmp_path):
    found = one(x=10, y=10, z=5, vx=-2, vy=-2, snr=100.0, status="detection")
    (message,) = osi_messages(found)
    message.ClearField("logical_detection_data")
    content = message.SerializeToString()
    path = tmp_path / "theirs.osi"
    path.write_bytes(struct.pack("<I", len(content)) + content)

    again = read_osi(path)

    for name, want in {"x": 10, "y": 10, "z": 5, "vx": -2, "vy": -2, "snr": 100}.items():
        assert again[name].item() == pytest.approx(want)


def test_the_reader_of_osi_reads_the_trace(tmp_path):
    found = tracks_of(objects_at(2, 0, 5))
    write_objects(found, tmp_path / "tracks.osi")

    trace = OSITrace(str(tmp_path / "tracks.osi"), "SensorData")
    told = list(trace)
    trace.close()

    assert [len(message.moving_object) for message in told] == [2, 0, 5]
    assert all(message.IsInitialized() and message.version.version_major == 3 for message in told)
    first = told[2].moving_object[0]
    row = found.isel(object=2)
    assert first.base.position.x == row.x.item()
    assert first.base_rmse.velocity.y == row.vy_std.item()
    assert first.header.tracking_id.value == 0
    assert (
        first.header.existence_probability
        == {"tentative": 0.5, "confirmed": 1.0}[row.status.item()]
    )


def test_what_is_not_told_is_not_set_in_osi():
    (message,) = osi_messages(one(z=np.nan, x_std=np.nan))

    moving = message.moving_object[0]
    assert not moving.base.position.HasField("z")
    assert not moving.HasField("base_rmse")


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_points_read_back_to_single_precision(tmp_path, suffix, encoding):
    found = objects_at(5, 9)

    write_points(found, tmp_path / f"objects{suffix}", encoding=encoding)

    must_be_equal(read_objects(tmp_path / f"objects{suffix}"), found, SINGLE)


@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_another_reader_of_ply_sees_the_same_points(tmp_path, encoding):
    found = objects_at(6)
    found = found.fillna(0.0)
    write_points(found, tmp_path / "objects.ply", encoding=encoding)

    cloud = trimesh.load(tmp_path / "objects.ply")

    want = np.stack([found[name].values for name in "xyz"], axis=1)
    np.testing.assert_allclose(cloud.vertices, want, rtol=1e-7)


def test_a_point_cloud_says_its_fields_and_their_places(tmp_path):
    write_objects(objects_at(3), tmp_path / "objects.pcd")

    content = (tmp_path / "objects.pcd").read_bytes()

    header, _, body = content.partition(b"DATA binary\n")
    lines = dict(line.split(" ", 1) for line in header.decode().splitlines())
    sizes = [int(size) for size in lines["SIZE"].split()]
    assert (lines["WIDTH"], lines["HEIGHT"], lines["POINTS"]) == ("3", "1", "3")
    assert lines["FIELDS"].split()[:3] == ["x", "y", "z"]
    assert lines["TYPE"].split()[:3] == ["F"] * 3 and sizes[:3] == [4] * 3  # as readers want them
    assert len(lines["FIELDS"].split()) == len(sizes) == len(lines["COUNT"].split())
    assert len(body) == 3 * sum(sizes)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_read_back_as_they_were(tmp_path, suffix):
    found = objects_at(5, 9)

    write_objects(found, tmp_path / f"objects{suffix}")

    must_be_equal(read_objects(tmp_path / f"objects{suffix}"), found, {"snr": 1e-12})


def test_a_table_is_plain_and_says_its_units(tmp_path):
    write_objects(one(x=1.5, snr=1000.0), tmp_path / "objects.csv")

    with (tmp_path / "objects.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)

    assert row["x_m"] == "1.5" and row["vx_m_per_s"] == "-5.0" and row["status"] == "confirmed"
    assert float(row["snr_db"]) == pytest.approx(30.0)
    assert row["z_m"] == ""  # not told
    assert len(row) == len(COLUMNS)


def test_a_parquet_file_has_types(tmp_path):
    write_objects(objects_at(4), tmp_path / "objects.parquet")

    path = tmp_path / "objects.parquet"
    types = duckdb.sql(f"DESCRIBE SELECT * FROM '{path}'").fetchall()

    assert {row[0]: row[1] for row in types}["frame"] == "BIGINT"
    assert {row[1] for row in types} == {"BIGINT", "VARCHAR", "DOUBLE"}
    assert duckdb.sql(f"SELECT count(*) FROM '{path}'").fetchall() == [(4,)]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_list_without_objects_is_a_valid_file(tmp_path, suffix):
    path = tmp_path / f"empty{suffix}"
    for found in (objects_at(0, 0), build_object_list({name: [] for name in COLUMNS}, [], [])):
        write_objects(found, path)
        again = read_objects(path)
        assert again.sizes["object"] == 0
        if suffix in (*CODED, ".osi"):
            assert again.sizes["cycle"] == found.sizes["cycle"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_no_signal_at_all_is_a_ratio_of_nothing(tmp_path, suffix):
    path = tmp_path / f"silent{suffix}"
    if suffix in CODED:  # the least that can be said is -50 dB
        with pytest.warns(dc.PhysicsWarning, match="1 of Snr"):
            write_objects(one(snr=0.0, status="detection"), path)
        assert read_objects(path).snr.item() == pytest.approx(1e-5)
    else:
        write_objects(one(snr=0.0, status="detection"), path)
        assert read_objects(path).snr.item() == 0.0


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_names_may_hold_what_means_something_elsewhere(tmp_path, suffix):
    path = tmp_path / f"it's [a] *list*?{suffix.upper()}"

    write_objects(objects_at(3), path)

    assert read_objects(path).sizes["object"] == 3
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_damaged_files_are_errors_and_never_something_else(tmp_path, suffix):
    path = tmp_path / f"objects{suffix}"
    write_objects(objects_at(6, 6), path)
    content = path.read_bytes()
    rng = np.random.default_rng(7)
    for number in range(20):
        damaged = bytearray(content[: rng.integers(len(content))] if number % 2 else content)
        for at in rng.integers(len(content), size=8 * (number % 3)):
            if at < len(damaged):
                damaged[at] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            read_objects(path)
        except DechirpError as error:
            assert error.mistakes[0].fix


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_of_something_else_is_refused(tmp_path, suffix):
    path = tmp_path / f"other{suffix}"
    path.write_text(json.dumps({"this": "is", "something": ["else"]}) + "\n")
    with pytest.raises(RecordingError, match=rf"other\{suffix}: recording:"):
        read_objects(path)
    with pytest.raises(RecordingError, match="recording:"):
        read_objects(tmp_path / f"missing{suffix}")


def test_a_table_with_other_columns_or_without_times_is_refused(tmp_path):
    path = tmp_path / "objects.csv"
    write_objects(one(), path)
    text = path.read_text()
    path.write_text(text.replace("vx_m_per_s", "vx"))
    with pytest.raises(RecordingError, match="vx_m_per_s"):
        read_objects(path)
    path.write_text(re.sub(r"^0,0.0,", "0,,", text, flags=re.M))
    with pytest.raises(RecordingError, match="a row without time_s"):
        read_objects(path)
    path.write_text(text.replace("confirmed", "lost"))
    with pytest.raises(InvalidSetting, match="status: lost"):
        read_objects(path)


@pytest.mark.parametrize("path", ["objects", "objects.txt", ".csv", "", None, 7])
def test_an_unknown_suffix_is_refused_with_those_that_are_known(path):
    for call in (
        lambda: write_objects(objects_at(1), path),
        lambda: read_objects(path),
        lambda: check_output_path(path),
    ):
        with pytest.raises(InvalidSetting, match=r"path: .*; expected"):
            call()
    with pytest.raises(InvalidSetting, match=r"\.blf, \.asc, \.log, \.osi, \.pcd, \.ply, \.csv, "):
        read_objects("objects.txt")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_cannot_be_written_leaves_what_was_there(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"objects{suffix}"
    path.write_text("mine")
    with pytest.raises(InvalidSetting):
        write_objects(one(status="nowhere"), path)
    with pytest.raises(InvalidSetting, match="not writable"):
        write_objects(one(), tmp_path / "no folder" / f"objects{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    for call in (lambda at: write_objects(one(), at), check_output_path):
        with pytest.raises(InvalidSetting, match="not writable"):
            call(tmp_path / f"folder{suffix}")

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(InvalidSetting, match="No space left"):
        write_objects(one(), path)

    monkeypatch.undo()
    check_output_path(path)
    assert path.read_text() == "mine"
    assert {file.name for file in tmp_path.iterdir()} == {path.name, f"folder{suffix}"}


@pytest.mark.parametrize(
    ("suffix", "library"),
    [(".blf", "cantools"), (".log", "can.io.canutils"), (".osi", "osi3.osi_sensordata_pb2")],
)
def test_a_missing_library_is_named_with_the_extra_that_has_it(
    tmp_path, monkeypatch, suffix, library
):
    monkeypatch.setitem(sys.modules, library, None)

    for call in (lambda at: write_objects(one(), at), check_output_path):
        with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
            call(tmp_path / f"objects{suffix}")

    assert not any(tmp_path.iterdir())


def test_points_need_no_library(tmp_path, monkeypatch):
    for name in ("cantools", "can", "osi3"):
        monkeypatch.setitem(sys.modules, name, None)
    write_objects(one(), tmp_path / "objects.ply")
    assert read_objects(tmp_path / "objects.ply").x.item() == 50.0


@pytest.mark.parametrize("encoding", ["text", None, 1])
def test_an_encoding_that_is_none_is_refused(tmp_path, encoding):
    with pytest.raises(InvalidSetting, match="encoding: .*; expected binary or ascii"):
        write_points(one(), tmp_path / "objects.pcd", encoding=encoding)


@pytest.mark.parametrize("call", [write_can_log, write_osi, write_points, write_table])
@pytest.mark.parametrize("path", ["objects.txt", None, "null\0.osi", "null\0.csv"])
def test_each_writer_and_reader_has_its_suffixes(call, path):
    with pytest.raises(InvalidSetting, match=r"path: .*; expected"):
        call(one(), path)


def test_numbers_beyond_all_counts_are_refused(tmp_path):
    (message,) = osi_messages(one())
    message.moving_object[0].header.tracking_id.value = 2**64 - 1
    content = message.SerializeToString()
    path = tmp_path / "theirs.osi"
    path.write_bytes(struct.pack("<I", len(content)) + content)
    with pytest.raises(InvalidSetting, match=r"objects\.number"):
        read_objects(path)

    write_objects(one(), tmp_path / "objects.csv")
    text = (tmp_path / "objects.csv").read_text()
    (tmp_path / "objects.csv").write_text(re.sub(r"^0,", "0.5,", text, flags=re.M))
    with pytest.raises(InvalidSetting, match=r"objects\.frame: 0\.5"):
        read_objects(tmp_path / "objects.csv")
