"""Execution of studies on any workers and in any order: identical results, kills and signals."""

import ctypes
import os
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil
import pytest

import tiny_study
from dechirp.core.errors import DechirpError, InvalidSetting
from dechirp.experiments.study.block import Block
from dechirp.experiments.study.block_queue import is_stop_criterion_tested
from dechirp.experiments.study.executors import (
    Workers,
    local_workers,
    workers_from_executor,
    workers_from_options,
)
from dechirp.experiments.study.ledger_reader import LedgerReader
from dechirp.experiments.study.processes import RestartablePool, WorkerStopped
from nightly import NIGHTLY, nightly
from tiny_study import TinyPlan, ledger_digest, run_tiny_study

N_KILLS = 30
KEPT: list[np.ndarray] = []
"""Arrays that a worker keeps after its calls."""


class ShuffledExecutor(Executor):
    """Executor that runs waiting tasks one at a time in random order."""

    def __init__(self, seed: int) -> None:
        self._waiting: list[tuple[Future, object, tuple]] = []
        self._chance, self._more = random.Random(seed), threading.Semaphore(0)
        threading.Thread(target=self._work, daemon=True).start()

    def submit(self, fn, /, *args):
        future: Future = Future()
        self._waiting.append((future, fn, args))
        self._more.release()
        return future

    def _work(self) -> None:
        while True:
            self._more.acquire()
            time.sleep(2e-4)  # let several tasks accumulate
            future, fn, args = self._waiting.pop(self._chance.randrange(len(self._waiting)))
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(fn(*args))
                except Exception as error:
                    future.set_exception(error)


@pytest.fixture(scope="module", params=[False, True], ids=["all", "until"])
def undisturbed_result(request, tmp_path_factory) -> tuple[bool, str]:
    """Run a study on one thread; return the use of a stop criterion and the fingerprint."""
    out = tmp_path_factory.mktemp("undisturbed")
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(out, workers, until=request.param)
    return request.param, ledger_digest(out)


@pytest.mark.parametrize("seed", range(30) if NIGHTLY else [1])
def test_result_does_not_depend_on_order_of_blocks(tmp_path, undisturbed_result, seed):
    until, expected = undisturbed_result
    n_workers = 1 + 7 * seed
    run_tiny_study(tmp_path, Workers(ShuffledExecutor(seed), lambda: n_workers), until=until)
    assert ledger_digest(tmp_path) == expected


@nightly
def test_result_does_not_depend_on_number_of_processes(tmp_path, undisturbed_result):
    until, expected = undisturbed_result
    for n_workers in (1, 2, 3):
        with local_workers(n_workers) as workers:
            run_tiny_study(tmp_path / str(n_workers), workers, until=until)
        assert ledger_digest(tmp_path / str(n_workers)) == expected


def test_stopped_point_keeps_first_sufficient_blocks_alone(tmp_path):
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        progress = run_tiny_study(tmp_path, workers, until=True)
    with LedgerReader.open_read_only(tmp_path) as record:
        lengths = [len(record.trial_sums_of_point(point)) for point in range(4)]
        for point in (0, 1, 2):
            sums, n = record.trial_sums_of_point(point), lengths[point]
            assert tiny_study.is_mean_precise(sums)
            checkpoints = [5 * b for b in range(1, n // 5) if is_stop_criterion_tested(b)]
            assert not any(tiny_study.is_mean_precise(sums[:m]) for m in checkpoints)
    assert progress[-1].n_trials_done == progress[-1].n_trials == sum(lengths)
    assert progress[-1].n_points_done == 4
    # A mean within 0.2 takes 25 (1 + point)^2 trials.
    assert lengths == sorted(lengths)


def test_checkpoints_are_at_most_three_percent_apart():
    checkpoints = [n for n in range(1, 20001) if is_stop_criterion_tested(n)]
    assert checkpoints[:64] == list(range(1, 65))
    assert max(b / a for a, b in pairwise(checkpoints[63:])) <= 1 + 1 / 32
    assert len(checkpoints) < 450


def test_repeated_call_of_finished_study_gives_no_work(tmp_path, undisturbed_result):
    until, expected = undisturbed_result
    with ThreadPoolExecutor(2) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(tmp_path, workers, until=until)
        (progress,) = run_tiny_study(tmp_path, workers, until=until, work=_fail_if_called)
    assert ledger_digest(tmp_path) == expected
    assert progress.n_points_done == progress.n_points
    assert progress.seconds_left == 0


def _fail_if_called(*_: object) -> Block:
    raise AssertionError


def test_few_blocks_are_queued_at_a_time(tmp_path):
    """Memory and time to cancel do not grow with the number of blocks."""
    max_queued = 0

    class Counting(ThreadPoolExecutor):
        def submit(self, fn, /, *args, **kwargs):
            nonlocal max_queued
            max_queued = max(max_queued, self._work_queue.qsize())
            return super().submit(fn, *args, **kwargs)

    with Counting(2) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(tmp_path, workers)
    assert max_queued <= 6


def test_too_many_failures_stop_study_and_keep_finished_trials(tmp_path):
    failing_study = TinyPlan(fails=tuple(range(403)))
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        with pytest.raises(DechirpError, match="of point 1: ValueError: 0") as error:
            run_tiny_study(tmp_path, workers, failing_study, stop_after_failures=0.01)
        assert "stop_after_failures: 0.01" in str(error.value)
        with LedgerReader.open_read_only(tmp_path) as record:
            # 403 trials of point 0 succeeded: 5 failures exceed 1 % of 408.
            assert 5 <= record.count_failed_trials() < 60
            assert len(record.trial_sums_of_point(0)) == 403
        with pytest.raises(DechirpError):  # the repeated call fails before any work
            run_tiny_study(
                tmp_path, workers, failing_study, stop_after_failures=0.01, work=_fail_if_called
            )
        run_tiny_study(tmp_path, workers, failing_study, stop_after_failures=0.6)


def test_error_outside_trials_ends_study_with_its_message(tmp_path):
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        with pytest.raises(InvalidSetting, match="no such target"):
            run_tiny_study(tmp_path, workers, work=_fail_at_point_2)
        run_tiny_study(tmp_path, workers)
    with LedgerReader.open_read_only(tmp_path) as record:
        assert len(record.saved_point_and_block_numbers()) == 4 * 81


def _fail_at_point_2(tiny: TinyPlan, point: int, number: int) -> Block:
    if point == 2:
        raise InvalidSetting("scene", value="a", expected="no such target", fix="Mend it.")
    return tiny_study.run_tiny_block(tiny, point, number)


@nightly
def test_killed_worker_is_replaced_and_result_is_unchanged(tmp_path, undisturbed_result):
    until, expected = undisturbed_result
    victims = [40, 300]

    def kill_one(progress) -> None:
        if victims and progress.n_trials_done > victims[0]:
            victims.pop(0)
            worker_processes = [
                child
                for child in psutil.Process().children()
                if any("loky_posix" in word or "loky_win32" in word for word in child.cmdline())
            ]
            worker_processes[0].kill()

    with local_workers(2) as workers:
        run_tiny_study(tmp_path, workers, TinyPlan(pause_s=0.002), until=until, progress=kill_one)
    assert not victims
    assert ledger_digest(tmp_path) == expected


@nightly
def test_block_that_always_kills_its_worker_is_abandoned_with_message(tmp_path):
    with local_workers(1) as workers, pytest.raises(DechirpError, match="killed while they worked"):
        run_tiny_study(tmp_path, workers, work=_kill_worker_at_block_20)
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run_tiny_study(tmp_path, workers)
    with LedgerReader.open_read_only(tmp_path) as record:
        assert len(record.saved_point_and_block_numbers()) == 4 * 81


def _kill_worker_at_block_20(tiny: TinyPlan, point: int, number: int) -> Block:
    if (point, number) == (0, 20):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
    return tiny_study.run_tiny_block(tiny, point, number)


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_worker_stops_if_callback_of_library_loses_first_signal(capfd):
    """Numba's compiler calls back by ctypes, which cannot pass the exception of a handler on."""
    pool = RestartablePool(1)
    try:
        with pytest.raises(WorkerStopped):
            pool.submit(_send_sigterm_in_ctypes_callback).result(timeout=60)
    finally:
        pool.shutdown()
    assert capfd.readouterr().err == ""


def _send_sigterm_in_ctypes_callback() -> None:
    ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGTERM))()
    time.sleep(5)


@nightly
def test_worker_that_needs_more_memory_for_larger_blocks_stays():
    """loky replaces a worker that needs 300 MB more than after its first call."""
    pool = RestartablePool(1)
    try:
        pids = [
            pool.submit(_keep_bytes_and_return_pid, n_bytes).result(timeout=60)
            for n_bytes in (0, 4e8, 0)
        ]
    finally:
        pool.shutdown()
    assert len(set(pids)) == 1


def _keep_bytes_and_return_pid(n_bytes: float) -> int:
    KEPT.append(np.ones(int(n_bytes), np.uint8))
    time.sleep(1.1)  # loky looks at the memory once a second
    return os.getpid()


def start_study(out: Path, *options: str) -> subprocess.Popen[str]:
    """Start the study in a separate process and wait until it has begun."""
    process = subprocess.Popen(
        [sys.executable, tiny_study.__file__, out, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    return process


@nightly
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_parent_killed_at_random_moments_loses_nothing(tmp_path, undisturbed_result):
    until, expected = undisturbed_result
    rng = np.random.default_rng(8)
    options = ("--until",) if until else ()
    block_counts: list[int] = []
    for kill, moment_s in enumerate(rng.uniform(0.0, 0.4, N_KILLS)):
        # Every tenth run has two workers: starting them takes longer than all blocks.
        with_workers = kill % 10 == 1
        process = start_study(tmp_path, *options, *(("--workers", "2") if with_workers else ()))
        time.sleep(moment_s + 0.6 * with_workers)
        process.kill()
        process.communicate()
        if (tmp_path / "study.sqlite").exists() and (tmp_path / "study.sqlite").stat().st_size:
            with LedgerReader.open_read_only(tmp_path) as record:
                block_counts.append(len(record.saved_point_and_block_numbers()))
        else:
            block_counts.append(0)
        assert block_counts == sorted(block_counts) or until  # late blocks are dropped
        if kill % 5 == 4:
            _finish_and_clear(tmp_path, expected, options)
            block_counts.clear()
    process = start_study(tmp_path, *options)
    assert process.communicate()[1] == ""
    assert process.returncode == 0
    assert ledger_digest(tmp_path) == expected


def _finish_and_clear(out: Path, expected: str, options: tuple[str, ...]) -> None:
    process = start_study(out, *options)
    process.communicate()
    assert ledger_digest(out) == expected
    for file in out.iterdir():
        file.unlink()


def _wait_for_blocks(out: Path, n: int, *, timeout_s: float = 60.0) -> None:
    """Wait until a running study has stored n blocks."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        with suppress(DechirpError), LedgerReader.open_read_only(out) as record:
            if len(record.saved_point_and_block_numbers()) >= n:
                return
        time.sleep(0.02)
    raise AssertionError


@nightly
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_workers_do_not_outlive_killed_parent(tmp_path):
    process = start_study(tmp_path, "--workers", "2", "--pause", "0.01")
    deadline = time.monotonic() + 30
    workers: list[psutil.Process] = []
    while len(workers) < 2 and time.monotonic() < deadline:
        workers = [
            child
            for child in psutil.Process(process.pid).children()
            if any("popen_loky" in word for word in child.cmdline())
        ]
        time.sleep(0.05)
    _wait_for_blocks(tmp_path, 2)
    process.kill()
    process.communicate()
    terminated, alive = psutil.wait_procs(workers, timeout=20)
    assert len(terminated) == 2
    assert not alive


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("n_workers", [None, 2] if NIGHTLY else [2])
def test_ctrl_c_keeps_finished_trials_and_explains_how_to_continue(tmp_path, n_workers):
    options = () if n_workers is None else ("--workers", str(n_workers))
    process = start_study(tmp_path, *options, "--pause", "0.005")
    _wait_for_blocks(tmp_path, 10)
    os.killpg(process.pid, signal.SIGINT)  # to the workers as well, as a terminal does
    output, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert not errors
    with LedgerReader.open_read_only(tmp_path) as record:
        n_kept = sum(len(sums) for _, sums in record.iter_trial_sums_by_point())
    assert f"Interrupted; {n_kept} of 1612 trials are kept in {tmp_path}" in output
    assert "The same call goes on" in output


STOPPED_WORKERS_SCRIPT = """
import multiprocessing, pathlib, sys, time
from dechirp.experiments.study.executors import local_workers

def work(begun):
    lock = multiprocessing.Lock()  # as libraries have one: its name is the system's
    pathlib.Path(begun).touch()
    time.sleep(600)

begun = [pathlib.Path(sys.argv[1]) / str(n) for n in range(2)]
with local_workers(2) as workers:
    for one in [*begun, *begun]:  # two wait
        workers.executor.submit(work, str(one))
    while not all(one.exists() for one in begun):
        time.sleep(0.01)
    sys.exit(3)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_stopped_workers_leave_nothing_behind(tmp_path):
    script = [sys.executable, "-c", STOPPED_WORKERS_SCRIPT, str(tmp_path)]
    process = subprocess.run(script, capture_output=True, text=True, timeout=60, check=False)
    assert (process.returncode, process.stdout, process.stderr) == (3, "", "")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"workers": 0}, "--workers"),
        ({"workers": 1.5}, "--workers"),
        ({"scheduler": "tcp://a:1", "workers": 2}, "cannot be combined with --workers"),
        ({"cluster": "pbs"}, "slurm"),
    ],
)
def test_rejects_impossible_worker_options(options, message):
    with pytest.raises(InvalidSetting, match=message):
        workers_from_options(**options)


def test_rejects_object_that_is_not_an_executor():
    with pytest.raises(InvalidSetting, match="executor"):
        workers_from_executor("two")
