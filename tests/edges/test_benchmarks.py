"""What benchmarks make of their times; the times themselves only at night, as ratios."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dechirp
from nightly import nightly

BENCHMARKS = Path(dechirp.__file__).parents[2] / "benchmarks"


@pytest.fixture
def guard(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import guard

    return guard


def test_a_job_that_is_a_quarter_slower_in_two_of_three_repeats_fails_and_says_by_how_much(guard):
    (line,) = guard.judged({"map": 0.2, "frame": 0.4}, [
        {"map": 0.26, "frame": 0.7}, {"map": 0.2, "frame": 0.4}, {"map": 0.251, "frame": 0.4},
    ])  # fmt: skip
    assert line == "map: 0.26, 0.2, 0.251 of the time of plain code; it was 0.2"


def test_a_quarter_is_still_allowed_and_so_is_what_became_faster_or_is_new(guard):
    now = {"map": 0.25, "frame": 0.1, "tracks": 3.0}
    assert guard.judged({"map": 0.2, "frame": 0.4}, [now] * 3) == []


def test_a_job_of_the_release_that_is_measured_no_more_fails(guard):
    (line,) = guard.judged({"map": 0.2}, [{"map": 0.2}, {}, {"map": 0.2}])
    assert line.startswith("map: not measured")


def test_the_last_release_is_the_highest_version_not_the_last_name(guard, tmp_path):
    for version in ("0.9.0", "0.10.0"):
        (tmp_path / f"{version}.json").write_text(f'{{"version": "{version}"}}')
    assert guard.last_release(tmp_path)["version"] == "0.10.0"


def test_the_exponent_of_a_power_is_that_power(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    # It sets threads to one before NumPy is loaded; here they are set already.
    for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.setenv(pool, "1")
    import growth

    sizes = np.array([10.0, 20.0, 40.0])
    assert growth.exponent(sizes, 3e-9 * sizes**1.5) == pytest.approx(1.5, abs=1e-12)


def test_import_times_are_read_by_module_and_added_up_by_package(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import whole_process

    text = (
        "import time: self [us] | cumulative | imported package\n"
        "import time:       200 |        200 |   numpy.core\n"
        "import time:       300 |        500 | numpy\n"
        "a word of the program\n"
        "import time:       100 |        600 | dechirp\n"
    )
    rows = whole_process.imports_in(text)
    assert [row.module for row in rows] == ["numpy.core", "numpy", "dechirp"]
    assert rows[1].all_s == pytest.approx(5e-4)
    assert list(whole_process.by_package(rows).items()) == [
        ("numpy", pytest.approx(5e-4)),
        ("dechirp", pytest.approx(1e-4)),
    ]


@nightly
def test_no_job_is_a_quarter_slower_beside_plain_code_than_at_the_last_release():
    ran = subprocess.run(
        [sys.executable, BENCHMARKS / "guard.py"], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
