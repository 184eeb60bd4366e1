"""Memory limit (`ulimit -v`): commands report the memory they need and never hang or crash."""

import re

import numpy as np
import psutil
import pytest

from dechirp.cli import errors
from dechirp.core import memory
from dechirp.core.errors import NotEnoughMemory
from faults.conftest import SCENARIO, run_shell
from nightly import nightly

resource = pytest.importorskip("resource")
ONE_THREAD = {f"{pool}_NUM_THREADS": "1" for pool in ("OMP", "OPENBLAS", "NUMBA")}


def test_limit_below_library_needs_is_reported_before_loading(folder):
    process = run_shell('ulimit -v 400000; "$@"', "run", "small.yaml", "--out", "out", **ONE_THREAD)

    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr.startswith("memory limit: 0.381 GiB; expected at least 0.812 GiB")
    assert "raise the limit" in process.stderr
    assert not (folder / "out").exists()


@nightly
def test_job_beyond_limit_is_refused_with_needed_and_free_memory(folder):
    # 1 M chirps of 64 samples and two receivers take 1 GiB of complex64 alone.
    long_frame = ("--set", "radar.frame.n_chirps=1000000")
    process = run_shell('ulimit -v 1600000; "$@"', "run", "small.yaml", *long_frame, **ONE_THREAD)

    assert (process.returncode, process.stdout) == (2, "")
    needed, free = map(float, re.findall(r"([\d.]+) GiB", process.stderr))
    assert needed >= 1
    assert free < 1600000 / 2**20
    assert "fewer frames, chirps" in process.stderr
    assert len(process.stderr.splitlines()) == 1


def test_available_memory_is_bounded_by_limit(monkeypatch):
    used_bytes = psutil.Process().memory_info().vms
    monkeypatch.setattr(
        resource, "getrlimit", lambda _: (used_bytes + 2**28, resource.RLIM_INFINITY)
    )

    # Memory allocated by the process in the meantime also counts.
    assert memory.available_memory_bytes() <= 2**28 + 2**26
    with pytest.raises(NotEnoughMemory, match=r"the map: 0\.5 GiB of memory"):
        memory.check_free_memory("the map", needed_bytes=2**29, fix="take fewer chirps")


@pytest.mark.parametrize(
    "error",
    [
        np._core._exceptions._ArrayMemoryError((2**40,), np.dtype("complex64")),
        OSError(12, "Cannot allocate memory"),
        RuntimeError("can't start new thread"),
    ],
)
def test_memory_error_of_library_is_reported_in_one_line(error, folder, call, monkeypatch):
    def raise_error(*_arguments, **_options):
        raise error

    monkeypatch.setattr("dechirp.experiments.run.run", raise_error)
    status, out, errors = call("run", "small.yaml")

    assert (status, out) == (2, "")
    assert errors.startswith(f"memory: used up ({error})")
    assert "fewer frames, chirps" in errors


def test_other_errors_are_not_memory_errors():
    assert errors.memory_error_to_mistake(OSError(5, "Input/output error")) is None
    assert errors.memory_error_to_mistake(ValueError("1 GiB")) is None


@nightly
@pytest.mark.parametrize("limit_kib", [300_000, 860_000, 900_000, 1_000_000, 1_300_000])
def test_run_under_any_limit_ends_with_results_or_message(limit_kib, tmp_path):
    (tmp_path / "small.yaml").write_text(SCENARIO)
    line = f'cd {tmp_path}; ulimit -v {limit_kib}; "$@"'
    process = run_shell(line, "run", "small.yaml", "--quiet", **ONE_THREAD)

    assert "Traceback" not in process.stderr
    assert process.returncode in (0, 2)
    assert (tmp_path / "dechirp-run" / "run.json").exists() == (process.returncode == 0)
