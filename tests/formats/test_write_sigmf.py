"""SigMF recordings: native round trips, foreign files read with a radar, and damaged files."""

import gzip
import hashlib
import json
import lzma
import os
import shutil
import sys
import tarfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sigmf
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, InvalidSetting, RecordingError
from dechirp.simulation.adc_codes import extract_adc_codes
from formats.corruption import assert_cube_or_error, corrupted_bytes
from formats.native_recordings import (
    EVERY_RECORDING,
    assert_full_disk_keeps_files,
    assert_recordings_equal,
    assert_write_preserves_recording,
    make_complex_code_recording,
    make_complex_recording,
    make_gap_recording,
    make_radar,
    make_real_code_recording,
    make_real_recording,
    make_table_recording,
    make_tdm_recording,
    open_real_capture,
)
from nightly import n_examples, nightly, nightly_except

META, DATA = "x.sigmf-meta", "x.sigmf-data"


@EVERY_RECORDING
def test_round_trip_is_bit_exact_by_both_file_names(tmp_path, make_recording):
    recording = make_recording()
    assert dc.write(recording, tmp_path / META) == (tmp_path / META, tmp_path / DATA)
    for name in (META, DATA):
        copy = dc.open(tmp_path / name)
        assert copy.format == "sigmf"
        assert_recordings_equal(copy, recording)


@pytest.mark.parametrize(
    ("make_recording", "datatype"),
    [
        (make_complex_recording, "cf32_le"),
        (make_real_recording, "rf32_le"),
        (make_complex_code_recording, "ci16_le"),
        (make_real_code_recording, "ri16_le"),
    ],
)
def test_receivers_are_interleaved_channels(tmp_path, make_recording, datatype):
    recording = make_recording()
    dc.write(recording, tmp_path / META)
    global_fields = json.loads((tmp_path / META).read_text())["global"]
    assert global_fields["core:datatype"] == datatype
    assert global_fields["core:num_channels"] == 2

    kinds = {"cf32_le": "<c8", "rf32_le": "<f4", "ci16_le": "<i2", "ri16_le": "<i2"}
    file_numbers = np.fromfile(tmp_path / DATA, kinds[datatype])
    has_codes = "scale" in recording.cube.attrs
    numbers = (extract_adc_codes(recording.cube) if has_codes else recording.cube).values
    assert np.array_equal(file_numbers, numbers.swapaxes(2, 3).reshape(-1))


@EVERY_RECORDING
def test_sigmf_library_validates_and_reads_samples(tmp_path, make_recording):
    recording = make_recording()
    dc.write(recording, tmp_path / META)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        file = sigmf.fromfile(str(tmp_path / META), autoscale=False)  # verifies the checksum
        file.validate()
        samples = file.read_samples()
    sizes = recording.cube.sizes
    shape = [sizes[name] for name in ("frame", "chirp", "sample", "rx")]
    scale = np.float32(recording.contents.scale or 1)
    receivers_first = samples.reshape(shape).swapaxes(2, 3)
    assert np.array_equal(receivers_first * scale, recording.cube.values)


def test_captures_are_frames_and_annotations_are_gaps(tmp_path):
    recording = make_gap_recording()
    dc.write(recording, tmp_path / META)
    tree = json.loads((tmp_path / META).read_text())
    per_frame = 6 * 32
    starts = [entry["core:sample_start"] for entry in tree["captures"]]
    assert starts == [0, per_frame, 2 * per_frame]
    assert [entry["radar:start"] for entry in tree["captures"]] == [0.0, 1e-3, 2e-3]
    middle_hz = recording.radar.frame.chirp.mid_window_frequency_hz
    assert {entry["core:frequency"] for entry in tree["captures"]} == {middle_hz}
    # The last chirp of frame 0 and two chirps of frame 1 form one run.
    runs = [
        (entry["core:sample_start"], entry["core:sample_count"]) for entry in tree["annotations"]
    ]
    assert runs == [(5 * 32, 3 * 32), (17 * 32, 32)]


def test_captures_of_selected_frames_have_own_chirp_starts(tmp_path):
    dc.write(make_tdm_recording().select_frames(1, 3), tmp_path / META)
    recording = dc.open(tmp_path / META)
    captures = json.loads((tmp_path / META).read_text())["captures"]
    starts_s = [entry["radar:chirp_starts"] for entry in captures]
    assert np.array_equal(starts_s, recording.cube.chirp_time)


def test_full_disk_keeps_existing_files(tmp_path):
    assert_full_disk_keeps_files(tmp_path / META)


def test_rejects_archive_suffix_with_suggestion(tmp_path):
    with pytest.raises(DechirpError, match=r"did you mean \.sigmf-meta"):
        dc.write(make_complex_recording(), tmp_path / "x.sigmf")
    assert not list(tmp_path.iterdir())


def test_folder_in_place_of_one_file_keeps_other_file(tmp_path):
    (tmp_path / META).mkdir()
    (tmp_path / DATA).write_bytes(b"earlier")
    with pytest.raises(DechirpError, match="a folder"):
        dc.write(make_complex_recording(), tmp_path / META)
    assert (tmp_path / DATA).read_bytes() == b"earlier"


@nightly
def test_rejects_tables_too_large_for_json_before_writing(tmp_path):
    large_table = xr.Dataset({"v": ("n", np.random.default_rng(1).normal(size=2**20))})
    recording = dc.recording_from_cube(
        make_complex_recording().cube, make_radar(), tables={"t": large_table}
    )
    with pytest.raises(DechirpError, match=r"as JSON.*write an \.h5"):
        dc.write(recording, tmp_path / META)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (xr.Dataset({"v": ("n", np.zeros(1, "M8[ns]"))}), "datetime64"),
        (xr.Dataset(attrs={"a": np.zeros(2)}), "attributes"),
        (xr.Dataset(attrs={"a": float("nan")}), "finite"),
    ],
)
def test_rejects_tables_without_json_form(tmp_path, table, message):
    recording = dc.recording_from_cube(
        make_complex_recording().cube, make_radar(), tables={"t": table}
    )
    with pytest.raises(DechirpError, match=message):
        dc.write(recording, tmp_path / META)
    assert not list(tmp_path.iterdir())


# --- Foreign SigMF files --------------------------------------------------------------


def write_foreign(folder: Path, numbers: np.ndarray, datatype: str, n_channels=2, **fields) -> Path:
    """Write a recording as another program does; `None` omits a field."""
    (folder / DATA).write_bytes(numbers.tobytes())
    global_fields = {
        "core:datatype": datatype,
        "core:version": "1.0.0",
        "core:num_channels": n_channels,
    }
    global_fields |= {name.replace("__", ":"): entry for name, entry in fields.items()}
    present_fields = {name: entry for name, entry in global_fields.items() if entry is not None}
    captures = [{"core:sample_start": 0}]
    tree = {"global": present_fields, "captures": captures, "annotations": []}
    (folder / META).write_text(json.dumps(tree))
    return folder / META


TYPES = ["f32_le", "f32_be", "f64_le", "i8", "u8", "i16_le", "i16_be", "u16_le", "i32_le", "u32_be"]


@pytest.mark.parametrize("name", nightly_except(6, TYPES))
@pytest.mark.parametrize("sampling", nightly_except(1, ["complex", "real"]))
def test_every_number_type_scales_to_one_at_full_scale(tmp_path, name, sampling):
    kind, bits, order = name[0], int(name[1:].split("_")[0]), name[-2:]
    dtype = np.dtype(f"{'>' if order == 'be' else '<'}{kind}{bits // 8}")
    n_parts = 2 if sampling == "complex" else 1
    # Eighths from -1 to 7 / 8 are exact in every type.
    eighths = np.random.default_rng(2).integers(-8, 8, (3, 6, 32, 2, n_parts))
    full_scale = {"f": 1, "i": 2 ** (bits - 1), "u": 2 ** (bits - 1)}[kind]
    numbers = (eighths / 8 * full_scale + (full_scale if kind == "u" else 0)).astype(dtype)
    file = write_foreign(tmp_path, numbers, f"{sampling[0]}{name}")

    recording = dc.open(file, radar=make_radar(sampling))

    parts = np.moveaxis(eighths, 3, 2) / 8
    expected = parts[..., 0] + 1j * parts[..., 1] if n_parts == 2 else parts[..., 0]
    assert recording.sizes == {"frame": 3, "chirp": 6, "rx": 2, "sample": 32}
    assert np.array_equal(recording.cube.values, expected)


def draw_codes(*shape) -> np.ndarray:
    return np.random.default_rng(3).integers(-9, 9, (*shape, 2)).astype("<i2")


def test_channels_are_receivers_of_radar_without_array(tmp_path):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 4), "ci16_le", n_channels=4)
    radar_without_array = replace(make_radar(), array=dc.Array())
    recording = dc.open(file, radar=radar_without_array)
    assert recording.sizes["rx"] == 4
    assert any("4 receivers" in entry.value for entry in recording.findings)
    with pytest.raises(RecordingError, match="4 receivers"):
        dc.open(file, radar=make_radar())


def test_given_axes_take_precedence_over_sigmf_order(tmp_path):
    numbers = draw_codes(3, 6, 2, 32)
    file = write_foreign(tmp_path, numbers, "ci16_le", n_channels=1)
    recording = dc.open(file, radar=make_radar(), axes="frame,chirp,rx,sample")
    assert np.array_equal(recording.cube.values.real * 2**15, numbers[..., 0])


def test_truncated_last_frame_is_dropped_with_warning(tmp_path):
    numbers = draw_codes(3, 6, 32, 2)
    file = write_foreign(tmp_path, numbers.reshape(-1)[:-400], "ci16_le")
    recording = dc.open(file, radar=make_radar())
    assert recording.n_frames == 2
    assert [entry.level for entry in recording.findings] == ["warning"]


@pytest.mark.parametrize(
    ("captures", "n_gaps"),
    [
        ([(0, 0), (6 * 32, 900)], 0),  # pause between frames
        ([(0, 100), (32, 132)], 0),
        ([(0, 100), (32, 133)], 1),
        ([(0, None), (32, 40), (64, None), (70, 80)], 2),
    ],
)
def test_missing_samples_within_frame_give_warning(tmp_path, captures, n_gaps):
    file = write_foreign(tmp_path, draw_codes(3, 6, 32, 2), "ci16_le")
    tree = json.loads(file.read_text())
    tree["captures"] = [
        {"core:sample_start": start} | ({} if index is None else {"core:global_index": index})
        for start, index in captures
    ]
    file.write_text(json.dumps(tree))
    findings = [
        entry for entry in dc.open(file, radar=make_radar()).findings if "missing" in entry.value
    ]
    assert len(findings) == bool(n_gaps)
    for entry in findings:
        assert (entry.level, entry.setting) == ("warning", "core:global_index")
        assert f"in {n_gaps} places" in entry.value


def test_rejects_sample_rate_that_contradicts_radar(tmp_path):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le", core__sample_rate=9e6)
    with pytest.raises(RecordingError, match="sample rate 9 MHz"):
        dc.open(file, radar=make_radar())
    with pytest.raises(RecordingError, match="no settings in the recording"):
        dc.open(write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le"))


def test_floats_beyond_full_scale_need_encoding(tmp_path):
    numbers = abs(draw_codes(1, 6, 32, 2)).astype("<f4")
    file = write_foreign(tmp_path, numbers, "cf32_le")
    with pytest.raises(RecordingError, match="without an encoding"):
        dc.open(file, radar=make_radar()).cube.load()
    recording = dc.open(file, radar=make_radar(), encoding="full-scale")
    assert np.array_equal(recording.cube.values.real, numbers[..., 0].swapaxes(2, 3))


def make_extension(name, optional):
    return [{"name": name, "version": "1.0.0", "optional": optional}]


def test_optional_extension_is_ignored_with_note(tmp_path):
    fields = {"core__extensions": make_extension("antenna", True), "antenna__gain": 3}
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le", **fields)
    (note,) = dc.open(file, radar=make_radar()).findings
    assert (note.level, note.setting) == ("note", "core:extensions")
    assert "antenna" in note.value


@pytest.mark.parametrize(
    ("fields", "message"),
    nightly_except(
        6,
        [
            (
                {"core__extensions": make_extension("capture_details", False)},
                "capture_details.*optional",
            ),
            ({"core__extensions": [{"name": "rfml"}]}, r"core:extensions.*'version' is a required"),
            ({"core__extensions": ["rfml"]}, "core:extensions.*'rfml' is not of type"),
            ({"core__extensions": make_extension("radar", False)}, "radar.*optional"),
            ({"core__dataset": "../../secret.bin"}, "core:dataset"),
            ({"core__trailing_bytes": 8}, "core:trailing_bytes"),
            ({"core__metadata_only": True}, "core:metadata_only"),
            ({"core__datatype": "ci12_le"}, "core:datatype"),
            ({"core__datatype": "ci16"}, "core:datatype"),
            ({"core__datatype": "ci8_le"}, "core:datatype"),
            ({"core__datatype": "ci16_lexx"}, "core:datatype"),
            ({"core__datatype": None}, "core:datatype"),
            ({"core__num_channels": 0}, "core:num_channels"),
            ({"core__num_channels": 10**9}, "core:num_channels"),
            ({"core__num_channels": 5}, "complete samples of 5 channels"),
            ({"core__sample_rate": "fast"}, "core:sample_rate"),
            ({"core__sample_rate": float("nan")}, "core:sample_rate nan"),
        ],
    ),
)
def test_unsupported_field_error_names_field(tmp_path, fields, message):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le", **fields)
    radar_5_rx = replace(make_radar(), array=dc.Array(rx_m=[(0, 2e-3 * n, 0) for n in range(5)]))
    with pytest.raises(RecordingError, match=message):
        dc.open(file, radar=radar_5_rx if fields.get("core__num_channels") == 5 else make_radar())


def test_rejects_header_bytes_between_samples(tmp_path):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le")
    tree = json.loads(file.read_text())
    tree["captures"][0]["core:header_bytes"] = 4
    file.write_text(json.dumps(tree))
    with pytest.raises(RecordingError, match="core:header_bytes"):
        dc.open(file, radar=make_radar())


def test_rejects_data_file_behind_link(tmp_path):
    folder = tmp_path / "given"
    folder.mkdir()
    file = write_foreign(folder, draw_codes(1, 6, 32, 2), "ci16_le")
    (folder / DATA).rename(tmp_path / "secret")
    (folder / DATA).symlink_to(tmp_path / "secret")
    with pytest.raises(RecordingError, match="link to another"):
        dc.open(file, radar=make_radar())


def test_missing_data_file_error_names_file(tmp_path):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le")
    (tmp_path / DATA).unlink()
    with pytest.raises(RecordingError, match=f"no {DATA} next to it"):
        dc.open(file, radar=make_radar())


def test_missing_library_is_reported_with_its_extra(tmp_path, monkeypatch):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le")
    monkeypatch.setitem(sys.modules, "sigmf", None)
    with pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[io\]'"):
        dc.open(file, radar=make_radar())


def test_wrong_checksum_gives_warning(tmp_path):
    numbers = draw_codes(1, 6, 32, 2)
    checksum = hashlib.sha512(numbers.tobytes()).hexdigest().upper()
    fields = {"core__sha512": checksum}
    assert (
        dc.open(write_foreign(tmp_path, numbers, "ci16_le", **fields), radar=make_radar()).findings
        == ()
    )
    numbers[0, 0, 0, 0, 0] += 1
    (warning,) = dc.open(
        write_foreign(tmp_path, numbers, "ci16_le", **fields), radar=make_radar()
    ).findings
    assert (warning.level, warning.setting) == ("warning", "core:sha512")


# --- Archives -------------------------------------------------------------------------


def pack(archive: Path, *names: str, folder="x/") -> Path:
    """Write an archive of files next to it."""
    with tarfile.open(archive, "w") as tar:
        for name in names:
            tar.add(archive.with_name(name), folder + name)
    return archive


@pytest.mark.parametrize(
    "make_recording", [make_table_recording, make_gap_recording, make_real_code_recording]
)
def test_archive_of_sigmf_library_is_read_bit_exact(tmp_path, make_recording):
    recording = make_recording()
    dc.write(recording, tmp_path / META)
    sigmf.fromfile(str(tmp_path / META)).archive(str(tmp_path / "x.sigmf"))

    copy = dc.open(tmp_path / "x.sigmf")

    assert copy.format == "sigmf"
    assert not copy.findings
    assert_recordings_equal(copy, recording)


@pytest.mark.parametrize("suffix", [".gz", ".xz", ".zip"])
def test_compressed_archive_is_named_and_read_once_unpacked(tmp_path, suffix):
    recording = make_complex_code_recording()
    dc.write(recording, tmp_path / META)
    archive = tmp_path / f"y.sigmf{suffix}"
    sigmf.fromfile(str(tmp_path / META)).archive(str(archive))

    with pytest.raises(RecordingError, match=r"of a SigMF recording; .*; unpack it"):
        dc.open(archive)

    unpacked = tmp_path / "y.sigmf"
    if suffix == ".zip":
        shutil.unpack_archive(archive, unpacked)
        (unpacked,) = unpacked.rglob("*.sigmf-meta")
    else:
        unpacked.write_bytes({".gz": gzip, ".xz": lzma}[suffix].decompress(archive.read_bytes()))
    assert_recordings_equal(dc.open(unpacked), recording)


@pytest.mark.parametrize("datatype", ["ci16_le", "cf32_le"])
def test_foreign_archive_is_read_as_its_pair(tmp_path, datatype):
    codes = draw_codes(3, 6, 32, 2)
    numbers = codes if datatype == "ci16_le" else (codes / 16).astype("<f4")
    checksum = hashlib.sha512(numbers.tobytes()).hexdigest()
    file = write_foreign(tmp_path, numbers, datatype, core__sha512=checksum)
    (tmp_path / "readme").write_bytes(b"read me")
    archive = pack(tmp_path / "y.sigmf", "readme", META, DATA)

    copy, pair = (dc.open(path, radar=make_radar()) for path in (archive, file))

    assert copy.findings == pair.findings == ()
    assert copy.cube.equals(pair.cube)


def test_wrong_checksum_of_archive_gives_warning(tmp_path):
    write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le", core__sha512="0" * 128)
    archive = pack(tmp_path / "x.sigmf", DATA, META, folder="")
    (warning,) = dc.open(archive, radar=make_radar()).findings
    assert (warning.level, warning.setting) == ("warning", "core:sha512")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("many",), "no file of a recording"),
        ((DATA,), "not one recording but .?x.sigmf-data"),
        ((META,), "not one recording but .?x.sigmf-meta"),
        ((META, "other.sigmf-data"), "but .?other.sigmf-data.?, .?x.sigmf-meta"),
        (
            (META, DATA, "other.sigmf-meta", "other.sigmf-data"),
            "not one recording.*tar -xf x.sigmf",
        ),
        (("link.sigmf-meta", DATA), "not one recording but .?x.sigmf-data"),
        (("many",) * 1001, "more than 1000 members"),
    ],
)
def test_rejects_archive_without_exactly_one_recording(tmp_path, names, message):
    file = write_foreign(tmp_path, draw_codes(1, 6, 32, 2), "ci16_le")
    for name in ("other.sigmf-meta", "other.sigmf-data", "many"):
        (tmp_path / name).write_bytes(b"{}")
    (tmp_path / "link.sigmf-meta").symlink_to(file)
    with pytest.raises(RecordingError, match=message):
        dc.open(pack(tmp_path / "x.sigmf", *names), radar=make_radar())


def test_truncated_archive_error_names_member(tmp_path):
    dc.write(make_complex_recording(), tmp_path / META)
    archive = pack(tmp_path / "x.sigmf", META, DATA)
    n_bytes = (tmp_path / DATA).stat().st_size
    archive.write_bytes(archive.read_bytes()[: -n_bytes // 2 - 10240])
    with pytest.raises(RecordingError, match=f"truncated within .?{DATA}|unexpected end of data"):
        dc.open(archive)


# --- Damaged files --------------------------------------------------------------------


def make_change(*keys, to):
    """Return a function that replaces the metadata value at nested keys."""

    def change(tree):
        for key in keys[:-1]:
            tree = tree[key]
        tree[keys[-1]] = to

    return change


COLUMN = ("global", "radar:tables", "truth", "variables", "range")


@pytest.mark.parametrize(
    ("change", "message"),
    nightly_except(
        6,
        [
            (make_change("global", "core:extensions", to=[]), None),
            (make_change("global", "core:extensions", 0, "version", to="2.0.0"), "of version"),
            (make_change("global", "radar:radar", "frame", "n_chirps", to=-3), "unreadable radar"),
            (make_change("global", "radar:units", to="volt"), "volt"),
            (make_change("global", "radar:scale", to=0.5), "scale of 0.5"),
            (make_change("global", "radar:n_frames", to=4), "12288 bytes"),
            (make_change("global", "radar:n_samples", to=10**30), "bytes"),
            (make_change("global", "radar:n_chirps", to=None), "null"),
            (make_change("global", "core:num_channels", to=1), "4608 bytes"),
            (make_change("global", "radar:tables", to=[1]), "not readable"),
            (make_change(*COLUMN, "dtype", to="O"), "truth"),
            (make_change(*COLUMN, "shape", to=[2**60]), "truth"),
            (make_change(*COLUMN, "values", to=[[1], 2]), "truth"),
            (make_change(*COLUMN, "values", to="word"), "truth"),
            (make_change(*COLUMN, "dims", to=["target"]), "truth"),
            (
                make_change("annotations", to=[{"core:sample_start": 3, "radar:lost": True}]),
                "whole chirps",
            ),
            (make_change("annotations", to={"a": 1}), "annotations"),
            (make_change("captures", to=["a"]), "captures"),
        ],
    ),
)
def test_altered_native_metadata_error_names_mistake(tmp_path, change, message):
    recording = make_table_recording()
    dc.write(recording, tmp_path / META)
    tree = json.loads((tmp_path / META).read_text())
    change(tree)
    (tmp_path / META).write_text(json.dumps(tree))
    if message is None:
        assert_recordings_equal(dc.open(tmp_path / META), recording)
        return
    with pytest.raises(RecordingError, match=message):
        dc.open(tmp_path / META)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not readable .Expecting property name"),
        ("[" * 100_000, "not readable .maximum recursion depth"),
        ("[" + "[]," * 300_000 + "[]]", "too many objects"),
        ("[]", "not readable"),
        ('{"global": {}, "captures": []}', "is a required property"),
        (" " * (2**24 + 1), "more than"),
        ("\xff", "not readable .'utf-8' codec"),
    ],
)
def test_rejects_text_that_is_not_metadata(tmp_path, text, message):
    dc.write(make_complex_recording(), tmp_path / META)
    (tmp_path / META).write_text(text, encoding="latin-1")
    with pytest.raises(RecordingError, match=message):
        dc.open(tmp_path / META)


@settings(max_examples=n_examples(60))
@given(data=st.data())
def test_corrupted_file_gives_cube_or_error(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damaged")
    dc.write(make_gap_recording(), folder / META)
    pack(folder / "x.sigmf", META, DATA)
    file = folder / data.draw(st.sampled_from([META, META, DATA, "x.sigmf"]))
    file.write_bytes(data.draw(corrupted_bytes(file.read_bytes())))
    assert_cube_or_error(folder / (META if file.name == DATA else file.name))


@pytest.mark.skipif(
    "DECHIRP_REAL_DATA" not in os.environ,
    reason="no recordings: set DECHIRP_REAL_DATA to their folder",
)
def test_real_recording_round_trip_is_exact(tmp_path):
    recording = open_real_capture(Path(os.environ["DECHIRP_REAL_DATA"]))
    assert_write_preserves_recording(recording, tmp_path / META)
