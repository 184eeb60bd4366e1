"""A worker that dies, as of short memory: others take its work, and the result is the same."""

import os
import signal
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path

import numpy as np
import pytest

from dechirp.certificate.trials import Job, run_jobs
from dechirp.core.errors import DechirpError
from dechirp.experiments.study.executors import local_workers


def drawn(rng: np.random.Generator, n_trials: int, *, dies: str | None = None) -> np.ndarray:
    """Normal numbers; the first worker that is told of a file that is not there dies."""
    if dies is not None and not Path(dies).exists():
        Path(dies).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return rng.normal(size=n_trials)


class Dead(Executor):
    """Its workers die of whatever they are given."""

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        future.set_exception(BrokenExecutor())
        return future


@pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")
def test_a_certificate_goes_on_with_other_workers(tmp_path):
    job = Job(work=drawn, n_trials=60, block_size=10, arguments={"dies": str(tmp_path / "died")})
    with local_workers(1) as workers:
        found = run_jobs(
            {"one": job},
            seed=5,
            executor=workers.executor,
            worker_errors=workers.death_errors,
            restart_workers=workers.renew,
        )

    assert (tmp_path / "died").exists()
    with local_workers(1) as workers:
        again = run_jobs({"one": job}, seed=5, executor=workers.executor)
    np.testing.assert_array_equal(found["one"], again["one"])


@pytest.mark.parametrize("renew", [None, lambda: None])
def test_a_certificate_whose_workers_all_die_says_so(renew):
    job = Job(work=drawn, n_trials=60, block_size=10, arguments={})
    with pytest.raises(DechirpError, match="a worker process died during a block"):
        run_jobs({"one": job}, seed=5, executor=Dead(), restart_workers=renew)
