"""Killed worker processes: other workers repeat their blocks with the same result."""

import os
import signal
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path

import numpy as np
import pytest

from dechirp.certificate.trials import Job, run_jobs
from dechirp.core.errors import DechirpError
from dechirp.experiments.study.executors import local_workers
from nightly import nightly


def draw_normal(
    rng: np.random.Generator, n_trials: int, *, death_file: str | None = None
) -> np.ndarray:
    """Draw normal numbers; a worker dies if `death_file` does not exist yet."""
    if death_file is not None and not Path(death_file).exists():
        Path(death_file).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return rng.normal(size=n_trials)


class DeadExecutor(Executor):
    """Executor whose workers die from every task."""

    def submit(self, fn, /, *args, **kwargs):
        future: Future = Future()
        future.set_exception(BrokenExecutor())
        return future


@nightly
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_certificate_continues_with_new_workers(tmp_path):
    job = Job(
        work=draw_normal,
        n_trials=60,
        block_size=10,
        arguments={"death_file": str(tmp_path / "died")},
    )
    with local_workers(1) as workers:
        results = run_jobs(
            {"one": job},
            seed=5,
            executor=workers.executor,
            worker_errors=workers.death_errors,
            restart_workers=workers.renew,
        )

    assert (tmp_path / "died").exists()
    with local_workers(1) as workers:
        repeated_results = run_jobs({"one": job}, seed=5, executor=workers.executor)
    np.testing.assert_array_equal(results["one"], repeated_results["one"])


@pytest.mark.parametrize("renew", [None, lambda: None])
def test_certificate_whose_workers_all_die_reports_it(renew):
    job = Job(work=draw_normal, n_trials=60, block_size=10, arguments={})
    with pytest.raises(DechirpError, match="a worker process died during a block"):
        run_jobs({"one": job}, seed=5, executor=DeadExecutor(), restart_workers=renew)
