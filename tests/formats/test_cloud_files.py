"""Point clouds of radars in PCD files and in float32 files: fields, times, damaged files."""

import gzip
import struct
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import RecordingError
from dechirp.recordings.readers.pcd import read_pcd_points
from dechirp.recordings.recognise import recognise_formats
from dechirp.recordings.recording import open as open_recording
from dechirp.results.object_lists.files import write_objects
from dechirp.results.object_lists.list_columns import build_object_list
from nightly import n_examples, nightly

# The fields of a radar point of nuScenes, of mixed types.
NUSCENES = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        ("dyn_prop", "i1"),
        ("id", "<i2"),
        *((name, "<f4") for name in ("rcs", "vx", "vy")),
        ("flags", "u1"),
        ("histogram", "<u2", (3,)),
    ]
)


def draw_points(n=50, dtype=NUSCENES, seed=1):
    rng = np.random.default_rng(seed)
    points = np.zeros(n, dtype)
    for name in dtype.names:
        shape = (n, *dtype[name].shape)
        if dtype[name].base.kind == "f":
            points[name] = rng.normal(0, 20, shape)
        else:
            points[name] = rng.integers(0, 100, shape)
    points[dtype.names[0]] = abs(points[dtype.names[0]]) + 1
    return points


def compress_lzf(content):
    """Compress by hand: repeats of at least 3 bytes within 8 KiB, else literal bytes."""
    out, literals, position = bytearray(), bytearray(), 0

    def flush():
        for start in range(0, len(literals), 32):
            part = literals[start : start + 32]
            out.extend(bytes([len(part) - 1]) + part)
        literals.clear()

    while position < len(content):
        length, start = 0, -1
        for size in (264, 100, 9, 8, 5, 3):
            start = content.rfind(content[position : position + size], 0, position + size - 1)
            if position + size <= len(content) and start >= 0 and position - start <= 8192:
                length = size
                break
        if not length:
            literals.append(content[position])
            position += 1
            continue
        flush()
        distance = position - start - 1
        code = length - 2
        out.append(min(code, 7) << 5 | distance >> 8)
        if code >= 7:
            out.append(code - 7)
        out.append(distance & 255)
        position += length
    flush()
    return bytes(out)


def encode_pcd(points, encoding="binary", *, newline="\n", points_line=True):
    types = [points.dtype[name] for name in points.dtype.names]
    lines = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(points.dtype.names)}",
        f"SIZE {' '.join(str(kind.base.itemsize) for kind in types)}",
        f"TYPE {' '.join(kind.base.kind.upper() for kind in types)}",
        f"COUNT {' '.join(str(kind.shape[0] if kind.shape else 1) for kind in types)}",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        *([f"POINTS {len(points)}"] * points_line),
        f"DATA {encoding}",
    ]
    if encoding == "binary":
        body = points.tobytes()
    elif encoding == "ascii":
        rows = [
            " ".join(repr(v.item()) for v in np.hstack(point.item()).ravel()) for point in points
        ]
        body = newline.join([*rows, ""]).encode()
    else:
        content = b"".join(points[name].tobytes() for name in points.dtype.names)
        packed = compress_lzf(content)
        body = struct.pack("<II", len(packed), len(content)) + packed
    return newline.join([*lines, ""]).encode() + body


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("options", [{}, {"newline": "\r\n"}, {"points_line": False}])
def test_every_encoding_gives_every_field(tmp_path, encoding, options):
    points = draw_points()
    points["histogram"][20:] = 7  # repeats for the compression
    file = tmp_path / "cloud.pcd"
    file.write_bytes(encode_pcd(points, encoding, **options))

    decoded = read_pcd_points(file)

    assert recognise_formats(file) == ("pcd",)
    assert decoded.dtype == points.dtype
    for name in points.dtype.names:
        assert np.array_equal(decoded[name], points[name])


def test_compression_repeats_overlapping_bytes_and_long_runs(tmp_path):
    content = b"abc" * 100 + bytes(1000) + bytes(range(256)) * 3
    packed = compress_lzf(content)
    assert len(packed) < len(content) / 3
    points = np.frombuffer(content, np.dtype([("x", "u1"), ("y", "u1"), ("z", "u1"), ("a", "u1")]))
    # Field after field in the file; the compression does not know about fields.
    header = encode_pcd(points).partition(b"DATA")[0] + b"DATA binary_compressed\n"
    file = tmp_path / "cloud.pcd"
    file.write_bytes(header + struct.pack("<II", len(packed), len(content)) + packed)

    decoded = read_pcd_points(file)

    assert b"".join(decoded[name].tobytes() for name in "xyza") == content


def test_velocity_components_are_projected_on_the_line_of_sight(tmp_path):
    points = draw_points()
    file = tmp_path / "radar.pcd"
    file.write_bytes(encode_pcd(points))

    recording = open_recording(file)
    detections = recording.points

    x, y, z, vx, vy = (points[name].astype(float) for name in ("x", "y", "z", "vx", "vy"))
    assert np.allclose(detections.range, np.sqrt(x**2 + y**2 + z**2))
    assert np.allclose(detections.velocity, (vx * x + vy * y) / np.hypot(x, y))
    assert np.allclose(detections.azimuth, np.arctan2(y, x))
    assert np.array_equal(detections.rcs, points["rcs"])
    assert recording.findings[0].level == "note"
    assert "velocity from vx and vy, along the line of sight" in recording.findings[0].value
    with pytest.raises(RecordingError, match="detections without samples"):
        recording.check_has_samples()


def test_folder_is_a_frame_a_file_in_order_of_its_numbers(tmp_path):
    for number in (1, 2, 10):
        file = tmp_path / f"radar_{number}.pcd"
        file.write_bytes(encode_pcd(draw_points(number, seed=number)))

    recording = open_recording(tmp_path)

    assert (recording.format, recording.n_frames) == ("pcd", 3)
    assert np.array_equal(recording.points.frame, np.repeat([0, 1, 2], [1, 2, 10]))
    assert np.isnan(recording.points.time).all()  # unknown
    assert recording.select_frames(2, 3).points.sizes["detection"] == 10
    for number in (1, 2, 10):  # us since 1970, 75 ms apart
        name = f"RADAR_FRONT__{1532402927612460 + 75_000 * number}.pcd"
        (tmp_path / f"radar_{number}.pcd").rename(tmp_path / name)
    assert np.allclose(np.unique(open_recording(tmp_path).points.time), [0, 0.075, 0.675])


def test_organised_cloud_without_some_points_keeps_the_others(tmp_path):
    points = draw_points(6, np.dtype([(name, "<f4") for name in ("x", "y", "z", "doppler")]))
    points["x"][2] = np.nan
    file = tmp_path / "cloud.pcd"
    file.write_bytes(
        encode_pcd(points, "ascii").replace(b"WIDTH 6\nHEIGHT 1", b"WIDTH 3\nHEIGHT 2")
    )

    detections = open_recording(file).points

    assert np.allclose(detections.velocity, np.delete(points["doppler"], 2))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-1], "bytes for 50 points"),
        (lambda text: text[:150], "no line DATA"),
        (lambda text: text.replace(b"POINTS 50", b"POINTS 99999999999"), "99999999999 points"),
        (lambda text: text.replace(b"POINTS 50", b"POINTS many"), "not readable"),
        (lambda text: text.replace(b"FIELDS x y z", b"FIELDS x y z w"), "FIELDS"),
        (lambda text: text.replace(b"FIELDS x y", b"FIELDS a b"), "fields x and y"),
        (lambda text: text.replace(b"DATA binary", b"DATA zipped"), "DATA zipped"),
        (lambda text: text.replace(b"COUNT 1", b"COUNT 0"), "COUNT"),
        (lambda text: text.replace(b"TYPE F", b"TYPE X"), "TYPE X"),
    ],
)
def test_damaged_file_names_the_mistake(tmp_path, change, message):
    file = tmp_path / "cloud.pcd"
    file.write_bytes(change(encode_pcd(draw_points())))

    with pytest.raises(RecordingError, match=message) as error:
        open_recording(file)

    assert len(str(error.value)) < 700


@given(data=st.data(), encoding=st.sampled_from(["ascii", "binary", "binary_compressed"]))
@settings(max_examples=n_examples(200), deadline=None)
def test_mutated_file_gives_detections_or_error(tmp_path_factory, data, encoding):
    content = bytearray(encode_pcd(draw_points(20), encoding))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    file = tmp_path_factory.mktemp("pcd") / "cloud.pcd"
    file.write_bytes(content[: data.draw(st.integers(1, len(content)))])
    try:
        points = open_recording(file).points
    except RecordingError as error:
        assert len(str(error)) < 2000
        return
    assert np.isfinite(points.range).all()


# --- Files of float32 numbers ---------------------------------------------------------


def draw_rows(n_columns, n=200, seed=2):
    rng = np.random.default_rng(seed)
    rows = np.zeros((n, n_columns), "<f4")
    rows[:, 0] = rng.uniform(1, 80, n)
    rows[:, 1:3] = rng.normal(0, 10, (n, 2))
    if n_columns == 7:
        rows[:, 3:6] = rng.normal(0, 8, (n, 3))
    elif n_columns == 8:
        rows[:, 3:] = rng.normal(0, 8, (n, 5))
        rows[:, 4] = np.linalg.norm(rows[:, :3], axis=1)
    else:
        rows[:, 3] = rng.random(n)
        rows[:, 4:] = rng.integers(0, 32, (n, n_columns - 4))
    return rows


@pytest.mark.parametrize(
    ("n_columns", "names"),
    [
        (4, {3: "intensity"}),
        (5, {3: "intensity", 4: "ring"}),
        (7, {3: "rcs", 4: "velocity", 5: "v_r_compensated"}),
        (8, {3: "velocity", 5: "power"}),
    ],
)
def test_plain_rows_are_points(tmp_path, n_columns, names):
    for number in range(2):
        draw_rows(n_columns, 200 - number, seed=number).tofile(tmp_path / f"00{number}.bin")

    for path, n_frames in ((tmp_path / "000.bin", 1), (tmp_path, 2)):
        assert recognise_formats(path) == ("float-points",)
        recording = open_recording(path)
        rows = np.concatenate([draw_rows(n_columns, 200 - n, seed=n) for n in range(n_frames)])
        assert recording.n_frames == n_frames
        assert np.allclose(
            recording.points.range, np.linalg.norm(rows[:, :3].astype(float), axis=1)
        )
        for column, name in names.items():
            assert np.array_equal(recording.points[name], rows[:, column])


def test_other_float_and_integer_files_are_no_points(tmp_path):
    rng = np.random.default_rng(9)
    files = {
        "noise": rng.normal(0, 0.2, 4000).astype("<f4"),
        "power": rng.random(4000).astype("<f4"),
        "words": rng.integers(-2000, 2000, 8000).astype("<i2"),
        "odd": draw_rows(4).ravel()[:-1],
        "far": draw_rows(4) * np.float32(1e4),
    }
    for name, numbers in files.items():
        numbers.tofile(tmp_path / f"{name}.bin")
        assert "float-points" not in recognise_formats(tmp_path / f"{name}.bin"), name


def test_scan_that_begins_with_one_sector_is_points(tmp_path):
    # Scanners write one sector after the other: y of the first 5,000 rows has one sign.
    rows = draw_rows(4, 12_000)
    rows[:, 0] = np.random.default_rng(5).normal(0, 20, len(rows))
    rows[:, 1] = np.sort(rows[:, 1])[::-1]
    rows.tofile(tmp_path / "scan.bin")

    assert recognise_formats(tmp_path / "scan.bin") == ("float-points",)


def test_axes_name_the_numbers_of_other_rows(tmp_path):
    rows = draw_rows(6)
    rows[:, 3] = np.random.default_rng(3).normal(0, 5, len(rows))
    axes = "x,y,z,velocity,snr,label"
    for name in ("frames/0.f32", "frames/1.f32", "cloud.dat", "cloud.bin"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        rows.tofile(tmp_path / name)

    for name, n_frames in (("frames", 2), ("cloud.dat", 1), ("cloud.bin", 1)):
        recording = open_recording(tmp_path / name, axes=axes)
        assert recording.n_frames == n_frames
        points = recording.points.isel(detection=slice(0, len(rows)))
        assert np.array_equal(points.velocity, rows[:, 3])
        assert np.allclose(10 * np.log10(points.snr), rows[:, 4])
        assert np.array_equal(points.label, rows[:, 5])
        assert dc.inspect(tmp_path / name, axes=axes).formats == ("float-points",)
        # Without names, they are not taken for samples.
        with pytest.raises(RecordingError, match="--axes x,y,z,velocity,snr"):
            open_recording(tmp_path / name)
    with pytest.raises(RecordingError, match="rows of 7 float32 numbers"):
        open_recording(tmp_path / "cloud.dat", axes="x,y,z,velocity,snr,a,b")
    for axes, value in (("x,y,z,x,snr,label", "x,y,z,x"), ("x,z", "axes x,z")):
        with pytest.raises(RecordingError, match=value):
            open_recording(tmp_path / "cloud.dat", axes=axes, format="float-points")
    (tmp_path / "text.bin").write_text("1 2 3\n" * 40)
    with pytest.raises(RecordingError, match="text; expected float32 numbers"):
        open_recording(tmp_path / "text.bin", axes="x,y,z")


def test_complex_samples_do_not_look_like_points(tmp_path):
    rng = np.random.default_rng(4)
    offset_i = rng.normal([1, 0], 0.1, (4000, 2))
    for name, numbers in (("noise", rng.normal(0, 0.2, 9600)), ("offset", offset_i)):
        numbers.astype("<f4").tofile(tmp_path / f"{name}.bin")
        with pytest.raises(RecordingError, match="no settings in the recording"):
            open_recording(tmp_path / f"{name}.bin")


def test_truncated_file_of_a_folder_is_refused(tmp_path):
    draw_rows(4, 300).tofile(tmp_path / "0.bin")
    (tmp_path / "1.bin").write_bytes(draw_rows(4).tobytes()[:-3])

    with pytest.raises(RecordingError, match=r"1\.bin.*rows of 4"):
        open_recording(tmp_path)


TEXT_CLOUDS = {
    "comma.csv": ("x,y,z,velocity,power\n3,4,0,2,7\n3,-4,0,-2,7\n", 1),
    "blanks.txt": ("# x y z v_r power\n3 4 0 2 7\n3 -4 0 -2 7\n", 1),
    "decimal commas.csv": (
        "Time [s];X [m];Y [m];Z [m];Doppler [m/s];power;class\n"
        "0,5;3,0;4;0;2;7;car\n0,6;3;-4;0;-2,0;7;bike\n",
        2,
    ),
    "frames.tsv": (
        "frame\ttimestamp\tpos_x\tpos_y\tvelocity_m_s\tpower\n"
        "4\t1700000000500\t3\t4\t2\t7\n9\t1700000000600\t3\t-4\t-2\t7\n",
        2,
    ),
}


@pytest.mark.parametrize("name", TEXT_CLOUDS)
@pytest.mark.parametrize("is_compressed", [False, True])
def test_text_with_named_columns_of_points_has_detections(name, is_compressed, tmp_path):
    text, n_frames = TEXT_CLOUDS[name]
    path = tmp_path / name
    path.write_bytes(gzip.compress(text.encode()) if is_compressed else text.encode())
    recording = open_recording(path)
    points = recording.points
    assert recording.format == "point-columns" and recording.n_frames == n_frames
    np.testing.assert_allclose(points.range, 5)
    np.testing.assert_allclose(points.azimuth, np.arctan2([4, -4], 3))
    np.testing.assert_allclose(points.velocity, [2, -2])
    np.testing.assert_allclose(points.power, 7)
    np.testing.assert_array_equal(points.frame, [0, n_frames - 1])
    np.testing.assert_allclose(points.time, [0, 0.1 * (n_frames - 1)], atol=1e-6)
    assert np.isnan(points.elevation).all() == (name == "frames.tsv")


def test_damaged_bytes_of_compressed_text_are_refused(tmp_path):
    text = TEXT_CLOUDS["frames.tsv"][0] + "9\t1700000000600\t3\t-4\t-2\t7\n" * 200
    content = gzip.compress(text.encode())
    path = tmp_path / "frames.tsv"
    for start in range(10, len(content)):  # behind the header of gzip
        path.write_bytes(content[:start] + b"\xff" * 4 + content[start + 4 :])
        with pytest.raises(RecordingError):
            open_recording(path)


@pytest.mark.parametrize(
    ("heading", "row"),
    [
        ("X [cm],Y [mm],z_km,Velocity [km/h],Time [ms]", "300,4000,0,7.2,500"),
        ("x_m,y_cm,z,v_r_km_h,t_us", "3,400,0,7.2,500000"),
        ("pos_x (m),pos_y (m),vx_kmh,vy_mps,timestamp_s", "3,4,4.32,1.6,0.5"),
    ],
)
def test_units_of_headings_are_converted(heading, row, tmp_path):
    path = tmp_path / "cloud.csv"
    path.write_text(f"{heading}\n{row}\n{row}\n")
    points = open_recording(path).points
    np.testing.assert_allclose(points.range, 5)
    np.testing.assert_allclose(points.velocity, 2)
    assert set(points) >= {"frame", "time"} and (points.time == 0).all()


@pytest.mark.parametrize("heading", ["x [ft],y,z", "x,y,velocity [mph]"])
def test_unknown_unit_of_heading_is_refused(heading, tmp_path):
    path = tmp_path / "cloud.csv"
    path.write_text(f"{heading}\n1,2,3\n")
    with pytest.raises(RecordingError, match="an unknown unit of .*expected positions in m"):
        open_recording(path)


def test_folder_of_text_clouds_is_a_frame_for_each_file(tmp_path):
    for number in (10, 9):
        (tmp_path / f"cloud_{number}.csv").write_text(f"x,y,z\n{number},0,0\n{number},0,0\n")
    recording = open_recording(tmp_path)
    assert recording.n_frames == 2
    np.testing.assert_array_equal(recording.points.range, [9, 9, 10, 10])


@pytest.mark.parametrize(
    ("line", "problem"), [("1,2", "line 3: 2 columns"), ("1,2,far", "line 3: .*'far'")]
)
def test_damaged_line_of_text_cloud_is_named(line, problem, tmp_path):
    path = tmp_path / "cloud.csv"
    path.write_text(f"x,y,z\n1,2,3\n{line}\n")
    with pytest.raises(RecordingError, match=f"{problem}.*expected 3 columns"):
        open_recording(path)


@pytest.mark.parametrize("heading", ["x,y", "time,I,Q", "a,b,c"])
def test_text_without_names_of_points_is_no_cloud(heading, tmp_path):
    path = tmp_path / "table.csv"
    path.write_text(heading + "\n" + ",".join("1" * len(heading.split(","))) + "\n")
    assert "point-columns" not in recognise_formats(path)


def test_object_list_in_pcd_has_its_frames_and_ratios(tmp_path):
    objects = build_object_list(
        {
            "frame": [0, 0, 3],
            "time": [0.0, 0.0, 0.3],
            "number": [1, 2, 1],
            "status": ["confirmed", "tentative", "confirmed"],
            "x": [10.0, 20.0, 30.0],
            "y": [1.0, -2.0, 3.0],
            "vx": [-5.0, 0.0, 5.0],
            "vy": [0.0, 0.0, 0.0],
            "snr": [100.0, 10.0, 1.0],
        },
        [0, 3],
        [0.0, 0.3],
    )
    write_objects(objects, tmp_path / "objects.pcd")
    recording = open_recording(tmp_path / "objects.pcd")
    points = recording.points
    assert recording.n_frames == 2
    np.testing.assert_array_equal(points.frame, [0, 0, 1])
    np.testing.assert_allclose(points.time, [0, 0, 0.3])
    np.testing.assert_allclose(points.range, np.hypot(objects.x, objects.y), rtol=1e-6)
    np.testing.assert_allclose(points.velocity * points.range, objects.vx * objects.x, rtol=1e-6)
    np.testing.assert_allclose(points.snr, objects.snr, rtol=1e-6)
    assert np.isnan(points.elevation).all()


@nightly
def test_recognition_of_a_large_file_reads_little_of_it(tmp_path):
    file = tmp_path / "large.bin"
    with file.open("wb") as out:
        out.truncate(2**28)
    script = """
import resource, sys
from pathlib import Path
from dechirp.recordings.recognise import recognise_formats
peaks = []
for name in sys.argv[1:]:
    recognise_formats(Path(name))
    peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
print(peaks[1] - peaks[0])
"""
    small = tmp_path / "small.bin"
    small.write_bytes(bytes(3200))
    process = subprocess.run(
        [sys.executable, "-c", script, small, file], capture_output=True, text=True, check=True
    )
    assert int(process.stdout) < 2**15  # 32 MB of 256 MB, in KiB
