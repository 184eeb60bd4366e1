"""Items of a data set are the trials of its study, to the step of their whole numbers."""

import errno
import html
import json
import os
import re
import subprocess
import sys
import time
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr

import data_set_study
import dechirp as dc
from data_set_study import adaptive, fingerprint, run, study
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting
from dechirp.experiments.study import trial as trials
from dechirp.experiments.study.data_set import data_bytes
from dechirp.experiments.study.data_set_items import TRUTH_COLUMNS
from dechirp.experiments.study.dumping import dump_study
from dechirp.experiments.study.ledger_reader import LedgerReader
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.run import open_ledger, replay_trial
from dechirp.experiments.study.study import RandomSetting, SweptSetting, TrialBudget
from dechirp.radar.modulations.triangular import Triangular
from dechirp.report.data_set import render_data_set_page
from dechirp.results import shards
from dechirp.results.data_set import read_data_set, total_bytes
from dechirp.simulation.adc_codes import extract_adc_codes
from dechirp.simulation.impairments.quantisation import Quantisation
from dechirp.simulation.impairments.thermal_noise import ThermalNoise
from nightly import NIGHTLY
from printed import check_captions, check_pdf
from trial_cases import small

ITEMS = [(0, 0), (1, 22), (2, 7)]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed")
    run(out)
    return out


@pytest.fixture(scope="module")
def data(undisturbed) -> dict[str, xr.Dataset]:
    return read_data_set(undisturbed / "data.zarr")


def samples(data, point, trial):
    """Samples of an item, (frame, chirp, rx, sample)."""
    numbers, scale = data[""].cube[point, trial].values, data[""].cube_scale[point, trial].values
    return (numbers * np.float32(scale)).view(np.complex64)[..., 0], float(scale)


@pytest.mark.parametrize(("point", "trial"), ITEMS)
def test_samples_of_an_item_are_those_of_its_trial_to_half_a_step(data, point, trial):
    cube = replay_trial(study(), trial, point=point).result.cube
    found, scale = samples(data, point, trial)
    off = found - cube.values
    parts = np.maximum(abs(off.real), abs(off.imag))
    assert parts.max() <= (0.5 + 1e-2) * scale  # and what single precision rounds
    assert parts.max() > 0.4 * scale
    peak = max(abs(cube.values.real).max(), abs(cube.values.imag).max())
    assert scale == pytest.approx(peak / 32767)


@pytest.mark.parametrize(("point", "trial"), ITEMS)
def test_a_map_is_that_of_its_trial_to_half_of_a_hundredth_of_a_decibel(data, point, trial):
    power = replay_trial(study(), trial, point=point).result.power
    found = data[""].power[point, trial, 0]  # xarray knows the step
    np.testing.assert_allclose(found.values, 10 * np.log10(power.values), rtol=0, atol=0.00501)
    np.testing.assert_allclose(data[""].range_bins[point], power.range)
    np.testing.assert_allclose(data[""].velocity_bins[point, 0], power.velocity)


@pytest.mark.parametrize(("point", "trial"), ITEMS)
def test_detections_and_truth_of_an_item_are_those_of_its_trial(data, point, trial):
    made = replay_trial(study(), trial, point=point)
    rows = data["detections"]
    start, stop = int(rows.start[point, trial]), int(rows.stop[point, trial])
    own = rows.isel(detection=slice(start, stop))
    assert stop - start == made.result.detections.sizes["detection"]
    for name, column in made.result.detections.items():
        np.testing.assert_array_equal(own[name], column)
        assert own[name].attrs["units"] == column.attrs["units"]
    np.testing.assert_array_equal(own.target, made.trial_result.association.target)
    truth = made.result.truth.transpose("frame", "target")
    for name in ("range", "velocity", "azimuth", "elevation", "snr"):
        np.testing.assert_array_equal(data["truth"][name][point, trial], truth[name])
    assert list(data["truth"].target.values) == ["car", "van"]
    np.testing.assert_allclose(
        data["truth"].rcs[point, trial, 0], [10 ** (data_set_study.RCS.numbers[point] / 10), 3]
    )


def test_the_peak_of_a_target_lies_where_the_truth_says_it_is_on_the_map(data):
    """The van, 25 dB over the noise in each map, within half a cell."""
    for point, trial in ITEMS:
        power = data[""].power[point, trial, 0].values
        at = data["truth"].isel(point=point, trial=trial, frame=0, target=1)
        row = np.argmin(abs(data[""].velocity_bins[point, 0].values - float(at.map_velocity)))
        column = np.argmin(abs(data[""].range_bins[point].values - float(at.map_range)))
        around = power[row - 4 : row + 5, column - 4 : column + 5]
        assert np.unravel_index(around.argmax(), around.shape) == (4, 4)


def test_rows_of_detections_follow_in_the_order_of_the_items(data):
    starts, stops = (data["detections"][name].values.ravel() for name in ("start", "stop"))
    np.testing.assert_array_equal(starts[1:], stops[:-1])
    assert stops[-1] == data["detections"].sizes["detection"] > 0


def test_every_item_is_marked_as_made_and_every_setting_is_told(data):
    assert data[""].made.all()
    np.testing.assert_array_equal(data["settings"][data_set_study.RCS.path], [-20, -10, 0])
    assert data["settings"][data_set_study.RCS.path].attrs["units"] == "dBsm"
    assert "-10 dBsm" in str(data[""].scenario[1].values)


def test_it_opens_with_zarr_alone_in_few_files(undisturbed):
    group = zarr.open_group(undisturbed / "data.zarr", mode="r")
    assert group["cube"].shape == (3, 23, 1, 32, 2, 64, 2)
    assert group["cube"].dtype == "int16"
    assert group["cube"].metadata.dimension_names[:2] == ("point", "trial")
    # A file a block.
    assert len(list((undisturbed / "data.zarr" / "cube").iterdir())) == 3 * 5 + 1


def test_codes_of_a_converter_are_kept_as_they_are(tmp_path):
    noise = (ThermalNoise(), Quantisation(bits=10, full_scale_w=1e-9))
    asked = study(scenario=replace(study().scenario, impairments=noise), keep=("cubes",))
    run(tmp_path, asked)
    data = read_data_set(tmp_path / "data.zarr")
    cube = replay_trial(asked, 4, point=2).result.cube
    np.testing.assert_array_equal(data[""].cube[2, 4], extract_adc_codes(cube).values)
    found, scale = samples(data, 2, 4)
    np.testing.assert_array_equal(found, cube.values)
    assert scale == cube.attrs["scale"]


def test_real_samples_have_no_axis_of_two_parts(tmp_path):
    asked = study(scenario=replace(study().scenario, radar=small(1, "real")), keep=("cubes",))
    run(tmp_path, asked)
    data = read_data_set(tmp_path / "data.zarr")[""]
    cube = replay_trial(asked, 1).result.cube.values
    scale = float(data.cube_scale[0, 1])
    np.testing.assert_allclose(data.cube[0, 1] * scale, cube, rtol=0, atol=0.51 * scale)


def test_a_block_larger_than_a_shard_is_parted_evenly(tmp_path, monkeypatch, undisturbed):
    one = 2 * 32 * 2 * 64 * 2
    monkeypatch.setattr(shards, "SHARD_BYTES", 4 * one)  # of blocks of 6: three, not four
    parted = study(trials=TrialBudget(at_most=23, block=6), keep=("cubes",))
    run(tmp_path, parted)
    group = zarr.open_group(tmp_path / "data.zarr", mode="r")
    assert group["cube"].shards[1] == 3
    whole = zarr.open_group(undisturbed / "data.zarr", mode="r")
    np.testing.assert_array_equal(group["cube"][:], whole["cube"][:])


def test_the_number_of_workers_does_not_change_a_byte(tmp_path, undisturbed):
    dc.run_study(study(), tmp_path)
    assert fingerprint(tmp_path) == fingerprint(undisturbed)


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_a_study_killed_at_random_moments_gives_the_same_data_set_byte_by_byte(
    tmp_path, undisturbed
):
    chance = np.random.default_rng(8)
    was_between = False
    for moment_s in chance.uniform(0.0, 1.0, 12 if NIGHTLY else 2):
        process = subprocess.Popen(
            [sys.executable, data_set_study.__file__, tmp_path],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "started\n"
        folder = tmp_path / "data.zarr" / "cube"
        n_before = len(list(folder.glob("c.*"))) if folder.exists() else 0
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and process.poll() is None:
            if folder.exists() and len(list(folder.glob("c.*"))) > n_before:
                break
            time.sleep(0.002)
        time.sleep(0.1 * moment_s)
        process.kill()
        process.communicate()
        if folder.exists() and not (tmp_path / "data.zarr" / "zarr.json").exists():
            was_between = True  # and a worker may have been in the middle of a file
            (folder / ".c.0.0.0.0.0.0.0.deadbeef").write_bytes(b"half")
    assert was_between
    run(tmp_path)
    assert fingerprint(tmp_path) == fingerprint(undisturbed)


def test_a_study_that_is_done_changes_nothing_when_it_is_called_again(tmp_path):
    run(tmp_path, study(keep=("detections",)))
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "data.zarr").rglob("*")}
    run(tmp_path, study(keep=("detections",)))
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "data.zarr").rglob("*")} == before


def test_points_that_had_enough_leave_no_items_past_their_end(tmp_path):
    run(tmp_path, adaptive())
    with LedgerReader.open_existing(tmp_path) as record:
        lengths = [len(record.point_sums(point)) for point in range(3)]
    assert min(lengths) < 23
    data = read_data_set(tmp_path / "data.zarr")
    np.testing.assert_array_equal(data[""].made.sum("trial"), lengths)
    for point, n in enumerate(lengths):
        assert data[""].made[point, :n].all()
        assert not data[""].cube[point, n:].any()
        assert np.isnan(data["truth"].range[point, n:]).all()
        names = {file.name for file in (tmp_path / "data.zarr" / "power").glob(f"c.{point}.*")}
        assert len(names) == -(-n // 5)
    # And it does not depend on how many work ahead.
    dc.run_study(adaptive(), tmp_path / "two")
    assert fingerprint(tmp_path / "two") == fingerprint(tmp_path)


def test_a_trial_that_fails_is_an_item_of_zeros_that_is_not_made(tmp_path, monkeypatch, data):
    real, calls = trials.FrameProcessor, []

    def fails_once(*args, **kwargs):
        calls.append(1)
        if len(calls) == 7:
            raise ValueError("a bad day")
        return real(*args, **kwargs)

    monkeypatch.setattr(trials, "FrameProcessor", fails_once)
    run(tmp_path, study(stop_after_failures=0.5))
    found = read_data_set(tmp_path / "data.zarr")
    assert np.argwhere(~found[""].made.values).tolist() == [[0, 6]]
    assert not found[""].cube[0, 6].any()
    assert found["detections"].start[0, 6] == found["detections"].stop[0, 6]
    np.testing.assert_array_equal(found[""].cube[0, 7], data[""].cube[0, 7])
    rows = data["detections"]
    n_lost = int(rows.stop[0, 6] - rows.start[0, 6])
    assert found["detections"].sizes["detection"] == rows.sizes["detection"] - n_lost


def test_a_full_disk_stops_it_in_words_and_counts_nothing_that_is_not_there(
    tmp_path, monkeypatch, undisturbed
):
    real, calls = os.fsync, []

    def full(file):
        calls.append(1)
        if len(calls) > 9:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(file)

    monkeypatch.setattr(shards.os, "fsync", full)
    with pytest.raises(DechirpError, match=r"No space left on device.*call again to continue"):
        run(tmp_path)
    monkeypatch.undo()
    folder = tmp_path / "data.zarr"
    with LedgerReader.open_existing(tmp_path) as record:
        n_done = len(record.finished_blocks())
    assert n_done < 15
    assert len(list((folder / "cube").glob("c.*"))) >= n_done
    assert not list(folder.rglob(".*"))
    with pytest.raises(DechirpError, match="without a complete data set"):
        read_data_set(folder)
    run(tmp_path)
    assert fingerprint(tmp_path) == fingerprint(undisturbed)


def test_a_disk_without_room_is_refused_and_the_folder_is_free_for_a_smaller_one(
    tmp_path, monkeypatch
):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(10**6, 10**6 - 10**5, 10**5))
    out = tmp_path / "new"
    with pytest.raises(DechirpError, match="disk with 100 kB of free space"):
        run(out)
    assert not out.exists()
    run(out, study(keep=("detections",)))
    assert read_data_set(out / "data.zarr")


def test_files_that_have_gone_are_missed_before_it_goes_on(tmp_path):
    run(tmp_path, study(keep=("maps",)))
    (tmp_path / "data.zarr" / "zarr.json").unlink()
    (tmp_path / "data.zarr" / "power" / "c.1.2.0.0.0").unlink()
    with pytest.raises(DechirpError, match=r"without power/c\.1\.2\.0\.0\.0"):
        run(tmp_path, study(keep=("maps",)))


def test_a_data_set_whose_record_has_gone_is_not_written_over(tmp_path):
    run(tmp_path, study(keep=("detections",)))
    before = fingerprint(tmp_path)
    (tmp_path / "study.sqlite").unlink()
    with pytest.raises(DechirpError, match="whose ledger is missing"):
        run(tmp_path, study(keep=("detections",), seed=9))
    assert fingerprint(tmp_path) == before


def test_detections_that_are_drawn_make_a_data_set_too(tmp_path):
    asked = study(sensor="statistical", keep=("detections",))
    run(tmp_path, asked)
    data = read_data_set(tmp_path / "data.zarr")
    assert "cube" not in data[""]
    look = replay_trial(asked, 11, point=2).trial_result
    rows = data["detections"]
    own = slice(int(rows.start[2, 11]), int(rows.stop[2, 11]))
    np.testing.assert_array_equal(rows.range[own], look.detections["range"])
    np.testing.assert_array_equal(rows.target[own], look.association.target)


def test_what_is_drawn_in_each_trial_is_told_of_each(tmp_path):
    place = RandomSetting(
        path="scene.targets.car.position.0", distribution="uniform", first=10, second=30, unit="m"
    )
    asked = study(vary=(place,), keep=("detections",))
    run(tmp_path, asked)
    data = read_data_set(tmp_path / "data.zarr")
    drawn = data["settings"][place.path]
    assert drawn.dims == ("trial",)
    assert len(np.unique(drawn)) == 23
    middle_s = data[""].frame_time.values[0, 0]
    known = data["truth"].range.sel(target="car")[0, :, 0]
    np.testing.assert_allclose(known, drawn + 3.0 * middle_s)


@pytest.mark.parametrize("first", [(), ("detections",)])
def test_a_study_that_begins_or_ends_to_keep_is_refused_for_that_alone(tmp_path, first):
    other = ("detections",) if not first else ()
    open_ledger(study(keep=first), tmp_path).close()
    with pytest.raises(DechirpError) as refused:
        open_ledger(study(keep=other, at_most_bytes=10**9), tmp_path)
    assert [one.setting for one in refused.value.mistakes] == ["keep"]


def test_room_that_is_confirmed_is_in_the_text_with_and_without_a_data_set():
    assert "at_most_bytes: 1000000000" in dump_study(study(keep=(), at_most_bytes=10**9))
    assert "at_most_bytes" not in dump_study(study())


def test_a_study_without_a_data_set_is_what_it_was(tmp_path):
    plain = study(keep=())
    assert "keep" not in dump_study(plain)
    assert "at_most_bytes" not in dump_study(plain)
    run(tmp_path, plain)
    assert not (tmp_path / "data.zarr").exists()
    with LedgerReader.open_existing(tmp_path) as record:
        assert not list(record.iter_items())


def test_scores_do_not_depend_on_what_is_kept(tmp_path, undisturbed):
    run(tmp_path, study(keep=()))
    with (
        LedgerReader.open_existing(tmp_path) as one,
        LedgerReader.open_existing(undisturbed) as other,
    ):
        for point in range(3):
            np.testing.assert_array_equal(one.point_sums(point), other.point_sums(point))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"keep": ("cubes",), "sensor": "statistical"}, "cubes, with sensor: statistical"),
        ({"keep": ("maps", "maps")}, "maps twice"),
        ({"keep": ("cube",)}, "'cube'; expected some of cubes, maps, detections"),
        ({"at_most_bytes": 0}, "at_most_bytes"),
    ],
)
def test_what_cannot_be_kept_is_refused(changed, says):
    with pytest.raises(InvalidSetting, match=says):
        study(**changed)


CHIRPS = SweptSetting(path="radar.frame.n_chirps", texts=("32", "64"), numbers=(32.0, 64.0))
START = RandomSetting(
    path="radar.frame.chirp.start_frequency",
    distribution="uniform",
    first=76,
    second=77,
    unit="GHz",
)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"at_most_bytes": 10**6}, r"1.41 MB in 69 items.*confirm it: at_most_bytes: 1413120"),
        ({"vary": (CHIRPS,)}, r"64, with samples \(1, 64, 2, 64, 2\)"),
        ({"vary": (START,)}, "drawn in each trial, which change velocity_bins"),
    ],
)
def test_data_sets_that_cannot_be_are_refused_before_any_trial(tmp_path, changed, says):
    with pytest.raises(InvalidSetting, match=says):
        run(tmp_path / "out", study(**changed))
    assert not (tmp_path / "out").exists()


def test_maps_of_triangles_are_refused(tmp_path):
    radar = study().scenario.radar
    frame = replace(radar.frame, modulation=Triangular())
    asked = study(scenario=replace(study().scenario, radar=replace(radar, frame=frame)))
    with pytest.raises(InvalidSetting, match="rise and fall"):
        run(tmp_path, asked)


def test_the_size_is_that_of_the_arrays(undisturbed):
    group = zarr.open_group(undisturbed / "data.zarr", mode="r")
    assert data_bytes(Plan.from_study(study())) == group["cube"].nbytes + group["power"].nbytes


def test_all_that_the_truth_has_is_described(data):
    assert set(TRUTH_COLUMNS) == {str(name) for name in data["truth"].data_vars}
    assert all(of.attrs["units"] and of.attrs["long_name"] for of in data["truth"].values())


def test_a_file_says_what_is_kept_and_is_refused_with_its_line(tmp_path):
    dc_study = tmp_path / "study.yaml"
    dc_study.write_text(dump_study(study()))
    assert dc.load_study(dc_study) == study()
    dc_study.write_text(dump_study(study()).replace("maps", "mpas"))
    with pytest.raises(InvalidFile, match=r"keep.*mpas; expected"):
        dc.load_study(dc_study)


def test_the_datasheet_says_what_is_there_and_asks_for_no_other_file(undisturbed, data):
    page = render_data_set_page(study(), data, n_bytes=total_bytes(undisturbed / "data.zarr"))
    assert "69 items: cubes, maps and detections, with truth" in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    for group in data.values():
        for name in group.variables:
            assert f"<td>{name}</td>" in page
    # Each point, and so each value, has as many items.
    assert page.count('<td class="num">23</td>') == 3
    assert page == render_data_set_page(
        study(), data, n_bytes=total_bytes(undisturbed / "data.zarr")
    )
    check_captions(page)
    check_pdf(page)


def test_the_python_of_the_datasheet_reads_an_item(undisturbed, data, monkeypatch):
    code = re.search(
        r"<pre>(import numpy.*?)</pre>", render_data_set_page(study(), data, n_bytes=0), re.DOTALL
    )
    monkeypatch.chdir(undisturbed)
    names: dict = {}
    exec(html.unescape(code[1]), names)
    found, _ = samples(data, 0, 0)
    np.testing.assert_array_equal(names["samples"].view(np.complex64)[..., 0], found)
    assert names["level_dbw"].shape == (1, 32, 64)
    assert names["own"].sizes["detection"] == int(data["detections"].stop[0, 0])
    assert dict(names["known"].sizes) == {"frame": 1, "target": 2}


def test_the_command_makes_the_data_set_and_its_datasheet(tmp_path, capsys):
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    file.write_text(dump_study(study(trials=TrialBudget(at_most=4, block=2), vary=())))
    for _ in range(2):  # the second time nothing is left to do
        with pytest.raises(SystemExit) as ended:
            main(["study", str(file), "--workers", "1", "--out", str(out), "--pdf"])
        assert ended.value.code == 0
        said = " ".join(capsys.readouterr().out.split())
        assert "Data set: at most 4 items, 81.9 kB of samples and maps" in said
        assert "datasheet.html" in said
    assert read_data_set(out / "data.zarr")[""].made.all()
    assert "<title>4 items" in (out / "datasheet.html").read_text()
    files = json.loads((out / "study.json").read_text())["files"]
    for name in ("report", "datasheet"):
        page = (out / f"{name}.html").read_text()
        assert Path(files[f"{name}.pdf"]).read_bytes() == check_pdf(page)
