"""`dechirp study` from the file to its results, on a radar so small that trials are quick."""

import json
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.main import main
from dechirp.experiments.study.ledger import LedgerReader
from dechirp.experiments.study.run import replay_trial
from dechirp.results.parquet import read_parquet

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
def file(tmp_path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(STUDY)
    return path


def status(*words: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code)


def test_a_study_runs_and_says_the_same_when_it_is_asked_again(file, tmp_path, capsys):
    out = tmp_path / "out"
    assert status("study", file, "--workers", 2, "--out", out, "--json") == 0
    found = json.loads(capsys.readouterr().out)

    assert {"version", "rows", "done", "total", "require", "files"} <= set(found)
    assert found["done"] == found["total"] == 6 * 40
    assert all(Path(path).is_file() for path in found["files"].values())
    (limit,) = found["require"]
    assert limit["decision"] == "met"
    for row in found["rows"]:
        rate = row["detection_probability"]["targets"]["car"]
        assert rate["low"] <= rate["value"] <= rate["high"]
        assert 0 <= rate["theory"] <= 1
    table = read_parquet(out / "points.parquet")
    np.testing.assert_array_equal(table["trials"], 40)
    assert len(read_parquet(out / "trials.parquet")["trial"]) == 240
    page = (out / "report.html").read_text()
    assert 'src="http' not in page

    assert status("study", file, "--out", out, "--json") == 0
    assert json.loads(capsys.readouterr().out)["rows"] == found["rows"]


def test_trials_are_the_same_to_the_bit_wherever_they_run(file, tmp_path):
    study = dc.load_study(file)
    with ThreadPoolExecutor(3) as threads:
        dc.run_study(study, tmp_path / "threads", executor=threads)
    dc.run_study(study, tmp_path / "processes")
    with (
        LedgerReader.open_existing(tmp_path / "threads") as one,
        LedgerReader.open_existing(tmp_path / "processes") as other,
    ):
        for point in range(6):
            np.testing.assert_array_equal(one.point_sums(point), other.point_sums(point))
            np.testing.assert_array_equal(one.point_theory(point), other.point_theory(point))
        made = replay_trial(dc.load_study(file), 17, point=3)
        np.testing.assert_array_equal(made.sums, one.point_sums(3)[17])
    # `run` of that trial sees the same samples: the same detections.
    np.testing.assert_array_equal(
        made.result.detections.range.values, made.trial_result.detections["range"]
    )


def test_one_trial_is_shown_as_a_run_is(file, tmp_path, capsys):
    point = ("impairments.white-noise.snr=-20 dB", "chain.range_window=hann")
    sets = [word for one in point for word in ("--set", one)]
    out = tmp_path / "one"
    assert status("study", file, "--trial", 7, *sets, "--out", out, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["trial"] == 7
    assert found["sums"]["detection_probability"]["van"][1] == 1  # one frame was looked at
    assert (out / "report.html").is_file()

    assert status("study", file, "--trial", 7, "--out", out) == 2
    assert "--set chain.range_window=VALUE" in capsys.readouterr().err


def blocks_in(out):
    with closing(sqlite3.connect(out / "study.sqlite")) as connection:
        return list(connection.execute("SELECT * FROM blocks"))


def test_another_study_is_refused_in_the_same_folder(file, tmp_path, capsys):
    out = tmp_path / "out"
    assert status("study", file, "--set", "trials.at_most=5", "--out", out, "--quiet") in (0, 1)
    rows = blocks_in(out)

    changed = ["trials.at_most=5", "scene.targets.van.rcs=11 dBsm"]
    sets = [word for one in changed for word in ("--set", one)]
    assert status("study", file, *sets, "--out", out) == 2
    said = capsys.readouterr().err
    assert "12 dBsm" in said and "11 dBsm" in said and "--out" in said
    assert blocks_in(out) == rows


def test_a_point_that_cannot_be_is_a_failure_that_is_told(file, tmp_path, capsys):
    # Each value is possible alone; so many training cells and so few velocities are not.
    file.write_text(
        STUDY.replace("  chain.range_window: [hann, rectangular]\n", "").replace(
            "vary:\n",
            "vary:\n  chain.cfar.n_training.velocity: [4, 13]\n  radar.frame.n_chirps: [16, 32]\n",
        )
    )
    assert status("study", file, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "n_training" in said
    assert "Traceback" not in said


def test_drawn_detections_agree_with_those_of_samples(file, tmp_path):
    # Of 150 trials each, Pd is known to 0.04: 5 of its standard deviations and the 0.02 asked.
    found = {}
    for sensor in ("signal", "statistical"):
        study = dc.load_study(
            file,
            [f"sensor={sensor}", "trials.at_most=150", "impairments.white-noise.snr=-20 dB",
             "chain.range_window=hann", "require=[]"],
        )  # fmt: skip
        with ThreadPoolExecutor(2) as threads:
            done = dc.run_study(study, tmp_path / sensor, executor=threads)
        found[sensor] = done.result.dataset.detection_probability_by_target.values.ravel()
    spread = np.sqrt(2 * 0.25 / 150)
    np.testing.assert_allclose(*found.values(), atol=5 * spread + 0.02)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--workers", "0"], "--workers"),
        (["--workers", "two"], "whole number"),
        (["--scheduler", "tcp://127.0.0.1:9"], "--scheduler"),
        (["--cluster", "pbs"], "slurm"),
        (["--trial", "-1"], "--trial"),
        (["--set", "scene.targets.cra.rcs=1 dBsm"], "car"),
    ],
)
def test_a_wrong_call_is_told_in_words(file, tmp_path, capsys, words, says):
    out = tmp_path / "out"
    assert status("study", file, *words, "--out", out) == 2
    told = capsys.readouterr().err
    assert says in told
    assert "Traceback" not in told
    assert not (out / "report.html").exists()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_studies_of_the_examples_are_read(path):
    study = dc.load_study(path)
    assert study.name == path.stem
    assert study.n_points >= 5
