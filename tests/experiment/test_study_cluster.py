"""The same studies on Dask, with a scheduler and workers of its own, and on Slurm."""

import os
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed")

import cloudpickle

import tiny_study
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.experiments.study.environment import describe_environment
from dechirp.experiments.study.executors import (
    dask_workers,
    slurm_workers,
    workers_from_executor,
    workers_from_options,
)
from dechirp.experiments.study.ledger_reader import LedgerReader
from nightly import NIGHTLY, nightly
from tiny_study import Tiny, fingerprint, run

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")


@pytest.fixture(autouse=True, scope="module")
def _sent_by_value() -> Iterator[None]:
    """Workers of a cluster have no folder of tests."""
    cloudpickle.register_pickle_by_value(tiny_study)
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    yield
    cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
    cloudpickle.unregister_pickle_by_value(tiny_study)


class Cluster:
    """A scheduler and workers on loopback, processes that can be killed one by one."""

    def __init__(self) -> None:
        self.address = f"tcp://127.0.0.1:{free_port()}"
        host, port = self.address.removeprefix("tcp://").split(":")
        self.scheduler = self._start("scheduler", "--host", host, "--port", port, "--no-show")
        self.workers = [self.work(), self.work()]

    def work(self) -> subprocess.Popen[bytes]:
        return self._start("worker", self.address, "--nthreads", "1", "--no-nanny")

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        call = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options, "--no-dashboard"]
        return subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def cluster() -> Iterator[Cluster]:
    made = Cluster()
    try:
        yield made
    finally:
        made.close()


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def joined(address: str, *, within_s: float = 40.0):
    """Workers of a scheduler that was started a moment ago."""
    with dask_workers(address, timeout_s=within_s) as workers:
        deadline = time.monotonic() + within_s
        while workers.capacity() < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
        yield workers


def undisturbed(out: Path, *, until: bool = False) -> str:
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run(out, workers, until=until)
    return fingerprint(out)


def test_dask_gives_the_same_as_one_thread_and_loses_nothing_when_it_dies(tmp_path, monkeypatch):
    kept = undisturbed(tmp_path / "alone")
    kept_until = undisturbed(tmp_path / "alone-until", until=True)
    with cluster() as there:
        with joined(there.address) as workers:
            assert workers.capacity() == 2
            assert workers.findings == ()
            run(tmp_path / "until", workers, until=True)
            assert fingerprint(tmp_path / "until") == kept_until

        # Other versions on the workers are refused, by name.
        monkeypatch.setitem(describe_environment(), "numpy", "1.0")
        with pytest.raises(DechirpError) as refused, dask_workers(there.address):
            pass
        monkeypatch.undo()
        first, second = refused.value.mistakes
        assert {first.setting[:13], second.setting[:13]} == {"worker tcp://"}
        assert (first.value, first.expected) == (f"numpy {np.__version__}", "numpy 1.0")

        # A worker dies in the midst of it, then the scheduler.
        def kill(said) -> None:
            if said.n_trials_done > 200 and there.workers[0].poll() is None:
                there.workers[0].kill()
                there.workers[0].wait()
            if said.n_trials_done > 1000:
                there.scheduler.kill()

        with (
            joined(there.address) as workers,
            pytest.raises(DechirpError, match=r"which is gone.*what was done is kept"),
        ):
            run(tmp_path / "killed", workers, Tiny(pause_s=0.001), progress=kill)
    with LedgerReader.open_existing(tmp_path / "killed") as record:
        assert 1000 < sum(len(sums) for _, sums in record.iter_point_sums()) < 1612
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run(tmp_path / "killed", workers)
    assert fingerprint(tmp_path / "killed") == kept


@nightly
@pytest.mark.parametrize("seed", range(30))
def test_a_cluster_killed_at_random_moments_loses_nothing(tmp_path, seed):
    chance = np.random.default_rng(seed)
    until = bool(seed % 2)
    moment = int(chance.integers(0, 300 if until else 1500))
    kept = undisturbed(tmp_path / "alone", until=until)
    with cluster() as there:
        victim = (there.scheduler, *there.workers)[seed % 3]

        def kill(said) -> None:
            if said.n_trials_done >= moment:
                victim.kill()

        with joined(there.address) as workers:
            try:
                run(tmp_path / "killed", workers, Tiny(pause_s=0.001), until=until, progress=kill)
            except DechirpError:
                assert victim is there.scheduler
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run(tmp_path / "killed", workers, until=until)
    assert fingerprint(tmp_path / "killed") == kept


def test_a_scheduler_that_does_not_answer_is_said_within_its_time():
    started = time.monotonic()
    with (
        pytest.raises(InvalidSetting, match=r"--scheduler.*does not answer.*within 0.5 s"),
        dask_workers(f"tcp://127.0.0.1:{free_port()}", timeout_s=0.5),
    ):
        pass
    assert time.monotonic() - started < 10


@pytest.mark.parametrize("address", ["", "node", "tcp://node", "node:port", "tcp://node:99999"])
def test_what_is_no_address_is_refused_at_once(address):
    with (
        pytest.raises(InvalidSetting, match="an address as tcp://node:8786"),
        dask_workers(address),
    ):
        pass


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for told in ({"scheduler": "tcp://a:1"}, {"cluster": "slurm"}):
        with (
            pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[dask\]'"),
            workers_from_options(**told),
        ):
            pass


def test_without_slurm_it_says_so(monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InvalidSetting, match="has no `sbatch`"), slurm_workers(2):
        pass


@pytest.mark.skipif(os.name != "posix", reason="Slurm is where POSIX is")
def test_slurm_is_given_jobs_of_one_thread_a_worker_that_do_the_study(tmp_path, monkeypatch):
    """A stand-in for `sbatch` keeps the script and, by night, runs it here."""
    pytest.importorskip("dask_jobqueue")
    bin_, scripts = tmp_path / "bin", tmp_path / "scripts"
    # The copy: the script itself is gone as soon as `sbatch` has answered.
    begun = f"setsid bash {scripts}/$$.sh" if NIGHTLY else "true"
    bin_.mkdir()
    scripts.mkdir()
    for name, does in {
        "sbatch": f'cp "$1" {scripts}/$$.sh\n{begun} >/dev/null 2>&1 &\n'
        'echo "Submitted batch job $!"',
        "scancel": 'for job in "$@"; do kill -- "-$job" 2>/dev/null; done\nexit 0',
    }.items():
        (bin_ / name).write_text(f"#!/bin/bash\n{does}\n")
        (bin_ / name).chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", f"{bin_}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)

    with slurm_workers(2) as workers:
        if NIGHTLY:
            run(tmp_path / "slurm", workers, until=True)
            assert fingerprint(tmp_path / "slurm") == undisturbed(tmp_path / "alone", until=True)
        deadline = time.monotonic() + 20
        while len(list(scripts.iterdir())) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)

    written = [script.read_text() for script in scripts.iterdir()]
    assert len(written) == 2
    for script in written:
        assert "#SBATCH -n 1\n" in script
        assert "#SBATCH --cpus-per-task=1\n" in script
        assert "--nthreads 1 " in script
        assert "export NUMBA_NUM_THREADS=1\n" in script
