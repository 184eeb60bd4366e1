"""Jobs shared out among threads, and the arrays they work in."""

import threading

import numba
import numpy as np
import pytest

from dechirp.core import buffers
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.threads import run_in_threads, split_range


@pytest.mark.parametrize("n_threads", [1, 2, 5])
def test_every_job_is_done_once_and_jobs_may_share_out_their_own(n_threads):
    done = np.zeros((6, 50), int)

    def row(r):
        def cell(some):
            done[r, some] += 1

        run_in_threads(n_threads, cell, split_range(50, 7))

    run_in_threads(n_threads, row, range(6))
    assert (done == 1).all()


@pytest.mark.parametrize("n_threads", [1, 3])
def test_the_first_error_is_raised_and_no_job_begins_after_it(n_threads):
    begun = []

    def fail(job):
        begun.append(job)
        raise ValueError(f"job {job}")

    with pytest.raises(ValueError, match="job"):
        run_in_threads(n_threads, fail, range(1000))
    assert len(begun) <= n_threads


def test_an_error_of_a_helper_reaches_the_caller():
    caller = threading.current_thread()
    both = threading.Barrier(2, timeout=60)

    def work(job):
        both.wait()
        if threading.current_thread() is not caller:
            raise ValueError("of a helper")

    with pytest.raises(ValueError, match="of a helper"):
        run_in_threads(2, work, range(2))


def test_work_arrays_are_kept_and_of_each_thread_its_own():
    mine = buffers.scratch_array("a", (3, 4))
    assert np.shares_memory(mine, buffers.scratch_array("a", (2, 5)))
    assert not np.shares_memory(mine, buffers.scratch_array("b", (3, 4)))
    theirs = []
    other = threading.Thread(target=lambda: theirs.append(buffers.scratch_array("a", (3, 4))))
    other.start()
    other.join()
    assert not np.shares_memory(mine, theirs[0])


def test_large_work_arrays_are_not_kept():
    size = buffers.MAX_KEPT_BYTES // 8 + 1
    assert not np.shares_memory(
        buffers.scratch_array("large", (size,)), buffers.scratch_array("large", (size,))
    )


def test_noise_does_not_depend_on_the_number_of_threads(monkeypatch):
    drawn = []
    for n_threads in (1, 2, 5):
        monkeypatch.setattr(numba, "get_num_threads", lambda n=n_threads: n)
        samples = np.zeros((3, 100_003), np.complex64)
        add_white_noise(samples, 2.0, np.random.default_rng(5))
        drawn.append(samples)
    assert (drawn[0] == drawn[1]).all() and (drawn[0] == drawn[2]).all()
    # Of 300,009 samples, a power is right to 0.2 %; pieces are not copies of each other.
    assert np.mean(abs(drawn[0]) ** 2) == pytest.approx(2.0, rel=0.01)
    assert len(np.unique(drawn[0])) > 300_000
