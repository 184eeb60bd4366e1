"""Object list files: OSI, point clouds, tables and CAN logs, chosen by suffix."""

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
from dechirp.results.object_lists.files import (
    check_object_list_path_writable,
    read_objects,
    write_objects,
)
from dechirp.results.object_lists.list_columns import COLUMNS, build_object_list
from dechirp.results.object_lists.osi import osi_messages, read_osi, write_osi
from dechirp.results.object_lists.point_cloud_files import write_points
from dechirp.results.object_lists.priority import sort_by_priority
from dechirp.results.object_lists.tables import write_object_table
from nightly import nightly_except
from sample_object_lists import check_object_lists_agree, random_object_list, single_object_list

SINGLE_PRECISION = {"relative": 2.0**-24, "snr": 1e-6}
CAN_LOG_SUFFIXES = (".blf", ".asc", ".log")
SUFFIXES = (*CAN_LOG_SUFFIXES, ".osi", ".pcd", ".ply", ".csv", ".parquet")


def convert_to_tracks(objects):
    """Mark all objects as tracks, and remove their SNR, which OSI tracks do not contain."""
    status = np.where(objects.status == "detection", "tentative", objects.status)
    return objects.assign(status=("object", status), snr=("object", np.full(len(status), np.nan)))


def test_osi_tracks_read_back_exactly(tmp_path):
    objects = convert_to_tracks(random_object_list(7, 0, 3))
    objects["number"] = objects.number[::-1]

    write_objects(objects, tmp_path / "tracks.osi")
    result = read_objects(tmp_path / "tracks.osi")

    check_object_lists_agree(result, sort_by_priority(objects), {})
    assert result.cycle_frame.values.tolist() == [0, 1, 2]
    assert result.cycle_time.values.tolist() == pytest.approx([0.0, 0.05, 0.1], abs=1e-9)


def test_osi_detections_read_back_exactly(tmp_path):
    objects = random_object_list(7, 3)
    unknown = np.full(10, np.nan)
    objects = objects.assign(
        status=("object", ["detection"] * 10), length=("object", unknown), width=("object", unknown)
    )

    write_objects(objects, tmp_path / "detections.osi")

    # The reader sorts by priority; OSI stores detections in the order of their numbers.
    check_object_lists_agree(
        read_objects(tmp_path / "detections.osi"), sort_by_priority(objects), {}
    )


def test_osi_inverts_signs_of_radial_velocity_and_elevation():
    # 10 m ahead, 10 m left, 5 m up; approaching at 3 m/s on a line of sight of 15 m.
    position_m = np.array([10.0, 10.0, 5.0])
    velocity = -3.0 * position_m / 15
    objects = single_object_list(
        x=10, y=10, z=5, vx=velocity[0], vy=velocity[1], snr=100.0, status="detection"
    )

    (message,) = osi_messages(objects)

    (detection,) = message.feature_data.radar_sensor[0].detection
    assert detection.radial_velocity == pytest.approx(3.0)  # towards the sensor
    assert detection.position.distance == pytest.approx(15.0)
    assert detection.position.azimuth == pytest.approx(np.pi / 4)  # left
    # Nose down is positive.
    assert detection.position.elevation == pytest.approx(-np.arcsin(5 / 15))
    assert detection.snr == pytest.approx(20.0)
    # Rotation about z, then about the new y, both right-handed, points the x-axis there.
    angles = [detection.position.azimuth, detection.position.elevation]
    rotated_m = Rotation.from_euler("ZY", angles).apply([15, 0, 0])
    np.testing.assert_allclose(rotated_m, position_m, atol=1e-12)


def test_foreign_osi_detections_are_read_from_angles(tmp_path):
    objects = single_object_list(x=10, y=10, z=5, vx=-2, vy=-2, snr=100.0, status="detection")
    (message,) = osi_messages(objects)
    message.ClearField("logical_detection_data")
    content = message.SerializeToString()
    path = tmp_path / "foreign.osi"
    path.write_bytes(struct.pack("<I", len(content)) + content)

    result = read_osi(path)

    for name, expected in {"x": 10, "y": 10, "z": 5, "vx": -2, "vy": -2, "snr": 100}.items():
        assert result[name].item() == pytest.approx(expected)


def test_reference_osi_reader_reads_trace(tmp_path):
    objects = convert_to_tracks(random_object_list(2, 0, 5))
    write_objects(objects, tmp_path / "tracks.osi")

    trace = OSITrace(str(tmp_path / "tracks.osi"), "SensorData")
    messages = list(trace)
    trace.close()

    assert [len(message.moving_object) for message in messages] == [2, 0, 5]
    assert all(
        message.IsInitialized() and message.version.version_major == 3 for message in messages
    )
    first = messages[2].moving_object[0]
    row = objects.isel(object=2)
    assert first.base.position.x == row.x.item()
    assert first.base_rmse.velocity.y == row.vy_std.item()
    assert first.header.tracking_id.value == 0
    assert (
        first.header.existence_probability
        == {"tentative": 0.5, "confirmed": 1.0}[row.status.item()]
    )


def test_unknown_values_are_unset_in_osi():
    (message,) = osi_messages(single_object_list(z=np.nan, x_std=np.nan))

    moving = message.moving_object[0]
    assert not moving.base.position.HasField("z")
    assert not moving.HasField("base_rmse")


@pytest.mark.parametrize("suffix", [".pcd", ".ply"])
@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_point_clouds_read_back_in_single_precision(tmp_path, suffix, encoding):
    objects = random_object_list(5, 9)

    write_points(objects, tmp_path / f"objects{suffix}", encoding=encoding)

    check_object_lists_agree(read_objects(tmp_path / f"objects{suffix}"), objects, SINGLE_PRECISION)


@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_trimesh_reads_same_ply_points(tmp_path, encoding):
    objects = random_object_list(6)
    objects = objects.fillna(0.0)
    write_points(objects, tmp_path / "objects.ply", encoding=encoding)

    cloud = trimesh.load(tmp_path / "objects.ply")

    expected = np.stack([objects[name].values for name in "xyz"], axis=1)
    np.testing.assert_allclose(cloud.vertices, expected, rtol=1e-7)


def test_pcd_header_describes_fields(tmp_path):
    write_objects(random_object_list(3), tmp_path / "objects.pcd")

    content = (tmp_path / "objects.pcd").read_bytes()

    header, _, body = content.partition(b"DATA binary\n")
    lines = dict(line.split(" ", 1) for line in header.decode().splitlines())
    sizes = [int(size) for size in lines["SIZE"].split()]
    assert (lines["WIDTH"], lines["HEIGHT"], lines["POINTS"]) == ("3", "1", "3")
    assert lines["FIELDS"].split()[:3] == ["x", "y", "z"]
    assert lines["TYPE"].split()[:3] == ["F"] * 3 and sizes[:3] == [4] * 3  # for common readers
    assert len(lines["FIELDS"].split()) == len(sizes) == len(lines["COUNT"].split())
    assert len(body) == 3 * sum(sizes)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_read_back_equal(tmp_path, suffix):
    objects = random_object_list(5, 9)

    write_objects(objects, tmp_path / f"objects{suffix}")

    check_object_lists_agree(read_objects(tmp_path / f"objects{suffix}"), objects, {"snr": 1e-12})


def test_csv_columns_have_units(tmp_path):
    write_objects(single_object_list(x=1.5, snr=1000.0), tmp_path / "objects.csv")

    with (tmp_path / "objects.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)

    assert row["x_m"] == "1.5" and row["vx_m_per_s"] == "-5.0" and row["status"] == "confirmed"
    assert float(row["snr_db"]) == pytest.approx(30.0)
    assert row["z_m"] == ""  # unknown
    assert len(row) == len(COLUMNS)


def test_parquet_needs_its_extra_and_csv_does_not(tmp_path, monkeypatch):
    objects = random_object_list(5, 9)
    write_objects(objects, tmp_path / "objects.parquet")
    monkeypatch.setitem(sys.modules, "duckdb", None)

    write_objects(objects, tmp_path / "objects.csv")
    check_object_lists_agree(read_objects(tmp_path / "objects.csv"), objects, {"snr": 1e-12})
    for call in (
        lambda: read_objects(tmp_path / "objects.parquet"),
        lambda: write_objects(objects, tmp_path / "others.parquet"),
        lambda: check_object_list_path_writable(tmp_path / "others.parquet"),
    ):
        with pytest.raises(InvalidSetting, match=r"run pip install 'dechirp\[parquet\]'"):
            call()
    assert {file.name for file in tmp_path.iterdir()} == {"objects.csv", "objects.parquet"}


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ((b"\n0,", b"\n0,0,"), "row 1 with 17 cells for 16 columns"),
        ((b"confirmed,", b""), "row 1 with 15 cells for 16 columns"),
        ((b"\n0,", b"\nfirst,"), "frame: could not convert string to float: 'first'"),
        ((b"confirmed", b"\xff"), "can't decode byte 0xff"),
        ((b"confirmed", b'"confirmed'), "unexpected end of data"),
    ],
)
def test_damaged_csv_rows_are_described(tmp_path, change, problem):
    path = tmp_path / "objects.csv"
    write_objects(single_object_list(), path)
    path.write_bytes(path.read_bytes().replace(*change))

    with pytest.raises(RecordingError, match=re.escape(problem)):
        read_objects(path)


def test_csv_from_spreadsheet_is_read(tmp_path):
    path = tmp_path / "objects.csv"
    objects = random_object_list(3)
    write_objects(objects, path)
    header, rows = path.read_text(encoding="utf-8").split("\n", 1)
    text = "\ufeff" + header.upper() + "\n" + rows + "\n"  # byte-order mark and an empty line
    path.write_bytes(text.replace("\n", "\r\n").encode())

    check_object_lists_agree(read_objects(path), objects, {"snr": 1e-12})


def test_parquet_columns_have_types(tmp_path):
    write_objects(random_object_list(4), tmp_path / "objects.parquet")

    path = tmp_path / "objects.parquet"
    types = duckdb.sql(f"DESCRIBE SELECT * FROM '{path}'").fetchall()

    assert {row[0]: row[1] for row in types}["frame"] == "BIGINT"
    assert {row[1] for row in types} == {"BIGINT", "VARCHAR", "DOUBLE"}
    assert duckdb.sql(f"SELECT count(*) FROM '{path}'").fetchall() == [(4,)]


@pytest.mark.parametrize("suffix", nightly_except((".blf", ".osi", ".csv"), SUFFIXES))
def test_empty_list_is_valid_file(tmp_path, suffix):
    path = tmp_path / f"empty{suffix}"
    for objects in (
        random_object_list(0, 0),
        build_object_list({name: [] for name in COLUMNS}, [], []),
    ):
        write_objects(objects, path)
        result = read_objects(path)
        assert result.sizes["object"] == 0
        if suffix in (*CAN_LOG_SUFFIXES, ".osi"):
            assert result.sizes["cycle"] == objects.sizes["cycle"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_zero_snr_reads_back_as_zero_or_smallest_code(tmp_path, suffix):
    path = tmp_path / f"silent{suffix}"
    if suffix in CAN_LOG_SUFFIXES:  # the smallest code is -50 dB
        with pytest.warns(dc.PhysicsWarning, match="1 of Snr"):
            write_objects(single_object_list(snr=0.0, status="detection"), path)
        assert read_objects(path).snr.item() == pytest.approx(1e-5)
    else:
        write_objects(single_object_list(snr=0.0, status="detection"), path)
        assert read_objects(path).snr.item() == 0.0


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_file_names_with_quotes_and_wildcards_work(tmp_path, suffix):
    path = tmp_path / f"it's [a] *list*?{suffix.upper()}"

    write_objects(random_object_list(3), path)

    assert read_objects(path).sizes["object"] == 3
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", nightly_except(3, SUFFIXES))
@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_damaged_files_raise_only_package_errors(tmp_path, suffix):
    path = tmp_path / f"objects{suffix}"
    write_objects(random_object_list(6, 6), path)
    content = path.read_bytes()
    rng = np.random.default_rng(7)
    for number in range(20):
        damaged_content = bytearray(
            content[: rng.integers(len(content))] if number % 2 else content
        )
        for position in rng.integers(len(content), size=8 * (number % 3)):
            if position < len(damaged_content):
                damaged_content[position] = rng.integers(256)
        path.write_bytes(damaged_content)
        try:
            read_objects(path)
        except DechirpError as error:
            assert error.mistakes[0].fix


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_rejects_foreign_and_missing_files(tmp_path, suffix):
    path = tmp_path / f"other{suffix}"
    path.write_text(json.dumps({"this": "is", "something": ["else"]}) + "\n")
    with pytest.raises(RecordingError, match=rf"other\{suffix}: recording:"):
        read_objects(path)
    with pytest.raises(RecordingError, match="recording:"):
        read_objects(tmp_path / f"missing{suffix}")


def test_rejects_tables_with_wrong_columns_times_or_status(tmp_path):
    path = tmp_path / "objects.csv"
    write_objects(single_object_list(), path)
    table = path.read_text()
    path.write_text(table.replace("vx_m_per_s", "vx"))
    with pytest.raises(RecordingError, match="vx_m_per_s"):
        read_objects(path)
    path.write_text(re.sub(r"^0,0.0,", "0,,", table, flags=re.M))
    with pytest.raises(RecordingError, match="a row without time_s"):
        read_objects(path)
    path.write_text(table.replace("confirmed", "lost"))
    with pytest.raises(InvalidSetting, match="status: lost"):
        read_objects(path)


@pytest.mark.parametrize("path", ["objects", "objects.txt", ".csv", "", None, 7])
def test_rejects_unknown_suffix_and_lists_known_ones(path):
    for call in (
        lambda: write_objects(random_object_list(1), path),
        lambda: read_objects(path),
        lambda: check_object_list_path_writable(path),
    ):
        with pytest.raises(InvalidSetting, match=r"path: .*; expected"):
            call()
    with pytest.raises(InvalidSetting, match=r"\.blf, \.asc, \.log, \.osi, \.pcd, \.ply, \.csv, "):
        read_objects("objects.txt")


@pytest.mark.parametrize("suffix", nightly_except(3, SUFFIXES))
def test_failed_write_keeps_existing_file(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"objects{suffix}"
    path.write_text("mine")
    with pytest.raises(InvalidSetting):
        write_objects(single_object_list(status="nowhere"), path)
    with pytest.raises(InvalidSetting, match="not writable"):
        write_objects(single_object_list(), tmp_path / "no folder" / f"objects{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    for call in (
        lambda destination: write_objects(single_object_list(), destination),
        check_object_list_path_writable,
    ):
        with pytest.raises(InvalidSetting, match="not writable"):
            call(tmp_path / f"folder{suffix}")

    def raise_disk_full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", raise_disk_full)
    with pytest.raises(InvalidSetting, match="No space left"):
        write_objects(single_object_list(), path)

    monkeypatch.undo()
    check_object_list_path_writable(path)
    assert path.read_text() == "mine"
    assert {file.name for file in tmp_path.iterdir()} == {path.name, f"folder{suffix}"}


@pytest.mark.parametrize(
    ("suffix", "library"),
    [(".blf", "cantools"), (".log", "can.io.canutils"), (".osi", "osi3.osi_sensordata_pb2")],
)
def test_missing_library_is_reported_with_its_extra(tmp_path, monkeypatch, suffix, library):
    monkeypatch.setitem(sys.modules, library, None)

    for call in (
        lambda destination: write_objects(single_object_list(), destination),
        check_object_list_path_writable,
    ):
        with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
            call(tmp_path / f"objects{suffix}")

    assert not any(tmp_path.iterdir())


def test_point_clouds_need_no_extra_library(tmp_path, monkeypatch):
    for name in ("cantools", "can", "osi3"):
        monkeypatch.setitem(sys.modules, name, None)
    write_objects(single_object_list(), tmp_path / "objects.ply")
    assert read_objects(tmp_path / "objects.ply").x.item() == 50.0


@pytest.mark.parametrize("encoding", ["text", None, 1])
def test_rejects_unknown_encoding(tmp_path, encoding):
    with pytest.raises(InvalidSetting, match="encoding: .*; expected binary or ascii"):
        write_points(single_object_list(), tmp_path / "objects.pcd", encoding=encoding)


@pytest.mark.parametrize("call", [write_can_log, write_osi, write_points, write_object_table])
@pytest.mark.parametrize("path", ["objects.txt", None, "null\0.osi", "null\0.csv"])
def test_writers_reject_foreign_suffixes(call, path):
    with pytest.raises(InvalidSetting, match=r"path: .*; expected"):
        call(single_object_list(), path)


def test_rejects_numbers_beyond_64_bits_and_fractional_frames(tmp_path):
    (message,) = osi_messages(single_object_list())
    message.moving_object[0].header.tracking_id.value = 2**64 - 1
    content = message.SerializeToString()
    path = tmp_path / "foreign.osi"
    path.write_bytes(struct.pack("<I", len(content)) + content)
    with pytest.raises(InvalidSetting, match=r"objects\.number"):
        read_objects(path)

    write_objects(single_object_list(), tmp_path / "objects.csv")
    text = (tmp_path / "objects.csv").read_text()
    (tmp_path / "objects.csv").write_text(re.sub(r"^0,", "0.5,", text, flags=re.M))
    with pytest.raises(InvalidSetting, match=r"objects\.frame: 0\.5"):
        read_objects(tmp_path / "objects.csv")
