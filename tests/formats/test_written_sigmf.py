"""Recordings written as SigMF come back equal, and SigMF of others is read with a radar."""

import hashlib
import json
import os
import tarfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import dechirp as dc
from dechirp.core.errors import DechirpError, RecordingError
from dechirp.simulation.adc_codes import extract_adc_codes
from formats.any_bytes import damaged, gives_a_cube_or_says_why
from formats.containers import (
    EVERY_CASE,
    must_be_equal,
    must_keep_a_real_recording,
    must_leave_what_was_there,
    of_complex_codes,
    of_complex_samples,
    of_lost_chirps,
    of_real_codes,
    of_real_samples,
    of_tables,
    of_transmitters_in_turns,
    real,
    small,
)

META, DATA = "x.sigmf-meta", "x.sigmf-data"


@EVERY_CASE
def test_every_recording_comes_back_bit_by_bit_by_either_name(tmp_path, made):
    recording = made()
    assert dc.write(recording, tmp_path / META) == (tmp_path / META, tmp_path / DATA)
    for name in (META, DATA):
        opened = dc.open(tmp_path / name)
        assert opened.format == "sigmf"
        must_be_equal(opened, recording)


@pytest.mark.parametrize(
    ("made", "datatype"),
    [
        (of_complex_samples, "cf32_le"),
        (of_real_samples, "rf32_le"),
        (of_complex_codes, "ci16_le"),
        (of_real_codes, "ri16_le"),
    ],
)
def test_receivers_are_channels_that_alternate_and_chirps_follow_one_another(
    tmp_path, made, datatype
):
    recording = made()
    dc.write(recording, tmp_path / META)
    said = json.loads((tmp_path / META).read_text())["global"]
    assert said["core:datatype"] == datatype
    assert said["core:num_channels"] == 2

    kinds = {"cf32_le": "<c8", "rf32_le": "<f4", "ci16_le": "<i2", "ri16_le": "<i2"}
    flat = np.fromfile(tmp_path / DATA, kinds[datatype])
    coded = "scale" in recording.cube.attrs
    numbers = (extract_adc_codes(recording.cube) if coded else recording.cube).values
    assert np.array_equal(flat, numbers.swapaxes(2, 3).reshape(-1))


@EVERY_CASE
def test_the_library_of_sigmf_finds_it_valid_and_reads_its_samples(tmp_path, made):
    sigmf = pytest.importorskip("sigmf")
    recording = made()
    dc.write(recording, tmp_path / META)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        file = sigmf.fromfile(str(tmp_path / META), autoscale=False)  # compares their sum
        file.validate()
        samples = file.read_samples()
    sizes = recording.cube.sizes
    shape = [sizes[name] for name in ("frame", "chirp", "sample", "rx")]
    scale = np.float32(recording.contents.scale or 1)
    in_turn = samples.reshape(shape).swapaxes(2, 3)
    assert np.array_equal(in_turn * scale, recording.cube.values)


def test_captures_are_frames_and_annotations_lost_chirps(tmp_path):
    recording = of_lost_chirps()
    dc.write(recording, tmp_path / META)
    tree = json.loads((tmp_path / META).read_text())
    per_frame = 6 * 32
    starts = [one["core:sample_start"] for one in tree["captures"]]
    assert starts == [0, per_frame, 2 * per_frame]
    assert [one["radar:start"] for one in tree["captures"]] == [0.0, 1e-3, 2e-3]
    middle_hz = recording.radar.frame.chirp.mid_window_frequency_hz
    assert {one["core:frequency"] for one in tree["captures"]} == {middle_hz}
    # The last chirp of the first frame and two of the second are one run.
    runs = [(one["core:sample_start"], one["core:sample_count"]) for one in tree["annotations"]]
    assert runs == [(5 * 32, 3 * 32), (17 * 32, 32)]


def test_captures_of_a_part_say_when_its_own_chirps_start(tmp_path):
    dc.write(of_transmitters_in_turns().select_frames(1, 3), tmp_path / META)
    opened = dc.open(tmp_path / META)
    captures = json.loads((tmp_path / META).read_text())["captures"]
    starts_s = [one["radar:chirp_starts"] for one in captures]
    assert np.array_equal(starts_s, opened.cube.chirp_time)


def test_a_full_disk_leaves_what_was_there(tmp_path):
    must_leave_what_was_there(tmp_path / META)


def test_an_archive_is_refused_and_its_pair_named(tmp_path):
    with pytest.raises(DechirpError, match=r"did you mean \.sigmf-meta"):
        dc.write(of_complex_samples(), tmp_path / "x.sigmf")
    assert not list(tmp_path.iterdir())


def test_neither_file_is_replaced_where_a_folder_has_the_name_of_the_other(tmp_path):
    (tmp_path / META).mkdir()
    (tmp_path / DATA).write_bytes(b"earlier")
    with pytest.raises(DechirpError, match="a folder"):
        dc.write(of_complex_samples(), tmp_path / META)
    assert (tmp_path / DATA).read_bytes() == b"earlier"


def test_tables_too_large_for_json_are_refused_before_anything_is_written(tmp_path):
    large = xr.Dataset({"v": ("n", np.random.default_rng(1).normal(size=2**20))})
    recording = dc.recording_from_cube(of_complex_samples().cube, small(), tables={"t": large})
    with pytest.raises(DechirpError, match=r"as JSON.*write an \.h5"):
        dc.write(recording, tmp_path / META)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (xr.Dataset({"v": ("n", np.zeros(1, "M8[ns]"))}), "datetime64"),
        (xr.Dataset(attrs={"a": np.zeros(2)}), "attributes"),
        (xr.Dataset(attrs={"a": float("nan")}), "finite"),
    ],
)
def test_tables_that_json_does_not_hold_are_refused_in_words(tmp_path, table, said):
    recording = dc.recording_from_cube(of_complex_samples().cube, small(), tables={"t": table})
    with pytest.raises(DechirpError, match=said):
        dc.write(recording, tmp_path / META)
    assert not list(tmp_path.iterdir())


# --- SigMF of others ------------------------------------------------------------------


def foreign(folder: Path, numbers: np.ndarray, datatype: str, n_channels=2, **said) -> Path:
    """A recording as another program writes it; `None` leaves a field out."""
    (folder / DATA).write_bytes(numbers.tobytes())
    known = {"core:datatype": datatype, "core:version": "1.0.0", "core:num_channels": n_channels}
    known |= {name.replace("__", ":"): one for name, one in said.items()}
    whole = {name: one for name, one in known.items() if one is not None}
    captures = [{"core:sample_start": 0}]
    tree = {"global": whole, "captures": captures, "annotations": []}
    (folder / META).write_text(json.dumps(tree))
    return folder / META


TYPES = ["f32_le", "f32_be", "f64_le", "i8", "u8", "i16_le", "i16_be", "u16_le", "i32_le", "u32_be"]


@pytest.mark.parametrize("name", TYPES)
@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_numbers_of_every_type_are_full_scale_at_one(tmp_path, name, sampling):
    kind, bits, order = name[0], int(name[1:].split("_")[0]), name[-2:]
    dtype = np.dtype(f"{'>' if order == 'be' else '<'}{kind}{bits // 8}")
    n_parts = 2 if sampling == "complex" else 1
    # Eighths, which every type holds exactly: from -1 to 7 / 8.
    eighths = np.random.default_rng(2).integers(-8, 8, (3, 6, 32, 2, n_parts))
    half = {"f": 1, "i": 2 ** (bits - 1), "u": 2 ** (bits - 1)}[kind]
    numbers = (eighths / 8 * half + (half if kind == "u" else 0)).astype(dtype)
    file = foreign(tmp_path, numbers, f"{sampling[0]}{name}")

    opened = dc.open(file, radar=small(sampling))

    parts = np.moveaxis(eighths, 3, 2) / 8
    expected = parts[..., 0] + 1j * parts[..., 1] if n_parts == 2 else parts[..., 0]
    assert opened.sizes == {"frame": 3, "chirp": 6, "rx": 2, "sample": 32}
    assert np.array_equal(opened.cube.values, expected)


def samples(*shape) -> np.ndarray:
    return np.random.default_rng(3).integers(-9, 9, (*shape, 2)).astype("<i2")


def test_channels_are_receivers_where_the_radar_does_not_say_how_many(tmp_path):
    file = foreign(tmp_path, samples(1, 6, 32, 4), "ci16_le", n_channels=4)
    alone = replace(small(), array=dc.Array())
    opened = dc.open(file, radar=alone)
    assert opened.sizes["rx"] == 4
    assert any("4 receivers" in one.value for one in opened.findings)
    with pytest.raises(RecordingError, match="4 receivers"):
        dc.open(file, radar=small())


def test_axes_that_the_user_names_come_before_the_order_of_sigmf(tmp_path):
    numbers = samples(3, 6, 2, 32)
    file = foreign(tmp_path, numbers, "ci16_le", n_channels=1)
    opened = dc.open(file, radar=small(), axes="frame,chirp,rx,sample")
    assert np.array_equal(opened.cube.values.real * 2**15, numbers[..., 0])


def test_a_last_frame_that_is_cut_short_is_left_out_with_a_warning(tmp_path):
    numbers = samples(3, 6, 32, 2)
    file = foreign(tmp_path, numbers.reshape(-1)[:-400], "ci16_le")
    opened = dc.open(file, radar=small())
    assert opened.n_frames == 2
    assert [one.level for one in opened.findings] == ["warning"]


@pytest.mark.parametrize(
    ("captures", "n_places"),
    [
        ([(0, 0), (6 * 32, 900)], 0),  # the radar rested between frames
        ([(0, 100), (32, 132)], 0),
        ([(0, 100), (32, 133)], 1),
        ([(0, None), (32, 40), (64, None), (70, 80)], 2),
    ],
)
def test_samples_that_are_missing_within_a_frame_are_told(tmp_path, captures, n_places):
    file = foreign(tmp_path, samples(3, 6, 32, 2), "ci16_le")
    tree = json.loads(file.read_text())
    tree["captures"] = [
        {"core:sample_start": start} | ({} if index is None else {"core:global_index": index})
        for start, index in captures
    ]
    file.write_text(json.dumps(tree))
    said = [one for one in dc.open(file, radar=small()).findings if "missing" in one.value]
    assert len(said) == bool(n_places)
    for one in said:
        assert (one.level, one.setting) == ("warning", "core:global_index")
        assert f"in {n_places} places" in one.value


def test_the_sample_rate_must_be_that_of_the_radar(tmp_path):
    file = foreign(tmp_path, samples(1, 6, 32, 2), "ci16_le", core__sample_rate=9e6)
    with pytest.raises(RecordingError, match="sample rate 9e"):
        dc.open(file, radar=small())
    with pytest.raises(RecordingError, match="no settings in the recording"):
        dc.open(foreign(tmp_path, samples(1, 6, 32, 2), "ci16_le"))


def test_floats_beyond_full_scale_need_a_word(tmp_path):
    numbers = samples(1, 6, 32, 2).astype("<f4")
    file = foreign(tmp_path, numbers, "cf32_le")
    with pytest.raises(RecordingError, match="without an encoding"):
        dc.open(file, radar=small()).cube.load()
    opened = dc.open(file, radar=small(), encoding="full-scale")
    assert np.array_equal(opened.cube.values.real, numbers[..., 0].swapaxes(2, 3))


def extension(name, optional):
    return [{"name": name, "version": "1.0.0", "optional": optional}]


def test_what_an_optional_extension_says_is_passed_over_in_words(tmp_path):
    known = {"core__extensions": extension("antenna", True), "antenna__gain": 3}
    file = foreign(tmp_path, samples(1, 6, 32, 2), "ci16_le", **known)
    (note,) = dc.open(file, radar=small()).findings
    assert (note.level, note.setting) == ("note", "core:extensions")
    assert "antenna" in note.value


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({"core__extensions": extension("capture_details", False)}, "capture_details.*optional"),
        ({"core__extensions": [{"name": "rfml"}]}, "rfml"),
        ({"core__extensions": ["rfml"]}, "not a list of names"),
        ({"core__extensions": extension("radar", False)}, "radar.*optional"),
        ({"core__dataset": "../../secret.bin"}, "core:dataset"),
        ({"core__trailing_bytes": 8}, "core:trailing_bytes"),
        ({"core__metadata_only": True}, "core:metadata_only"),
        ({"core__datatype": "ci12_le"}, "core:datatype"),
        ({"core__datatype": "ci16"}, "core:datatype"),
        ({"core__datatype": "ci8_le"}, "core:datatype"),
        ({"core__datatype": None}, "core:datatype"),
        ({"core__num_channels": 0}, "core:num_channels"),
        ({"core__num_channels": 10**9}, "core:num_channels"),
        ({"core__num_channels": 5}, "complete samples of 5 channels"),
        ({"core__sample_rate": "fast"}, "core:sample_rate"),
    ],
)
def test_what_cannot_be_read_rightly_is_refused_by_name(tmp_path, known, said):
    file = foreign(tmp_path, samples(1, 6, 32, 2), "ci16_le", **known)
    five = replace(small(), array=dc.Array(rx_m=[(0, 2e-3 * n, 0) for n in range(5)]))
    with pytest.raises(RecordingError, match=said):
        dc.open(file, radar=five if known.get("core__num_channels") == 5 else small())


def test_headers_between_samples_are_refused(tmp_path):
    file = foreign(tmp_path, samples(1, 6, 32, 2), "ci16_le")
    tree = json.loads(file.read_text())
    tree["captures"][0]["core:header_bytes"] = 4
    file.write_text(json.dumps(tree))
    with pytest.raises(RecordingError, match="core:header_bytes"):
        dc.open(file, radar=small())


def test_a_data_file_elsewhere_is_not_read(tmp_path):
    folder = tmp_path / "given"
    folder.mkdir()
    file = foreign(folder, samples(1, 6, 32, 2), "ci16_le")
    (folder / DATA).rename(tmp_path / "secret")
    (folder / DATA).symlink_to(tmp_path / "secret")
    with pytest.raises(RecordingError, match="link to another"):
        dc.open(file, radar=small())


def test_half_of_a_pair_and_an_archive_of_pairs_say_what_to_do(tmp_path):
    file = foreign(tmp_path, samples(1, 6, 32, 2), "ci16_le")
    with tarfile.open(tmp_path / "x.sigmf", "w") as archive:
        archive.add(file, "x/" + META)
    with pytest.raises(RecordingError, match="tar -xf"):
        dc.open(tmp_path / "x.sigmf", radar=small())
    (tmp_path / DATA).unlink()
    with pytest.raises(RecordingError, match=f"no {DATA} beside it"):
        dc.open(file, radar=small())


def test_samples_of_another_sum_are_told(tmp_path):
    numbers = samples(1, 6, 32, 2)
    right = hashlib.sha512(numbers.tobytes()).hexdigest().upper()
    known = {"core__sha512": right}
    assert dc.open(foreign(tmp_path, numbers, "ci16_le", **known), radar=small()).findings == ()
    numbers[0, 0, 0, 0, 0] += 1
    (warning,) = dc.open(foreign(tmp_path, numbers, "ci16_le", **known), radar=small()).findings
    assert (warning.level, warning.setting) == ("warning", "core:sha512")


# --- What was damaged -----------------------------------------------------------------


def changed(*keys, to):
    """Change what stands under some keys of the metadata."""

    def change(tree):
        for key in keys[:-1]:
            tree = tree[key]
        tree[keys[-1]] = to

    return change


COLUMN = ("global", "radar:tables", "truth", "variables", "range")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed("global", "core:extensions", to=[]), None),
        (changed("global", "core:extensions", 0, "version", to="2.0.0"), "of version"),
        (changed("global", "radar:radar", "frame", "n_chirps", to=-3), "unreadable radar"),
        (changed("global", "radar:units", to="volt"), "volt"),
        (changed("global", "radar:scale", to=0.5), "scale of 0.5"),
        (changed("global", "radar:n_frames", to=4), "12288 bytes"),
        (changed("global", "radar:n_samples", to=10**30), "bytes"),
        (changed("global", "radar:n_chirps", to=None), "null"),
        (changed("global", "core:num_channels", to=1), "4608 bytes"),
        (changed("global", "radar:tables", to=[1]), "not readable"),
        (changed(*COLUMN, "dtype", to="O"), "truth"),
        (changed(*COLUMN, "shape", to=[2**60]), "truth"),
        (changed(*COLUMN, "values", to=[[1], 2]), "truth"),
        (changed(*COLUMN, "values", to="word"), "truth"),
        (changed(*COLUMN, "dims", to=["target"]), "truth"),
        (changed("annotations", to=[{"core:sample_start": 3, "radar:lost": True}]), "whole chirps"),
        (changed("annotations", to={"a": 1}), "annotations"),
        (changed("captures", to=["a"]), "captures"),
    ],
)
def test_metadata_of_ours_that_were_changed_say_what_is_wrong(tmp_path, change, said):
    recording = of_tables()
    dc.write(recording, tmp_path / META)
    tree = json.loads((tmp_path / META).read_text())
    change(tree)
    (tmp_path / META).write_text(json.dumps(tree))
    if said is None:
        must_be_equal(dc.open(tmp_path / META), recording)
        return
    with pytest.raises(RecordingError, match=said):
        dc.open(tmp_path / META)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[" * 100_000, "nested too deeply"),
        ("[" + "[]," * 300_000 + "[]]", "too many objects"),
        ("[]", "no global"),
        (" " * (2**24 + 1), "more than"),
        ("\xff", "not JSON"),
    ],
)
def test_text_that_is_no_metadata_says_so(tmp_path, text, said):
    dc.write(of_complex_samples(), tmp_path / META)
    (tmp_path / META).write_text(text, encoding="latin-1")
    with pytest.raises(RecordingError, match=said):
        dc.open(tmp_path / META)


@settings(max_examples=60)
@given(data=st.data())
def test_any_damage_gives_a_cube_or_says_why(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("damaged")
    dc.write(of_lost_chirps(), folder / META)
    file = folder / data.draw(st.sampled_from([META, META, DATA]))
    file.write_bytes(data.draw(damaged(file.read_bytes())))
    gives_a_cube_or_says_why(folder / META)


@pytest.mark.skipif("DECHIRP_REAL_DATA" not in os.environ, reason="no recordings named")
def test_a_real_recording_comes_back_equal(tmp_path):
    recording = real(Path(os.environ["DECHIRP_REAL_DATA"]))
    must_keep_a_real_recording(recording, tmp_path / META)
