"""Studies on Dask clusters, with their own scheduler and workers, and on Slurm."""

import asyncio
import os
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed")

import cloudpickle
from distributed.cfexecutor import _cascade_future

import tiny_study
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.experiments.study.environment import versions_system_and_processor
from dechirp.experiments.study.executors import (
    dask_workers,
    slurm_workers,
    workers_from_executor,
    workers_from_options,
)
from dechirp.experiments.study.ledger_reader import LedgerReader
from nightly import NIGHTLY, nightly
from tiny_study import TinyPlan, ledger_digest, run_tiny_study

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")


@pytest.fixture(autouse=True, scope="module")
def _pickled_by_value() -> Iterator[None]:
    """Pickle test modules by value, because workers of a cluster cannot import them."""
    cloudpickle.register_pickle_by_value(tiny_study)
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    yield
    cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
    cloudpickle.unregister_pickle_by_value(tiny_study)


class Cluster:
    """Scheduler and workers on the loopback interface, as processes that can be killed singly."""

    def __init__(self) -> None:
        self.address = f"tcp://127.0.0.1:{find_free_port()}"
        host, port = self.address.removeprefix("tcp://").split(":")
        self.scheduler = self._start("scheduler", "--host", host, "--port", port, "--no-show")
        self.workers = [self.start_worker(), self.start_worker()]

    def start_worker(self) -> subprocess.Popen[bytes]:
        return self._start("worker", self.address, "--nthreads", "1", "--no-nanny")

    def _start(self, kind: str, *options: str) -> subprocess.Popen[bytes]:
        call = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options, "--no-dashboard"]
        return subprocess.Popen(call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def start_cluster() -> Iterator[Cluster]:
    dask_cluster = Cluster()
    try:
        yield dask_cluster
    finally:
        dask_cluster.close()


def find_free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def join_cluster(address: str, *, timeout_s: float = 40.0):
    """Connect to a scheduler that was just started and wait for its two workers."""
    with dask_workers(address, timeout_s=timeout_s) as workers:
        deadline = time.monotonic() + timeout_s
        while workers.capacity() < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
        yield workers


def run_undisturbed(out: Path, *, until: bool = False) -> str:
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(out, workers, until=until)
    return ledger_digest(out)


@nightly
def test_dask_matches_one_thread_and_loses_nothing_when_killed(tmp_path, monkeypatch):
    expected = run_undisturbed(tmp_path / "alone")
    expected_until = run_undisturbed(tmp_path / "alone-until", until=True)
    with start_cluster() as dask_cluster:
        with join_cluster(dask_cluster.address) as workers:
            assert workers.capacity() == 2
            assert workers.findings == ()
            run_tiny_study(tmp_path / "until", workers, until=True)
            assert ledger_digest(tmp_path / "until") == expected_until

        # Workers with other library versions are refused by name.
        monkeypatch.setitem(versions_system_and_processor(), "numpy", "1.0")
        with pytest.raises(DechirpError) as error, dask_workers(dask_cluster.address):
            pass
        monkeypatch.undo()
        first, second = error.value.mistakes
        assert {first.setting[:13], second.setting[:13]} == {"worker tcp://"}
        assert (first.value, first.expected) == (f"numpy {np.__version__}", "numpy 1.0")

        # A worker is killed during the study, then the scheduler.
        def kill(progress) -> None:
            if progress.n_trials_done > 200 and dask_cluster.workers[0].poll() is None:
                dask_cluster.workers[0].kill()
                dask_cluster.workers[0].wait()
            if progress.n_trials_done > 1000:
                dask_cluster.scheduler.kill()

        with (
            join_cluster(dask_cluster.address) as workers,
            pytest.raises(DechirpError, match=r"which is gone.*what was done is kept"),
        ):
            run_tiny_study(tmp_path / "killed", workers, TinyPlan(pause_s=0.001), progress=kill)
    with LedgerReader.open_read_only(tmp_path / "killed") as record:
        assert 1000 < sum(len(sums) for _, sums in record.iter_trial_sums_by_point()) < 1612
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(tmp_path / "killed", workers)
    assert ledger_digest(tmp_path / "killed") == expected


@nightly
@pytest.mark.parametrize("seed", range(30))
def test_cluster_killed_at_random_moments_loses_nothing(tmp_path, seed):
    rng = np.random.default_rng(seed)
    until = bool(seed % 2)
    moment = int(rng.integers(0, 300 if until else 1500))
    expected = run_undisturbed(tmp_path / "alone", until=until)
    with start_cluster() as dask_cluster:
        victim = (dask_cluster.scheduler, *dask_cluster.workers)[seed % 3]

        def kill(progress) -> None:
            if progress.n_trials_done >= moment:
                victim.kill()

        with join_cluster(dask_cluster.address) as workers:
            try:
                run_tiny_study(
                    tmp_path / "killed",
                    workers,
                    TinyPlan(pause_s=0.001),
                    until=until,
                    progress=kill,
                )
            except DechirpError:
                assert victim is dask_cluster.scheduler
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(tmp_path / "killed", workers, until=until)
    assert ledger_digest(tmp_path / "killed") == expected


class LosingExecutor(ThreadPoolExecutor):
    """Its first result arrives in Dask's hands as the cluster loses it, and becomes an error."""

    errors: tuple[BaseException, ...] = ()

    def submit(self, function, *args):
        future = super().submit(function, *args)
        if self.errors:
            return future

        class LostFuture:
            status = "lost"

            async def _result(self, raiseit):
                return future.result()

        async def hand_over():
            await _cascade_future(LostFuture(), lost)

        lost = Future()
        asyncio.run(hand_over())
        self.errors = (lost.exception(),)
        return lost


def test_block_that_dask_loses_as_it_arrives_is_computed_again(tmp_path):
    expected = run_undisturbed(tmp_path / "alone", until=False)
    with LosingExecutor(1) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(tmp_path / "lost", workers)

    assert isinstance(pool.errors[0], TypeError)
    assert ledger_digest(tmp_path / "lost") == expected


def test_unresponsive_scheduler_is_reported_within_timeout():
    start_s = time.monotonic()
    with (
        pytest.raises(InvalidSetting, match=r"--scheduler.*does not answer.*within 0.5 s"),
        dask_workers(f"tcp://127.0.0.1:{find_free_port()}", timeout_s=0.5),
    ):
        pass
    assert time.monotonic() - start_s < 10


@pytest.mark.parametrize("address", ["", "node", "tcp://node", "node:port", "tcp://node:99999"])
def test_rejects_malformed_scheduler_address(address):
    with (
        pytest.raises(InvalidSetting, match="an address as tcp://node:8786"),
        dask_workers(address),
    ):
        pass


def test_missing_dask_extra_names_install_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for options in ({"scheduler": "tcp://a:1"}, {"cluster": "slurm"}):
        with (
            pytest.raises(InvalidSetting, match=r"pip install 'dechirp\[dask\]'"),
            workers_from_options(**options),
        ):
            pass


def test_missing_slurm_is_reported(monkeypatch):
    pytest.importorskip("dask_jobqueue")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InvalidSetting, match="has no `sbatch`"), slurm_workers(2):
        pass


@pytest.mark.skipif(os.name != "posix", reason="Slurm needs POSIX")
def test_slurm_jobs_have_one_thread_per_worker_and_run_study(tmp_path, monkeypatch):
    """A stand-in for `sbatch` saves the script; nightly tests also run it on this machine."""
    pytest.importorskip("dask_jobqueue")
    bin_, scripts = tmp_path / "bin", tmp_path / "scripts"
    # The copy is run, because the script is deleted as soon as `sbatch` returns.
    start_command = f"setsid bash {scripts}/$$.sh" if NIGHTLY else "true"
    bin_.mkdir()
    scripts.mkdir()
    for name, body in {
        "sbatch": f'cp "$1" {scripts}/$$.sh\n{start_command} >/dev/null 2>&1 &\n'
        'echo "Submitted batch job $!"',
        "scancel": 'for job in "$@"; do kill -- "-$job" 2>/dev/null; done\nexit 0',
    }.items():
        (bin_ / name).write_text(f"#!/bin/bash\n{body}\n")
        (bin_ / name).chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", f"{bin_}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.chdir(tmp_path)

    with slurm_workers(2) as workers:
        if NIGHTLY:
            run_tiny_study(tmp_path / "slurm", workers, until=True)
            assert ledger_digest(tmp_path / "slurm") == run_undisturbed(
                tmp_path / "alone", until=True
            )
        deadline = time.monotonic() + 20
        while len(list(scripts.iterdir())) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)

    texts = [script.read_text() for script in scripts.iterdir()]
    assert len(texts) == 2
    for script in texts:
        assert "#SBATCH -n 1\n" in script
        assert "#SBATCH --cpus-per-task=1\n" in script
        assert "--nthreads 1 " in script
        assert "export NUMBA_NUM_THREADS=1\n" in script
