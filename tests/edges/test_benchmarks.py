"""Benchmark tools: slowdown limit, growth exponents, import times, and a nightly comparison."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dechirp
from dechirp.experiments.study import environment
from nightly import nightly

BENCHMARKS = Path(dechirp.__file__).parents[2] / "benchmarks"


@pytest.fixture
def guard(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import guard

    return guard


def test_job_slower_by_quarter_in_two_of_three_repeats_fails_with_ratios(guard):
    (message,) = guard.find_slower_jobs({"map": 0.2, "frame": 0.4}, [
        {"map": 0.26, "frame": 0.7}, {"map": 0.2, "frame": 0.4}, {"map": 0.251, "frame": 0.4},
    ])  # fmt: skip
    assert message == "map: 0.26, 0.2, 0.251 of the time of plain code; it was 0.2"


def test_slowdown_by_quarter_faster_jobs_and_new_jobs_pass(guard):
    time_ratios = {"map": 0.25, "frame": 0.1, "tracks": 3.0}
    assert guard.find_slower_jobs({"map": 0.2, "frame": 0.4}, [time_ratios] * 3) == []


def test_added_work_raises_limit_of_its_job_alone(guard):
    release, added_work = {"map": 0.2, "frame": 0.4}, {"frame": {"factor": 1.5, "reason": "more"}}
    (message,) = guard.find_slower_jobs(release, [{"map": 0.3, "frame": 0.7}] * 3, added_work)
    assert message.startswith("map: ")
    (message,) = guard.find_slower_jobs(release, [{"map": 0.2, "frame": 0.8}] * 3, added_work)
    assert message.startswith("frame: ")


def test_job_of_last_release_without_measurement_fails(guard):
    (message,) = guard.find_slower_jobs({"map": 0.2}, [{"map": 0.2}, {}, {"map": 0.2}])
    assert message.startswith("map: not measured")


def test_last_release_is_highest_version_not_last_file_name(guard, tmp_path):
    for version in ("0.9.0", "0.10.0"):
        (tmp_path / f"{version}.json").write_text(f'{{"version": "{version}"}}')
    assert guard.load_last_release(tmp_path)["version"] == "0.10.0"


def test_ratios_of_another_processor_are_added_to_those_of_the_release(
    guard, tmp_path, monkeypatch
):
    monkeypatch.setattr(guard, "RELEASES", tmp_path)

    def write(processor, ratio):
        kind = {"processor": processor}
        monkeypatch.setattr(environment, "versions_system_and_processor", kind.copy)
        return guard.write_ratios([{"map": ratio}])

    file = write("rocketlake", 0.2)
    added_work = {"map": {"factor": 1.1, "reason": "more"}}
    file.write_text(json.dumps(json.loads(file.read_text()) | {"added_work": added_work}))
    document = json.loads(write("znver4", 0.3).read_text())

    assert document["ratios"] == {"rocketlake": {"map": 0.2}, "znver4": {"map": 0.3}}
    assert document["added_work"] == added_work


def test_growth_exponent_of_power_law_is_its_power(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    # `growth` sets thread counts to one at import; the test restores them afterwards.
    for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.setenv(pool, "1")
    import growth

    sizes = np.array([10.0, 20.0, 40.0])
    assert growth.fit_exponent(sizes, 3e-9 * sizes**1.5) == pytest.approx(1.5, abs=1e-12)


def test_import_times_are_parsed_by_module_and_summed_by_package(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import whole_process

    text = (
        "import time: self [us] | cumulative | imported package\n"
        "import time:       200 |        200 |   numpy.core\n"
        "import time:       300 |        500 | numpy\n"
        "a word of the program\n"
        "import time:       100 |        600 | dechirp\n"
    )
    rows = whole_process.parse_import_times(text)
    assert [row.module for row in rows] == ["numpy.core", "numpy", "dechirp"]
    assert rows[1].all_s == pytest.approx(5e-4)
    assert list(whole_process.sum_by_package(rows).items()) == [
        ("numpy", pytest.approx(5e-4)),
        ("dechirp", pytest.approx(1e-4)),
    ]


@nightly
def test_no_job_is_quarter_slower_relative_to_plain_code_than_last_release(guard):
    process = subprocess.run(
        [sys.executable, BENCHMARKS / "guard.py"], capture_output=True, text=True, check=False
    )
    if process.returncode == guard.NOT_COMPARED:
        pytest.skip(process.stdout.splitlines()[-1])
    assert process.returncode == 0, process.stdout + process.stderr


@nightly
def test_shadows_of_twenty_bodies_cost_at_most_half_of_their_echoes():
    process = subprocess.run(
        [sys.executable, BENCHMARKS / "shadowing.py"], capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stdout + process.stderr
