"""A worker that dies, as of short memory: others take its work, and the result is the same."""

import os
import signal
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path

import numpy as np
import pytest

from dechirp.core.errors import DechirpError
from dechirp.experiment.study.executors import local
from dechirp.experiment.verify.trials import Job, run_all


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
    job = Job(work=drawn, n_trials=60, n_each=10, told={"dies": str(tmp_path / "died")})
    with local(1) as workers:
        found = run_all(
            {"one": job},
            seed=5,
            executor=workers.executor,
            lost=workers.lost,
            renew=workers.renew,
        )

    assert (tmp_path / "died").exists()
    with local(1) as workers:
        again = run_all({"one": job}, seed=5, executor=workers.executor)
    np.testing.assert_array_equal(found["one"], again["one"])


@pytest.mark.parametrize("renew", [None, lambda: None])
def test_a_certificate_whose_workers_all_die_says_so(renew):
    job = Job(work=drawn, n_trials=60, n_each=10, told={})
    with pytest.raises(DechirpError, match="killed while they worked"):
        run_all({"one": job}, seed=5, executor=Dead(), renew=renew)
