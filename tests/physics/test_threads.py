"""Jobs distributed over threads, and scratch arrays per thread."""

import threading

import numpy as np
import pytest

from dechirp.core import buffers
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.threads import limit_threads, run_in_threads, split_range


@pytest.mark.parametrize("n_threads", [1, 2, 5])
def test_every_job_runs_once_and_jobs_may_be_nested(n_threads):
    counts = np.zeros((6, 50), int)

    def run_row(r):
        def run_cells(cells):
            counts[r, cells] += 1

        run_in_threads(n_threads, run_cells, split_range(50, 7))

    run_in_threads(n_threads, run_row, range(6))
    assert (counts == 1).all()


@pytest.mark.parametrize("n_threads", [1, 3])
def test_first_error_is_raised_and_stops_further_jobs(n_threads):
    started_jobs = []

    def fail(job):
        started_jobs.append(job)
        raise ValueError(f"job {job}")

    with pytest.raises(ValueError, match="job"):
        run_in_threads(n_threads, fail, range(1000))
    assert len(started_jobs) <= n_threads


def test_error_of_helper_thread_reaches_caller():
    caller = threading.current_thread()
    barrier = threading.Barrier(2, timeout=60)

    def work(job):
        barrier.wait()
        if threading.current_thread() is not caller:
            raise ValueError("of a helper")

    with pytest.raises(ValueError, match="of a helper"):
        run_in_threads(2, work, range(2))


def test_scratch_arrays_are_reused_per_thread():
    own_array = buffers.scratch_complex64_array("a", (3, 4))
    assert np.shares_memory(own_array, buffers.scratch_complex64_array("a", (2, 5)))
    assert not np.shares_memory(own_array, buffers.scratch_complex64_array("b", (3, 4)))
    thread_arrays = []
    thread = threading.Thread(
        target=lambda: thread_arrays.append(buffers.scratch_complex64_array("a", (3, 4)))
    )
    thread.start()
    thread.join()
    assert not np.shares_memory(own_array, thread_arrays[0])


def test_large_scratch_arrays_are_not_reused():
    size = buffers.MAX_KEPT_BYTES // 8 + 1
    assert not np.shares_memory(
        buffers.scratch_complex64_array("large", (size,)),
        buffers.scratch_complex64_array("large", (size,)),
    )


def test_noise_does_not_depend_on_number_of_threads():
    noises = []
    for n_threads in (1, 2, 5):
        samples = np.zeros((3, 100_003), np.complex64)
        with limit_threads(n_threads):
            add_white_noise(samples, 2.0, np.random.default_rng(5))
        noises.append(samples)
    assert (noises[0] == noises[1]).all() and (noises[0] == noises[2]).all()
    # Power of 300,009 samples: accurate to 0.2 %; blocks are not copies of each other.
    assert np.mean(abs(noises[0]) ** 2) == pytest.approx(2.0, rel=0.01)
    assert len(np.unique(noises[0])) > 300_000
