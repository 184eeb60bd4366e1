"""Data sets of studies: stored items against replayed trials, interruption and datasheet."""

import errno
import html
import json
import os
import re
import shutil
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
from data_set_study import file_digests, make_adaptive_study, make_study, run_to_folder
from dechirp.cli.main import main
from dechirp.core.errors import DechirpError, InvalidFile, InvalidSetting, RecordingError
from dechirp.experiments.study import trial as trials
from dechirp.experiments.study.data_set import uncompressed_data_set_bytes
from dechirp.experiments.study.data_set_items import TRUTH_COLUMNS
from dechirp.experiments.study.dumping import dump_study_as_yaml
from dechirp.experiments.study.ledger_reader import LedgerReader
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.run import create_or_continue_ledger, replay_trial
from dechirp.experiments.study.study import RandomSetting, SweptSetting, TrialBudget
from dechirp.radar.modulations.triangular import Triangular
from dechirp.report.data_set import render_data_set_page
from dechirp.results import shards
from dechirp.results.data_set import folder_size_bytes, open_data_set_groups
from dechirp.results.xarray_engine import DechirpBackend
from dechirp.simulation.adc_codes import extract_adc_codes
from dechirp.simulation.impairments.noise import ThermalNoise
from dechirp.simulation.impairments.quantisation import Quantisation
from nightly import nightly, nightly_except
from page_checks import check_captions, check_pdf_contains_page_text, skip_without_pdf
from trial_cases import small_radar

ITEMS = [(0, 0), (1, 22), (2, 7)]


@pytest.fixture(scope="module")
def undisturbed_folder(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed")
    run_to_folder(out)
    return out


@pytest.fixture(scope="module")
def data(undisturbed_folder) -> dict[str, xr.Dataset]:
    return open_data_set_groups(undisturbed_folder / "data.zarr")


def test_engine_of_xarray_opens_groups_lazily(undisturbed_folder, data):
    folder = undisturbed_folder / "data.zarr"
    samples = xr.open_dataset(folder, engine=DechirpBackend)
    assert not isinstance(samples.cube.variable._data, np.ndarray)
    assert samples.cube.encoding["preferred_chunks"]["trial"] == 1
    xr.testing.assert_identical(samples.load(), data[""].load())
    truth = xr.open_dataset(folder, engine=DechirpBackend, group="truth")
    xr.testing.assert_identical(truth, data["truth"])


def read_samples(data, point, trial):
    """Read the samples of an item, (frame, chirp, rx, sample), and their scale."""
    numbers, scale = data[""].cube[point, trial].values, data[""].cube_scale[point, trial].values
    return (numbers * np.float32(scale)).view(np.complex64)[..., 0], float(scale)


@pytest.mark.parametrize(("point", "trial"), ITEMS)
def test_samples_of_item_match_trial_within_half_a_step(data, point, trial):
    cube = replay_trial(make_study(), trial, point=point).result.cube
    stored_item, scale = read_samples(data, point, trial)
    error = stored_item - cube.values
    parts = np.maximum(abs(error.real), abs(error.imag))
    assert parts.max() <= (0.5 + 1e-2) * scale  # plus rounding of single precision
    assert parts.max() > 0.4 * scale
    peak = max(abs(cube.values.real).max(), abs(cube.values.imag).max())
    assert scale == pytest.approx(peak / 32767)


@pytest.mark.parametrize(("point", "trial"), ITEMS)
def test_map_matches_trial_within_half_a_hundredth_of_a_db(data, point, trial):
    power = replay_trial(make_study(), trial, point=point).result.power
    stored_item = data[""].power[point, trial, 0]  # xarray applies the scale factor
    np.testing.assert_allclose(
        stored_item.values, 10 * np.log10(power.values), rtol=0, atol=0.00501
    )
    np.testing.assert_allclose(data[""].range_bins[point], power.range)
    np.testing.assert_allclose(data[""].velocity_bins[point, 0], power.velocity)


@pytest.mark.parametrize(("point", "trial"), ITEMS)
def test_detections_and_truth_of_item_match_trial(data, point, trial):
    replayed_trial = replay_trial(make_study(), trial, point=point)
    rows = data["detections"]
    start, stop = int(rows.start[point, trial]), int(rows.stop[point, trial])
    rows_of_item = rows.isel(detection=slice(start, stop))
    assert stop - start == replayed_trial.result.detections.sizes["detection"]
    for name, column in replayed_trial.result.detections.items():
        np.testing.assert_array_equal(rows_of_item[name], column)
        assert rows_of_item[name].attrs["units"] == column.attrs["units"]
    np.testing.assert_array_equal(
        rows_of_item.target, replayed_trial.trial_result.association.target
    )
    truth = replayed_trial.result.truth.transpose("frame", "target")
    for name in ("range", "velocity", "azimuth", "elevation", "snr"):
        np.testing.assert_array_equal(data["truth"][name][point, trial], truth[name])
    assert list(data["truth"].target.values) == ["car", "van"]
    np.testing.assert_allclose(
        data["truth"].rcs[point, trial, 0], [10 ** (data_set_study.RCS.numbers[point] / 10), 3]
    )


def test_map_peak_of_target_lies_at_its_true_map_position(data):
    """The van has 25 dB SNR in each map; its peak lies within half a cell."""
    for point, trial in ITEMS:
        power = data[""].power[point, trial, 0].values
        truth = data["truth"].isel(point=point, trial=trial, frame=0, target=1)
        row = np.argmin(abs(data[""].velocity_bins[point, 0].values - float(truth.map_velocity)))
        column = np.argmin(abs(data[""].range_bins[point].values - float(truth.map_range)))
        neighbourhood = power[row - 4 : row + 5, column - 4 : column + 5]
        assert np.unravel_index(neighbourhood.argmax(), neighbourhood.shape) == (4, 4)


def test_detection_rows_follow_order_of_items(data):
    starts, stops = (data["detections"][name].values.ravel() for name in ("start", "stop"))
    np.testing.assert_array_equal(starts[1:], stops[:-1])
    assert stops[-1] == data["detections"].sizes["detection"] > 0


def test_every_item_is_marked_made_and_settings_are_stored(data):
    assert data[""].made.all()
    np.testing.assert_array_equal(data["settings"][data_set_study.RCS.path], [-20, -10, 0])
    assert data["settings"][data_set_study.RCS.path].attrs["units"] == "dBsm"
    assert "-10 dBsm" in str(data[""].scenario[1].values)


def test_data_set_opens_with_zarr_and_has_one_file_per_block(undisturbed_folder):
    group = zarr.open_group(undisturbed_folder / "data.zarr", mode="r")
    assert group["cube"].shape == (3, 23, 1, 32, 2, 64, 2)
    assert group["cube"].dtype == "int16"
    assert group["cube"].metadata.dimension_names[:2] == ("point", "trial")
    # One file per block.
    assert len(list((undisturbed_folder / "data.zarr" / "cube").iterdir())) == 3 * 5 + 1


def test_adc_codes_are_stored_unchanged(tmp_path):
    noise = (ThermalNoise(), Quantisation(bits=10, full_scale_w=1e-9))
    kept_study = make_study(
        scenario=replace(make_study().scenario, impairments=noise),
        trials=TrialBudget(at_most=5, block=5),
        keep=("cubes",),
    )
    run_to_folder(tmp_path, kept_study)
    data = open_data_set_groups(tmp_path / "data.zarr")
    cube = replay_trial(kept_study, 4, point=2).result.cube
    np.testing.assert_array_equal(data[""].cube[2, 4], extract_adc_codes(cube).values)
    stored_item, scale = read_samples(data, 2, 4)
    np.testing.assert_array_equal(stored_item, cube.values)
    assert scale == cube.attrs["scale"]


@nightly
def test_real_samples_have_no_iq_axis(tmp_path):
    kept_study = make_study(
        scenario=replace(make_study().scenario, radar=small_radar(1, "real")), keep=("cubes",)
    )
    run_to_folder(tmp_path, kept_study)
    data = open_data_set_groups(tmp_path / "data.zarr")[""]
    cube = replay_trial(kept_study, 1).result.cube.values
    scale = float(data.cube_scale[0, 1])
    np.testing.assert_allclose(data.cube[0, 1] * scale, cube, rtol=0, atol=0.51 * scale)


@nightly
def test_block_larger_than_shard_is_divided_evenly(tmp_path, monkeypatch, undisturbed_folder):
    item_bytes = 2 * 32 * 2 * 64 * 2
    monkeypatch.setattr(shards, "SHARD_BYTES", 4 * item_bytes)  # blocks of 6: three, not four
    divided_study = make_study(trials=TrialBudget(at_most=23, block=6), keep=("cubes",))
    run_to_folder(tmp_path, divided_study)
    group = zarr.open_group(tmp_path / "data.zarr", mode="r")
    assert group["cube"].shards[1] == 3
    reference_group = zarr.open_group(undisturbed_folder / "data.zarr", mode="r")
    np.testing.assert_array_equal(group["cube"][:], reference_group["cube"][:])


@nightly
def test_data_set_does_not_depend_on_number_of_workers(tmp_path, undisturbed_folder):
    dc.run_study(make_study(), tmp_path)
    assert file_digests(tmp_path) == file_digests(undisturbed_folder)


@nightly
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_study_killed_at_random_moments_gives_same_data_set(tmp_path, undisturbed_folder):
    rng = np.random.default_rng(8)
    was_interrupted = False
    for moment_s in rng.uniform(0.0, 1.0, 12):
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
            was_interrupted = True  # the temporary file imitates a worker killed while writing
            (folder / ".c.0.0.0.0.0.0.0.deadbeef").write_bytes(b"half")
    assert was_interrupted
    run_to_folder(tmp_path)
    assert file_digests(tmp_path) == file_digests(undisturbed_folder)


def test_repeated_call_of_finished_study_changes_nothing(tmp_path, undisturbed_folder):
    shutil.copytree(undisturbed_folder, tmp_path, dirs_exist_ok=True)
    earlier_state = {file: file.stat().st_mtime_ns for file in (tmp_path / "data.zarr").rglob("*")}
    run_to_folder(tmp_path)
    assert {
        file: file.stat().st_mtime_ns for file in (tmp_path / "data.zarr").rglob("*")
    } == earlier_state


@nightly
def test_stopped_points_leave_no_items_past_their_end(tmp_path):
    run_to_folder(tmp_path, make_adaptive_study())
    with LedgerReader.open_read_only(tmp_path) as record:
        lengths = [len(record.trial_sums_of_point(point)) for point in range(3)]
    assert min(lengths) < 23
    data = open_data_set_groups(tmp_path / "data.zarr")
    np.testing.assert_array_equal(data[""].made.sum("trial"), lengths)
    for point, n in enumerate(lengths):
        assert data[""].made[point, :n].all()
        assert not data[""].cube[point, n:].any()
        assert np.isnan(data["truth"].range[point, n:]).all()
        names = {file.name for file in (tmp_path / "data.zarr" / "power").glob(f"c.{point}.*")}
        assert len(names) == -(-n // 5)
    # The result does not depend on the number of workers.
    dc.run_study(make_adaptive_study(), tmp_path / "two")
    assert file_digests(tmp_path / "two") == file_digests(tmp_path)


@nightly
def test_failed_trial_is_item_of_zeros_marked_not_made(tmp_path, monkeypatch, data):
    processor_class, calls = trials.FrameProcessor, []

    def fail_once(*args, **kwargs):
        calls.append(1)
        if len(calls) == 7:
            raise ValueError("a bad day")
        return processor_class(*args, **kwargs)

    monkeypatch.setattr(trials, "FrameProcessor", fail_once)
    run_to_folder(tmp_path, make_study(stop_after_failures=0.5))
    stored_item = open_data_set_groups(tmp_path / "data.zarr")
    assert np.argwhere(~stored_item[""].made.values).tolist() == [[0, 6]]
    assert not stored_item[""].cube[0, 6].any()
    assert stored_item["detections"].start[0, 6] == stored_item["detections"].stop[0, 6]
    np.testing.assert_array_equal(stored_item[""].cube[0, 7], data[""].cube[0, 7])
    rows = data["detections"]
    n_lost = int(rows.stop[0, 6] - rows.start[0, 6])
    assert stored_item["detections"].sizes["detection"] == rows.sizes["detection"] - n_lost


@nightly
def test_full_disk_stops_data_set_and_counts_only_stored_items(
    tmp_path, monkeypatch, undisturbed_folder
):
    fsync, calls = os.fsync, []

    def fail_on_full_disk(file):
        calls.append(1)
        if len(calls) > 9:
            raise OSError(errno.ENOSPC, "No space left on device")
        return fsync(file)

    monkeypatch.setattr(shards.os, "fsync", fail_on_full_disk)
    with pytest.raises(DechirpError, match=r"No space left on device.*call again to continue"):
        run_to_folder(tmp_path)
    monkeypatch.undo()
    folder = tmp_path / "data.zarr"
    with LedgerReader.open_read_only(tmp_path) as record:
        n_done = len(record.saved_point_and_block_numbers())
    assert n_done < 15
    assert len(list((folder / "cube").glob("c.*"))) >= n_done
    assert not list(folder.rglob(".*"))
    with pytest.raises(DechirpError, match="without a complete data set"):
        open_data_set_groups(folder)
    run_to_folder(tmp_path)
    assert file_digests(tmp_path) == file_digests(undisturbed_folder)


@pytest.mark.parametrize(
    "change",
    [
        lambda root: [],
        lambda root: root | {"node_type": "array"},
        lambda root: root | {"consolidated_metadata": {"kind": "inline", "metadata": {"made": 1}}},
        lambda root: _change_consolidated_array(root, "made", codecs=[{"name": "unknown"}]),
        lambda root: _change_consolidated_array(root, "made", chunk_key_encoding="c"),
    ],
)
def test_damaged_metadata_raise_recording_error_with_folder_and_fix(
    undisturbed_folder, tmp_path, change
):
    folder = tmp_path / "data.zarr"
    shutil.copytree(undisturbed_folder / "data.zarr", folder)
    root = json.loads((folder / "zarr.json").read_text())
    (folder / "zarr.json").write_text(json.dumps(change(root)))
    with pytest.raises(RecordingError) as caught:
        open_data_set_groups(folder)
    (mistake,) = caught.value.mistakes
    assert mistake.file == str(folder) and mistake.fix


@pytest.mark.parametrize(
    ("length", "message"), [(10**12, "at most twice"), (10**5, "without 99999 of")]
)
def test_wrong_shape_of_coordinate_is_rejected_before_reading(
    undisturbed_folder, tmp_path, length, message
):
    # Opening loads coordinates: 10^12 names exceed the memory, 10^5 absent chunks take a minute.
    folder = tmp_path / "data.zarr"
    shutil.copytree(undisturbed_folder / "data.zarr", folder)
    file = folder / "truth" / "zarr.json"
    grid = {"name": "regular", "configuration": {"chunk_shape": [1]}}
    group = _change_consolidated_array(
        json.loads(file.read_text()), "target", shape=[length], chunk_grid=grid
    )
    file.write_text(json.dumps(group))
    with pytest.raises(RecordingError, match=message):
        open_data_set_groups(folder)


@pytest.mark.parametrize(
    ("group", "name"),
    nightly_except(1, [("", "cube"), ("", "made"), ("truth", "range"), ("detections", "range")]),
)
def test_damaged_values_raise_recording_error_with_folder_when_loaded(
    undisturbed_folder, tmp_path, group, name
):
    folder = tmp_path / "data.zarr"
    shutil.copytree(undisturbed_folder / "data.zarr", folder)
    files = [f for f in (folder / group / name).rglob("*") if f.is_file() and f.suffix != ".json"]
    assert files
    for file in files:
        file.write_bytes(file.read_bytes()[:-5])
    array = open_data_set_groups(folder)[group][name]
    assert open_data_set_groups(undisturbed_folder / "data.zarr")[group][name].load().size
    for load in (array.to_numpy, array[:1].load, array.mean):
        with pytest.raises(RecordingError) as caught:
            load()
        assert caught.value.mistakes[0].file == str(folder)


def _change_consolidated_array(root, name, **changes):
    """Change the metadata of an array in the root group of a data set."""
    root["consolidated_metadata"]["metadata"][name] |= changes
    return root


@nightly
def test_disk_without_room_is_refused_and_folder_stays_free(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage(10**6, 10**6 - 10**5, 10**5))
    out = tmp_path / "new"
    with pytest.raises(DechirpError, match="disk with 100 kB of free space"):
        run_to_folder(out)
    assert not out.exists()
    run_to_folder(out, make_study(keep=("detections",)))
    assert open_data_set_groups(out / "data.zarr")


@nightly
def test_missing_data_set_files_are_reported_before_continuing(tmp_path):
    run_to_folder(tmp_path, make_study(keep=("maps",)))
    (tmp_path / "data.zarr" / "zarr.json").unlink()
    (tmp_path / "data.zarr" / "power" / "c.1.2.0.0.0").unlink()
    with pytest.raises(DechirpError, match=r"without power/c\.1\.2\.0\.0\.0"):
        run_to_folder(tmp_path, make_study(keep=("maps",)))


@nightly
def test_data_set_without_ledger_is_not_overwritten(tmp_path):
    run_to_folder(tmp_path, make_study(keep=("detections",)))
    earlier_state = file_digests(tmp_path)
    (tmp_path / "study.sqlite").unlink()
    with pytest.raises(DechirpError, match="whose ledger is missing"):
        run_to_folder(tmp_path, make_study(keep=("detections",), seed=9))
    assert file_digests(tmp_path) == earlier_state


@nightly
def test_statistical_detections_make_a_data_set(tmp_path):
    budget = TrialBudget(at_most=12, block=5)
    kept_study = make_study(sensor="statistical", trials=budget, keep=("detections",))
    run_to_folder(tmp_path, kept_study)
    data = open_data_set_groups(tmp_path / "data.zarr")
    assert "cube" not in data[""]
    trial_result = replay_trial(kept_study, 11, point=2).trial_result
    rows = data["detections"]
    rows_of_item = slice(int(rows.start[2, 11]), int(rows.stop[2, 11]))
    np.testing.assert_array_equal(rows.range[rows_of_item], trial_result.detections["range"])
    np.testing.assert_array_equal(rows.target[rows_of_item], trial_result.association.target)


@nightly
def test_random_setting_of_each_trial_is_stored(tmp_path):
    position_setting = RandomSetting(
        path="scene.targets.car.position.0", distribution="uniform", first=10, second=30, unit="m"
    )
    kept_study = make_study(vary=(position_setting,), keep=("detections",))
    run_to_folder(tmp_path, kept_study)
    data = open_data_set_groups(tmp_path / "data.zarr")
    positions = data["settings"][position_setting.path]
    assert positions.dims == ("trial",)
    assert len(np.unique(positions)) == 23
    mid_frame_s = data[""].frame_time.values[0, 0]
    true_ranges = data["truth"].range.sel(target="car")[0, :, 0]
    np.testing.assert_allclose(true_ranges, positions + 3.0 * mid_frame_s)


@pytest.mark.parametrize("first_keep", [(), ("detections",)])
def test_study_with_other_kept_parts_is_refused_for_keep_alone(tmp_path, first_keep):
    second_keep = ("detections",) if not first_keep else ()
    create_or_continue_ledger(make_study(keep=first_keep), tmp_path).close()
    with pytest.raises(DechirpError) as error:
        create_or_continue_ledger(make_study(keep=second_keep, at_most_bytes=10**9), tmp_path)
    assert [mistake.setting for mistake in error.value.mistakes] == ["keep"]


def test_confirmed_size_is_dumped_with_and_without_data_set():
    assert "at_most_bytes: 1000000000" in dump_study_as_yaml(
        make_study(keep=(), at_most_bytes=10**9)
    )
    assert "at_most_bytes" not in dump_study_as_yaml(make_study())


@nightly
def test_study_without_data_set_stores_no_items(tmp_path):
    plain = make_study(keep=())
    assert "keep" not in dump_study_as_yaml(plain)
    assert "at_most_bytes" not in dump_study_as_yaml(plain)
    run_to_folder(tmp_path, plain)
    assert not (tmp_path / "data.zarr").exists()
    with LedgerReader.open_read_only(tmp_path) as record:
        assert not list(record.iter_packed_items())


@nightly
def test_scores_do_not_depend_on_kept_parts(tmp_path, undisturbed_folder):
    run_to_folder(tmp_path, make_study(keep=()))
    with (
        LedgerReader.open_read_only(tmp_path) as ledger,
        LedgerReader.open_read_only(undisturbed_folder) as reference_ledger,
    ):
        for point in range(3):
            np.testing.assert_array_equal(
                ledger.trial_sums_of_point(point), reference_ledger.trial_sums_of_point(point)
            )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"keep": ("cubes",), "sensor": "statistical"}, "cubes, with sensor: statistical"),
        ({"keep": ("maps", "maps")}, "maps twice"),
        ({"keep": ("cube",)}, "'cube'; expected some of cubes, maps, detections"),
        ({"at_most_bytes": 0}, "at_most_bytes"),
    ],
)
def test_rejects_invalid_keep_settings(changed, message):
    with pytest.raises(InvalidSetting, match=message):
        make_study(**changed)


CHIRPS = SweptSetting(path="radar.frame.n_chirps", texts=("32", "64"), numbers=(32.0, 64.0))
START = RandomSetting(
    path="radar.frame.chirp.start_frequency",
    distribution="uniform",
    first=76,
    second=77,
    unit="GHz",
)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"at_most_bytes": 10**6}, r"1.41 MB in 69 items.*confirm it: at_most_bytes: 1413120"),
        ({"vary": (CHIRPS,)}, r"64, with samples \(1, 64, 2, 64, 2\)"),
        ({"vary": (START,)}, "drawn in each trial, which change velocity_bins"),
    ],
)
def test_rejects_impossible_data_sets_before_any_trial(tmp_path, changed, message):
    with pytest.raises(InvalidSetting, match=message):
        run_to_folder(tmp_path / "out", make_study(**changed))
    assert not (tmp_path / "out").exists()


def test_rejects_maps_of_triangular_modulation(tmp_path):
    radar = make_study().scenario.radar
    frame = replace(radar.frame, modulation=Triangular())
    kept_study = make_study(
        scenario=replace(make_study().scenario, radar=replace(radar, frame=frame))
    )
    with pytest.raises(InvalidSetting, match="rise and fall"):
        run_to_folder(tmp_path, kept_study)


def test_data_set_size_equals_array_bytes(undisturbed_folder):
    group = zarr.open_group(undisturbed_folder / "data.zarr", mode="r")
    assert (
        uncompressed_data_set_bytes(Plan.from_study(make_study()))
        == group["cube"].nbytes + group["power"].nbytes
    )


def test_every_truth_column_has_units_and_description(data):
    assert set(TRUTH_COLUMNS) == {str(name) for name in data["truth"].data_vars}
    assert all(
        column.attrs["units"] and column.attrs["long_name"] for column in data["truth"].values()
    )


def test_study_file_sets_keep_and_is_refused_with_its_line(tmp_path):
    dc_study = tmp_path / "study.yaml"
    dc_study.write_text(dump_study_as_yaml(make_study()))
    assert dc.load_study(dc_study) == make_study()
    dc_study.write_text(dump_study_as_yaml(make_study()).replace("maps", "mpas"))
    with pytest.raises(InvalidFile, match=r"keep.*mpas; expected"):
        dc.load_study(dc_study)


@nightly
def test_datasheet_lists_contents_and_is_self_contained(undisturbed_folder, data):
    page = render_data_set_page(
        make_study(), data, n_bytes=folder_size_bytes(undisturbed_folder / "data.zarr")
    )
    assert "69 items: cubes, maps and detections, with truth" in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    for group in data.values():
        for name in group.variables:
            assert f"<td>{name}</td>" in page
    # Each point, and therefore each value, has the same number of items.
    assert page.count('<td class="num">23</td>') == 3
    assert page == render_data_set_page(
        make_study(), data, n_bytes=folder_size_bytes(undisturbed_folder / "data.zarr")
    )
    check_captions(page)
    check_pdf_contains_page_text(page)


@nightly
def test_python_code_of_datasheet_reads_an_item(undisturbed_folder, data, monkeypatch):
    code = re.search(
        r"<pre>(import numpy.*?)</pre>",
        render_data_set_page(make_study(), data, n_bytes=0),
        re.DOTALL,
    )
    monkeypatch.chdir(undisturbed_folder)
    names: dict = {}
    exec(html.unescape(code[1]), names)
    stored_item, _ = read_samples(data, 0, 0)
    np.testing.assert_array_equal(names["samples"].view(np.complex64)[..., 0], stored_item)
    assert names["level_dbw"].shape == (1, 32, 64)
    assert names["own"].sizes["detection"] == int(data["detections"].stop[0, 0])
    assert dict(names["known"].sizes) == {"frame": 1, "target": 2}


@nightly
def test_command_writes_data_set_and_datasheet(tmp_path, capsys):
    skip_without_pdf()
    file, out = tmp_path / "study.yaml", tmp_path / "out"
    file.write_text(dump_study_as_yaml(make_study(trials=TrialBudget(at_most=4, block=2), vary=())))
    for _ in range(2):  # the second call finds the study finished
        with pytest.raises(SystemExit) as exit_info:
            main(["study", str(file), "--workers", "1", "--out", str(out), "--pdf"])
        assert exit_info.value.code == 0
        output = " ".join(capsys.readouterr().out.split())
        assert "Data set: at most 4 items, 81.9 kB of samples and maps" in output
        assert "datasheet.html" in output
    assert open_data_set_groups(out / "data.zarr")[""].made.all()
    assert "<title>4 items" in (out / "datasheet.html").read_text()
    files = json.loads((out / "study.json").read_text())["files"]
    for name in ("report", "datasheet"):
        page = (out / f"{name}.html").read_text()
        check_pdf_contains_page_text(page, Path(files[f"{name}.pdf"]).read_bytes())
