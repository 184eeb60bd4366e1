"""`dechirp study`: files, trials, reproducibility and errors, with a small and fast radar."""

import json
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from markupsafe import Markup

import dechirp as dc
from dechirp.cli.main import main
from dechirp.experiments.study import executors
from dechirp.experiments.study.ledger import LedgerReader
from dechirp.experiments.study.run import replay_trial
from dechirp.results.parquet import read_parquet
from nightly import nightly

EXAMPLES = Path(dc.__file__).parents[2] / "examples" / "studies"

STUDY = """
name: small
seed: 5
scenario:
  radar:
    frame:
      chirp: {start_frequency: 77 GHz, slope: 10 MHz/us, adc_start: 1 us, ramp_duration: 8 us,
              sample_rate: 10 MHz, n_samples: 64, sampling: complex}
      n_chirps: 32
      interval: 10 us
    hardware: {transmit_power: 12 dBm, antenna_gain: 10 dBi, noise_factor: 12 dB}
  scene:
    targets:
      - {name: car, position: [30 m, 0, 0], velocity: [5 m/s, 0, 0], rcs: 1 dBsm}
      - {name: van, position: [70 m, 0, 0], velocity: [-12 m/s, 0, 0], rcs: 12 dBsm}
  impairments: [{kind: white-noise, snr: -18 dB, target: car}]
  chain: {cfar: {estimator: {kind: cell-averaging}, n_training: {range: 6, velocity: 4},
                 n_guard: {range: 2, velocity: 2}, false_alarm_probability: 1e-4}}
vary:
  impairments.white-noise.snr: {from: -24 dB, to: -16 dB, step: 4 dB}
  chain.range_window: [hann, rectangular]
trials: {at_most: 40, block: 15}
scores: [detection_probability, false_alarm_probability, range_rmse, resolution_probability]
require:
  - {score: detection_probability, target: car, points: {impairments.white-noise.snr: -16 dB},
     at_least: 0.5, confidence: 0.99}
"""


@pytest.fixture
def study_file(tmp_path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(STUDY)
    return path


@pytest.fixture
def without_study_figures(monkeypatch) -> None:
    monkeypatch.setattr("dechirp.report.study.figures.render_svg", lambda *_, **__: Markup(""))


def get_exit_status(*arguments: object) -> int:
    with pytest.raises(SystemExit) as exit_info:
        main([str(word) for word in arguments])
    return int(exit_info.value.code)


@nightly
@pytest.mark.usefixtures("without_study_figures")
def test_study_runs_and_repeated_call_gives_same_rows(study_file, tmp_path, capsys):
    out = tmp_path / "out"
    options = ("--set", "trials.at_most=20", "--out", out, "--json")
    assert get_exit_status("study", study_file, "--workers", 1, *options) == 0
    document = json.loads(capsys.readouterr().out)

    assert {"version", "rows", "done", "total", "require", "files"} <= set(document)
    assert document["done"] == document["total"] == 6 * 20
    assert all(Path(path).is_file() for path in document["files"].values())
    (limit,) = document["require"]
    assert limit["decision"] == "met"
    for row in document["rows"]:
        rate = row["detection_probability"]["targets"]["car"]
        assert rate["low"] <= rate["value"] <= rate["high"]
        assert 0 <= rate["theory"] <= 1
    table = read_parquet(out / "points.parquet")
    np.testing.assert_array_equal(table["trials"], 20)
    assert len(read_parquet(out / "trials.parquet")["trial"]) == 120
    page = (out / "report.html").read_text()
    assert 'src="http' not in page

    assert get_exit_status("study", study_file, *options) == 0
    assert json.loads(capsys.readouterr().out)["rows"] == document["rows"]


@nightly
def test_tables_are_csv_files_without_parquet_extra(study_file, tmp_path, capsys, monkeypatch):
    out = tmp_path / "out"
    command = ("study", study_file, "--workers", 1, "--set", "trials.at_most=4", "--out", out)
    monkeypatch.setitem(sys.modules, "duckdb", None)
    get_exit_status(*command)
    assert "'dechirp[parquet]'" in capsys.readouterr().out
    without_extra = {name: pd.read_csv(out / f"{name}.csv") for name in ("points", "trials")}
    assert not list(out.glob("*.parquet"))
    get_exit_status(*command, "--json")
    files = json.loads(capsys.readouterr().out)["files"]
    assert {"points.csv", "trials.csv"} < set(files)
    assert all(Path(path).is_file() for path in files.values())

    monkeypatch.undo()
    get_exit_status(*command)
    assert "dechirp[parquet]" not in capsys.readouterr().out
    for name, table in without_extra.items():
        with_extra = read_parquet(out / f"{name}.parquet")
        assert list(table) == list(with_extra)
        np.testing.assert_array_equal(table["point"], with_extra["point"])
    assert not list(out.glob("*.csv"))


@nightly
def test_trials_are_bit_identical_in_threads_and_processes(study_file, tmp_path):
    study = dc.load_study(study_file)
    with ThreadPoolExecutor(3) as threads:
        dc.run_study(study, tmp_path / "threads", executor=threads)
    dc.run_study(study, tmp_path / "processes")
    with (
        LedgerReader.open_read_only(tmp_path / "threads") as thread_ledger,
        LedgerReader.open_read_only(tmp_path / "processes") as process_ledger,
    ):
        for point in range(6):
            np.testing.assert_array_equal(
                thread_ledger.trial_sums_of_point(point), process_ledger.trial_sums_of_point(point)
            )
            np.testing.assert_array_equal(
                thread_ledger.theoretical_values_of_point(point),
                process_ledger.theoretical_values_of_point(point),
            )
        replay = replay_trial(dc.load_study(study_file), 17, point=3)
        np.testing.assert_array_equal(replay.sums, thread_ledger.trial_sums_of_point(3)[17])
    # `run` of that trial uses the same samples, so its detections are equal.
    np.testing.assert_array_equal(
        replay.result.detections.range.values, replay.trial_result.detections["range"]
    )


@pytest.mark.usefixtures("without_figures")
def test_trial_option_writes_report_of_one_trial(study_file, tmp_path, capsys):
    point = ("impairments.white-noise.snr=-20 dB", "chain.range_window=hann")
    options = [word for setting in point for word in ("--set", setting)]
    out = tmp_path / "one"
    assert get_exit_status("study", study_file, "--trial", 7, *options, "--out", out, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["trial"] == 7
    assert document["sums"]["detection_probability"]["van"][1] == 1  # one frame was evaluated
    assert (out / "report.html").is_file()

    assert get_exit_status("study", study_file, "--trial", 7, "--out", out) == 2
    assert "--set chain.range_window=VALUE" in capsys.readouterr().err


def read_blocks(out):
    with closing(sqlite3.connect(out / "study.sqlite")) as connection:
        return list(connection.execute("SELECT * FROM blocks"))


@nightly
def test_rejects_changed_study_in_same_folder(study_file, tmp_path, capsys):
    out = tmp_path / "out"
    assert get_exit_status(
        "study", study_file, "--set", "trials.at_most=5", "--out", out, "--quiet"
    ) in (0, 1)
    rows = read_blocks(out)

    changed_settings = ["trials.at_most=5", "scene.targets.van.rcs=11 dBsm"]
    options = [word for setting in changed_settings for word in ("--set", setting)]
    assert get_exit_status("study", study_file, *options, "--out", out) == 2
    err = capsys.readouterr().err
    assert "12 dBsm" in err and "11 dBsm" in err and "--out" in err
    assert read_blocks(out) == rows


@nightly
def test_impossible_point_is_reported_as_failure(study_file, tmp_path, capsys):
    # Each value is valid alone; 13 training cells with 16 velocities are not.
    study_file.write_text(
        STUDY.replace("  chain.range_window: [hann, rectangular]\n", "").replace(
            "vary:\n",
            "vary:\n  chain.cfar.n_training.velocity: [4, 13]\n  radar.frame.n_chirps: [16, 32]\n",
        )
    )
    options = ("--workers", 1, "--set", "trials.at_most=15", "--out", tmp_path / "out")
    assert get_exit_status("study", study_file, *options) == 2
    err = capsys.readouterr().err
    assert "n_training" in err
    assert "Traceback" not in err


@nightly
def test_statistical_sensor_agrees_with_signal_simulation(study_file, tmp_path):
    # 150 trials each give Pd within 0.04: the limit is 5 standard deviations plus 0.02.
    probabilities = {}
    for sensor in ("signal", "statistical"):
        study = dc.load_study(
            study_file,
            [f"sensor={sensor}", "trials.at_most=150", "impairments.white-noise.snr=-20 dB",
             "chain.range_window=hann", "require=[]"],
        )  # fmt: skip
        with ThreadPoolExecutor(2) as threads:
            outcome = dc.run_study(study, tmp_path / sensor, executor=threads)
        probabilities[sensor] = (
            outcome.result.dataset.detection_probability_by_target.values.ravel()
        )
    spread = np.sqrt(2 * 0.25 / 150)
    np.testing.assert_allclose(*probabilities.values(), atol=5 * spread + 0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--workers", "0"], "--workers"),
        (["--workers", "two"], "whole number"),
        (["--scheduler", "tcp://127.0.0.1:9"], "--scheduler"),
        (["--cluster", "pbs"], "slurm"),
        (["--trial", "-1"], "--trial"),
        (["--set", "scene.targets.cra.rcs=1 dBsm"], "car"),
    ],
)
def test_rejects_invalid_calls_with_message(
    study_file, tmp_path, capsys, monkeypatch, arguments, message
):
    # No scheduler answers; a user waits for one for 10 s.
    impatient = partial(executors.dask_workers, timeout_s=0.2)
    monkeypatch.setattr(executors, "dask_workers", impatient)
    out = tmp_path / "out"
    assert get_exit_status("study", study_file, *arguments, "--out", out) == 2
    err = capsys.readouterr().err
    assert message in err
    assert "Traceback" not in err
    assert not (out / "report.html").exists()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_example_studies_load(path):
    study = dc.load_study(path)
    assert study.name == path.stem
    assert study.n_points >= 5
