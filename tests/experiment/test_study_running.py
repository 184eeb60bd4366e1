"""Blocks run on any workers, in any order: what is kept is the same to the bit."""

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
from dechirp.experiments.study.block_queue import is_checkpoint
from dechirp.experiments.study.executors import (
    Workers,
    local_workers,
    workers_from_executor,
    workers_from_options,
)
from dechirp.experiments.study.ledger_reader import LedgerReader
from nightly import NIGHTLY
from tiny_study import Tiny, fingerprint, run

N_KILLS = 30 if NIGHTLY else 3


class OutOfOrder(Executor):
    """Does what waits in an order of chance, one thing at a time."""

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
            time.sleep(2e-4)  # so that there are several to choose from
            future, fn, args = self._waiting.pop(self._chance.randrange(len(self._waiting)))
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(fn(*args))
                except Exception as error:
                    future.set_exception(error)


@pytest.fixture(scope="module", params=[False, True], ids=["all", "until"])
def undisturbed(request, tmp_path_factory) -> tuple[bool, str]:
    """Whether points stop when they have enough, and what one thread keeps."""
    out = tmp_path_factory.mktemp("undisturbed")
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run(out, workers, until=request.param)
    return request.param, fingerprint(out)


@pytest.mark.parametrize("seed", range(30 if NIGHTLY else 2))
def test_the_order_in_which_blocks_finish_does_not_matter(tmp_path, undisturbed, seed):
    until, kept = undisturbed
    n_workers = 1 + 7 * seed
    run(tmp_path, Workers(OutOfOrder(seed), lambda: n_workers), until=until)
    assert fingerprint(tmp_path) == kept


def test_the_number_of_processes_does_not_matter(tmp_path, undisturbed):
    until, kept = undisturbed
    for n_workers in (1, 2, 3) if NIGHTLY else (1 + until,):
        with local_workers(n_workers) as workers:
            run(tmp_path / str(n_workers), workers, until=until)
        assert fingerprint(tmp_path / str(n_workers)) == kept


def test_a_point_keeps_the_first_blocks_that_are_enough_and_no_more(tmp_path):
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        said = run(tmp_path, workers, until=True)
    with LedgerReader.open_existing(tmp_path) as record:
        lengths = [len(record.point_sums(point)) for point in range(4)]
        for point in (0, 1, 2):
            sums, n = record.point_sums(point), lengths[point]
            assert tiny_study.enough(sums)
            asked = [5 * b for b in range(1, n // 5) if is_checkpoint(b)]
            assert not any(tiny_study.enough(sums[:m]) for m in asked)
    assert said[-1].n_trials_done == said[-1].n_trials == sum(lengths)
    assert said[-1].n_points_done == 4
    # A mean to 0.2 takes 25 (1 + point)^2 trials.
    assert lengths == sorted(lengths)


def test_questions_come_in_steps_of_three_percent_at_most():
    asked = [n for n in range(1, 20001) if is_checkpoint(n)]
    assert asked[:64] == list(range(1, 65))
    assert max(b / a for a, b in pairwise(asked[63:])) <= 1 + 1 / 32
    assert len(asked) < 450


def test_a_study_that_is_done_gives_no_work_when_it_is_called_again(tmp_path, undisturbed):
    until, kept = undisturbed
    with ThreadPoolExecutor(2) as pool, workers_from_executor(pool) as workers:
        run(tmp_path, workers, until=until)
        (said,) = run(tmp_path, workers, until=until, work=_must_not_be_called)
    assert fingerprint(tmp_path) == kept
    assert said.n_points_done == said.n_points
    assert said.seconds_left == 0


def _must_not_be_called(*_: object) -> Block:
    raise AssertionError


def test_few_blocks_wait_at_a_time(tmp_path):
    """However many there are: memory and cancelling do not grow with a study."""
    most = 0

    class Counting(ThreadPoolExecutor):
        def submit(self, fn, /, *args, **kwargs):
            nonlocal most
            most = max(most, self._work_queue.qsize())
            return super().submit(fn, *args, **kwargs)

    with Counting(2) as pool, workers_from_executor(pool) as workers:
        run(tmp_path, workers)
    assert most <= 6


def test_more_failures_than_the_share_stop_it_and_what_was_done_is_kept(tmp_path):
    fails = Tiny(fails=tuple(range(403)))
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        with pytest.raises(DechirpError, match="of point 1 said ValueError: 0") as stopped:
            run(tmp_path, workers, fails, stop_after_failures=0.01)
        assert "stop_after_failures: 0.01" in str(stopped.value)
        with LedgerReader.open_existing(tmp_path) as record:
            # 403 trials of point 0 went well: 5 failures are more than 1 % of 408.
            assert 5 <= record.count_failures() < 60
            assert len(record.point_sums(0)) == 403
        with pytest.raises(DechirpError):  # again, before anything is done
            run(tmp_path, workers, fails, stop_after_failures=0.01, work=_must_not_be_called)
        run(tmp_path, workers, fails, stop_after_failures=0.6)


def test_an_error_outside_trials_ends_the_study_with_its_message(tmp_path):
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        with pytest.raises(InvalidSetting, match="no such target"):
            run(tmp_path, workers, work=_wrong_at_point_2)
        run(tmp_path, workers)
    with LedgerReader.open_existing(tmp_path) as record:
        assert len(record.finished_blocks()) == 4 * 81


def _wrong_at_point_2(tiny: Tiny, point: int, number: int) -> Block:
    if point == 2:
        raise InvalidSetting("scene", value="a", expected="no such target", fix="Mend it.")
    return tiny_study.work(tiny, point, number)


def test_a_worker_that_is_killed_is_replaced_and_the_result_is_the_same(tmp_path, undisturbed):
    until, kept = undisturbed
    if until and not NIGHTLY:
        pytest.skip("half of them by night")
    victims = [40, 300]

    def kill_one(said) -> None:
        if victims and said.n_trials_done > victims[0]:
            victims.pop(0)
            workers_of_this = [
                child
                for child in psutil.Process().children()
                if any("loky_posix" in word or "loky_win32" in word for word in child.cmdline())
            ]
            workers_of_this[0].kill()

    with local_workers(2) as workers:
        run(tmp_path, workers, Tiny(pause_s=0.002), until=until, progress=kill_one)
    assert not victims
    assert fingerprint(tmp_path) == kept


def test_a_block_that_kills_its_worker_every_time_is_given_up_in_words(tmp_path):
    with local_workers(1) as workers, pytest.raises(DechirpError, match="killed while they worked"):
        run(tmp_path, workers, work=_deadly)
    with ThreadPoolExecutor(1) as pool, workers_from_executor(pool) as workers:
        run(tmp_path, workers)
    with LedgerReader.open_existing(tmp_path) as record:
        assert len(record.finished_blocks()) == 4 * 81


def _deadly(tiny: Tiny, point: int, number: int) -> Block:
    if (point, number) == (0, 20):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
    return tiny_study.work(tiny, point, number)


def started(out: Path, *options: str) -> subprocess.Popen[str]:
    """The study as a process of its own, once it has begun."""
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


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_a_parent_killed_at_random_moments_loses_nothing(tmp_path, undisturbed):
    until, kept = undisturbed
    if not (until or NIGHTLY):
        pytest.skip("half of them by night")
    chance = np.random.default_rng(8)
    options = ("--until",) if until else ()
    left: list[int] = []
    for kill, moment_s in enumerate(chance.uniform(0.0, 0.4, N_KILLS)):
        # Two workers every tenth time: starting them takes longer than all blocks.
        with_workers = kill % 10 == 1
        process = started(tmp_path, *options, *(("--workers", "2") if with_workers else ()))
        time.sleep(moment_s + 0.6 * with_workers)
        process.kill()
        process.communicate()
        if (tmp_path / "study.sqlite").exists() and (tmp_path / "study.sqlite").stat().st_size:
            with LedgerReader.open_existing(tmp_path) as record:
                left.append(len(record.finished_blocks()))
        else:
            left.append(0)
        assert left == sorted(left) or until  # blocks past the end are dropped
        if NIGHTLY and kill % 5 == 4:
            _begin_anew(tmp_path, kept, options)
            left.clear()
    process = started(tmp_path, *options)
    assert process.communicate()[1] == ""
    assert process.returncode == 0
    assert fingerprint(tmp_path) == kept


def _begin_anew(out: Path, kept: str, options: tuple[str, ...]) -> None:
    process = started(out, *options)
    process.communicate()
    assert fingerprint(out) == kept
    for file in out.iterdir():
        file.unlink()


def _wait_for_blocks(out: Path, n: int, *, within_s: float = 60.0) -> None:
    """Return once a study that runs has kept so many blocks."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        with suppress(DechirpError), LedgerReader.open_existing(out) as record:
            if len(record.finished_blocks()) >= n:
                return
        time.sleep(0.02)
    raise AssertionError


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_workers_do_not_outlive_a_parent_that_is_killed(tmp_path):
    process = started(tmp_path, "--workers", "2", "--pause", "0.01")
    deadline = time.monotonic() + 30
    workers: list[psutil.Process] = []
    while len(workers) < 2 and time.monotonic() < deadline:
        workers = [
            one
            for one in psutil.Process(process.pid).children()
            if any("popen_loky" in word for word in one.cmdline())
        ]
        time.sleep(0.05)
    _wait_for_blocks(tmp_path, 2)
    process.kill()
    process.communicate()
    gone, alive = psutil.wait_procs(workers, timeout=20)
    assert len(gone) == 2
    assert not alive


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
@pytest.mark.parametrize("n_workers", [None, 2] if NIGHTLY else [2])
def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(tmp_path, n_workers):
    options = () if n_workers is None else ("--workers", str(n_workers))
    process = started(tmp_path, *options, "--pause", "0.005")
    _wait_for_blocks(tmp_path, 10)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers as well
    said, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert not errors
    with LedgerReader.open_existing(tmp_path) as record:
        n_kept = sum(len(sums) for _, sums in record.iter_point_sums())
    assert f"Interrupted; {n_kept} of 1612 trials are kept in {tmp_path}" in said
    assert "The same call goes on" in said


STOPPED = """
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


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_workers_that_are_stopped_leave_nothing_behind(tmp_path):
    script = [sys.executable, "-c", STOPPED, str(tmp_path)]
    made = subprocess.run(script, capture_output=True, text=True, timeout=60, check=False)
    assert (made.returncode, made.stdout, made.stderr) == (3, "", "")


@pytest.mark.parametrize(
    ("told", "says"),
    [
        ({"workers": 0}, "--workers"),
        ({"workers": 1.5}, "--workers"),
        ({"scheduler": "tcp://a:1", "workers": 2}, "given with --workers"),
        ({"cluster": "pbs"}, "slurm"),
    ],
)
def test_workers_that_cannot_be_had_are_refused(told, says):
    with pytest.raises(InvalidSetting, match=says):
        workers_from_options(**told)


def test_what_is_no_executor_is_refused():
    with pytest.raises(InvalidSetting, match="executor"):
        workers_from_executor("two")
