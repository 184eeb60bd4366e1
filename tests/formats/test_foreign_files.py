"""Well-known files that are no recordings: they are named, with the step that gives a recording."""

import io
import json
import pickle
import sqlite3
import tarfile
import zipfile
from contextlib import closing

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.core.errors import RecordingError
from dechirp.recordings.foreign_files import identify_foreign_file, is_text
from dechirp.recordings.recording import open as open_recording
from dechirp.recordings.settings.read import read_radar
from dechirp.results.object_lists.list_columns import COLUMNS, build_object_list
from nightly import nightly

LFS_POINTER = (
    b"version https://git-lfs.github.com/spec/v1\noid sha256:"
    + b"4d7a214614ab2935c943f9e0ff69d22eadbb8f32b1258daaa5e2ca24d17e2393\nsize 2525184\n"
)


def write_zip(*names):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in names:
            archive.writestr(name, b"12345678")
    return content.getvalue()


def write_tar():
    content = io.BytesIO()
    with tarfile.open(fileobj=content, mode="w") as archive:
        archive.addfile(tarfile.TarInfo("adc_data.bin"))
    return content.getvalue()


def write_database(path):
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE other (x)")
    return path.read_bytes()


def masked_crc32c(content):
    """Return the checksum of TFRecord, by division of polynomials over GF(2), bit by bit."""
    generator = 0x11EDC6F41  # Castagnoli, highest power first
    bits = [byte >> n & 1 for byte in content for n in range(8)] + [0] * 32
    bits[:32] = [1 - bit for bit in bits[:32]]
    remainder = 0
    for bit in bits:
        remainder = remainder << 1 | bit
        remainder ^= generator if remainder >> 32 else 0
    crc = int(f"{remainder:032b}"[::-1], 2) ^ 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + 0xA282EAD8 & 0xFFFFFFFF).to_bytes(4, "little")


KINDS = {
    "lfs": (LFS_POINTER, "Git LFS to a file of 2525184 bytes", "git lfs pull"),
    "annex": (b"/annex/objects/SHA256E-s9--ab.bin\n", "git-annex", "git annex get"),
    "dvc": (b"outs:\n- md5: a304afb96060\n  size: 9\n", "DVC", "dvc pull"),
    "html": (b"\n<!DOCTYPE html>\n<html><title>404</title>", "web page", "download the file"),
    "html table": (b"<html>\n1,2,3\n4,5,6\n", "web page", "download the file"),
    "s3": (b'<?xml version="1.0"?>\n<Error><Code>AccessDenied', "error message", "download"),
    "dbc": (
        b'VERSION ""\n\nNS_ :\n\tCM_\n\nBO_ 1 Radar: 8 ECU\n',
        "CAN database",
        "recording itself",
    ),
    "osi": (b"\xf3\1\0\0\x0a\6\x08\3\x10\5\x18\0" + bytes(500), "ASAM OSI", "read_objects"),
    "commonroad": (
        b"<?xml version='1.0' encoding='UTF-8'?>\n<commonRoad timeStepSize='0.1'>",
        "true traffic",
        "dechirp run FILE --ego",
    ),
    "trajectories": (
        b"time,id,class,x,y,heading,length,width,height\n0,1,car,0,0,0,4,2,1.5\n",
        "true traffic",
        "open_traffic",
    ),
    "highd": (
        b"frame,id,x,y,width,height,xVelocity,yVelocity\n1,1,362.26,21.68,4.85,2.12,40.85,0\n",
        "true traffic",
        "open_traffic",
    ),
    "zip": (write_zip("adc_data_0.bin", "a.cfg"), "with adc_data_0.bin, a.cfg", "unpack"),
    "zip cut": (write_zip("adc_data_0.bin")[:-30], "a ZIP archive, damaged", "copy the file"),
    "xlsx": (write_zip("[Content_Types].xml", "xl/a.xml"), "office program", "as CSV"),
    "docx cut": (
        write_zip("[Content_Types].xml", "word/document.xml")[:-30],
        "a document of an office program, damaged or cut short",
        "copy the file again",
    ),
    "npz cut": (write_zip("cube.npy")[:-30], "not readable", "copy the file again"),
    "tar": (write_tar(), "tar archive", "tar -xf"),
    "7z": (b"7z\xbc\xaf\x27\x1c\0\4" + bytes(90), "7-Zip", "unpack"),
    "gzip": (b"\x1f\x8b\x08\0" + bytes(90), "gzip", "gunzip"),
    "jpeg": (b"\xff\xd8\xff\xe0\0\x10JFIF\0" + bytes(90), "JPEG", "the recording"),
    "pdf": (b"%PDF-1.7\n\xe2\xe3\xcf\xd3", "PDF", "the recording"),
    "png": (b"\x89PNG\r\n\x1a\n" + bytes(90), "PNG", "the recording"),
    "mp4": (b"\0\0\0\x18ftypmp42" + bytes(90), "MP4", "the recording"),
    "avi": (b"RIFF\0\1\0\0AVI LIST" + bytes(90), "AVI", "the recording"),
    "mp3": (b"ID3\4" + bytes(90), "MP3", "WAV"),
    "mp3 bare": (4 * (b"\xff\xfb\x90\x64" + bytes(range(7, 180)) + bytes(240)), "MP3", "WAV"),
    "iso": (bytes(32768) + b"\1CD001\1\0" + bytes(2040), "ISO 9660", "mount"),
    "nifti 1": (b"\x5c\1\0\0" + bytes(340) + b"n+1\0" + bytes(90), "NIfTI", "the recording"),
    "nifti 2": (b"\x1c\2\0\0n+2\0\r\n\x1a\n" + bytes(600), "NIfTI", "the recording"),
    "tfrecord": (
        (269).to_bytes(8, "little") + masked_crc32c((269).to_bytes(8, "little")) + bytes(273),
        "TFRecord",
        ".npy",
    ),
    "onnx": (b"\x08\7\x12\7pytorch\x1a\0051.9.0:\x20" + bytes(90), "ONNX", "the recording"),
    "las": (b"LASF" + bytes(300), "LAS", "radar"),
    "netcdf": (b"CDF\1" + bytes(90), "netCDF", "nccopy"),
    "asc": (
        b"date Sat Nov 28 06:14:08.414 2026\nbase hex  timestamps absolute\n",
        "(ASC)",
        "the DBC",
    ),
    "candump": (
        b"(0.003455) can0 300##10000070000\n(0.1) can0 301#00\n",
        "candump",
        "dechirp.track",
    ),
    "blf": (b"LOGG" + bytes(90), "(BLF)", "objects_to_detections"),
    "parquet": (b"PAR1" + bytes(90), "Parquet", ".npy"),
    "object csv": (
        b"frame,time_s,number,status,x_m,y_m,z_m\n0,0.0,1,confirmed,1.0,2.0,\n",
        "object list (CSV)",
        "read_objects",
    ),
    "object parquet": (b"PAR1" + bytes(90), "Parquet", "objects_to_detections and dechirp.track"),
    "ply": (b"ply\nformat ascii 1.0\n", "PLY", "objects_to_detections and dechirp.track"),
    "pickle 2": (pickle.dumps({"radar": [1.0, 2.0]}, 2), "pickle", "numpy.save"),
    "pickle 5": (pickle.dumps(np.arange(9.0), 5), "pickle", "numpy.save"),
    "utf-16": ("1,2,3\r\n4,5,6\r\n".encode("utf-16"), "UTF-16", "UTF-8"),
    "dicom": (bytes(128) + b"DICM" + bytes(90), "DICOM", "the recording"),
    "hdf4": (b"\x0e\3\x13\1" + bytes(90), "HDF4", "h4toh5"),
    "mach-o": (b"\xcf\xfa\xed\xfe" + bytes(90), "program", "the recording"),
    "gtrack": (b"6\n40\nNUM=2\n35.6,1.03,1.69\n34.6,1.01,1.74\n", "group tracker", "the recording"),
    "vectors": (
        np.array([5, *(128 << np.arange(5)), 7, 9], "<u4").tobytes() + bytes(90),
        "mmwavelib",
        "the recording",
    ),
    "windows": (np.array([32767] * 128 + [-32768, 0] * 64, "<i2").tobytes(), "mmwavelib", ".npy"),
    "few bytes": (b"\1\0\0\0\x0d\0", "only 6 bytes", "--format"),
    "empty": (b"", "an empty file", "copy it again"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_foreign_file_is_named_with_its_fix(tmp_path, kind):
    content, description, fix = KINDS[kind]
    file = tmp_path / "capture.bin"
    file.write_bytes(content)

    with pytest.raises(RecordingError) as error:
        open_recording(file)

    (mistake,) = error.value.mistakes
    assert description in mistake.value
    assert fix in mistake.fix
    assert mistake.file == str(file)
    assert len(str(error.value)) < 400 + len(str(file))


@pytest.mark.parametrize(
    ("suffix", "function"), [(".osi", "read_objects"), (".pcd", "group_tracking.track_groups")]
)
def test_run_names_the_function_that_reads_objects(suffix, function, tmp_path, capsys):
    empty = np.zeros(1)
    columns = dict.fromkeys(COLUMNS, empty) | {"number": np.ones(1), "status": ["confirmed"]}
    path = tmp_path / f"objects{suffix}"
    dc.object_lists.write_objects(build_object_list(columns, [0], [0.0]), path)
    with pytest.raises(SystemExit):
        main(["run", str(path)])
    assert function in capsys.readouterr().err


def test_database_without_messages_is_named(tmp_path):
    file = tmp_path / "notes.db3"
    write_database(file)

    with pytest.raises(RecordingError, match="SQLite database"):
        open_recording(file)


def test_link_to_absent_annexed_file_is_named(tmp_path):
    link = tmp_path / "capture.bin"
    link.symlink_to(".git/annex/objects/aa/bb/SHA256E-s9--ab.bin")

    with pytest.raises(RecordingError, match="git annex get"):
        open_recording(link)


def test_pointer_inside_recording_folder_and_as_settings_is_named(tmp_path):
    shape = {
        "rx_antennas": [1],
        "start_frequency_Hz": 60.5e9,
        "end_frequency_Hz": 61.5e9,
        "num_chirps_per_frame": 64,
        "num_samples_per_chirp": 128,
        "chirp_repetition_time_s": 391.55e-6,
        "frame_repetition_time_s": 100e-3,
        "sample_rate_Hz": 2e6,
    }
    config = json.dumps({"device_config": {"fmcw_single_shape": shape}})
    (tmp_path / "config.json").write_text(config)
    (tmp_path / "radar.npy").write_bytes(LFS_POINTER)
    (tmp_path / "radar.cfg").write_bytes(LFS_POINTER)

    with pytest.raises(RecordingError, match=r"radar\.npy.*git lfs pull"):
        open_recording(tmp_path)
    with pytest.raises(RecordingError, match=r"radar\.cfg.*git lfs pull"):
        read_radar(tmp_path / "radar.cfg")


def test_pointer_in_place_of_the_settings_beside_a_recording_is_named(tmp_path):
    np.arange(4096, dtype="<i2").tofile(tmp_path / "adc_data.bin")
    (tmp_path / "profile.cfg").write_bytes(LFS_POINTER)

    with pytest.raises(RecordingError, match=r"profile\.cfg.*git lfs pull"):
        open_recording(tmp_path / "adc_data.bin", format="dca1000")
    with pytest.raises(RecordingError, match=r"profile\.cfg.*git lfs pull"):
        open_recording(tmp_path)


def test_text_with_symbols_is_text_and_samples_are_not():
    assert is_text("time in µs; I; Q\n1,5; 2; 3\n".encode())
    assert is_text("°".encode()[:1] and "angle in °".encode()[:-1])  # cut within a letter
    # Samples of two chirps of 128: text has no control characters, of which each word has two
    # bytes; 512 bytes without one have a probability below 0.9^512.
    rng = np.random.default_rng(7)
    for width in (3, 30, 3000):
        for _ in range(1000):
            head = np.round(width * rng.standard_normal(256)).astype("<i2").tobytes()
            assert not is_text(head)


@nightly
def test_random_samples_are_not_taken_for_foreign_files():
    # Of 65,536 first words, each signature of four bytes or more is met once in 65,536 squared;
    # shorter ones need further evidence. 20,000 heads: less than one chance in 10^6 for three.
    rng = np.random.default_rng(8)
    n_foreign = sum(
        identify_foreign_file(rng.integers(0, 256, 512, np.uint8).tobytes()) is not None
        for _ in range(20_000)
    )
    assert n_foreign <= 2
