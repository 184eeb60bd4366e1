"""A limit of memory (`ulimit -v`): a command says what it needs, and never hangs or dies of it."""

import re

import numpy as np
import pytest

from dechirp.cli import memory_errors
from dechirp.core import memory
from dechirp.core.errors import NotEnoughMemory
from faults.conftest import SCENARIO, shell
from nightly import nightly

resource = pytest.importorskip("resource")
ONE_THREAD = {f"{pool}_NUM_THREADS": "1" for pool in ("OMP", "OPENBLAS", "NUMBA")}


def test_too_little_for_the_libraries_is_told_before_they_are_loaded(folder):
    ended = shell('ulimit -v 400000; "$@"', "run", "small.yaml", "--out", "out", **ONE_THREAD)

    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr.startswith("memory limit: 0.381 GiB; expected at least 0.812 GiB")
    assert "raise the limit" in ended.stderr
    assert not (folder / "out").exists()


@nightly
def test_a_job_past_the_limit_is_refused_with_both_numbers(folder):
    # 1 M chirps of 64 samples and two receivers: 1 GiB of complex64 alone.
    long = ("--set", "radar.frame.n_chirps=1000000")
    ended = shell('ulimit -v 1600000; "$@"', "run", "small.yaml", *long, **ONE_THREAD)

    assert (ended.returncode, ended.stdout) == (2, "")
    needed, free = map(float, re.findall(r"([\d.]+) GiB", ended.stderr))
    assert needed >= 1
    assert free < 1600000 / 2**20
    assert "fewer frames, chirps" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1


def test_what_is_free_ends_at_the_limit(monkeypatch):
    taken = memory.psutil.Process().memory_info().vms
    monkeypatch.setattr(resource, "getrlimit", lambda _: (taken + 2**28, resource.RLIM_INFINITY))

    # What the process takes meanwhile counts, too.
    assert memory.available_memory_bytes() <= 2**28 + 2**26
    with pytest.raises(NotEnoughMemory, match=r"the map: 0\.5 GiB of memory"):
        memory.check_memory("the map", needed_bytes=2**29, fix="take fewer chirps")


@pytest.mark.parametrize(
    "error",
    [
        np._core._exceptions._ArrayMemoryError((2**40,), np.dtype("complex64")),
        OSError(12, "Cannot allocate memory"),
        RuntimeError("can't start new thread"),
    ],
)
def test_memory_that_a_library_runs_out_of_is_told_in_one_line(error, folder, call, monkeypatch):
    def raises(*_told, **_named):
        raise error

    monkeypatch.setattr("dechirp.experiments.run.run", raises)
    status, out, said = call("run", "small.yaml")

    assert (status, out) == (2, "")
    assert said.startswith(f"memory: used up ({error})")
    assert "fewer frames, chirps" in said


def test_other_errors_are_not_called_so():
    assert memory_errors.memory_error(OSError(5, "Input/output error")) is None
    assert memory_errors.memory_error(ValueError("1 GiB")) is None


@nightly
@pytest.mark.parametrize("limit_kib", [300_000, 860_000, 900_000, 1_000_000, 1_300_000])
def test_under_any_limit_it_ends_with_results_or_a_message(limit_kib, tmp_path):
    (tmp_path / "small.yaml").write_text(SCENARIO)
    line = f'cd {tmp_path}; ulimit -v {limit_kib}; "$@"'
    ended = shell(line, "run", "small.yaml", "--quiet", **ONE_THREAD)

    assert "Traceback" not in ended.stderr
    assert ended.returncode in (0, 2)
    assert (tmp_path / "dechirp-run" / "run.json").exists() == (ended.returncode == 0)
