"""Where blocks of trials run: processes of this machine, Dask, Slurm, or any executor."""

import shutil
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

from loky import cpu_count

from dechirp.core.checks import whole
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.core.findings import Finding
from dechirp.experiment.study.environment import differences, environment, versions
from dechirp.experiment.study.processes import ONE_THREAD, Processes, Stopped

ANSWERS_WITHIN_S = 10.0
_MOST_WORKERS = 10_000
_UNKNOWN_COUNT = 16


def _nothing() -> None:
    return None


@dataclass(frozen=True)
class Workers:
    """An executor, and what one must know to keep it busy and to notice when it is gone."""

    executor: Executor
    count: Callable[[], int]
    """Blocks that it works on at once, now: clusters grow and shrink."""
    lost: tuple[type[BaseException], ...] = (BrokenExecutor,)
    """Errors of a block that say that workers died."""
    renew: Callable[[], None] | None = None
    """Start other workers in place of those that died, in the same executor."""
    must_answer: Callable[[], None] = _nothing
    """Raise `DechirpError` if nobody is there to work any more."""
    findings: tuple[Finding, ...] = ()


def chosen(
    *, workers: int | None = None, scheduler: str | None = None, cluster: str | None = None
) -> AbstractContextManager[Workers]:
    """Workers as the command line names them: processes without anything else.

    Parameters
    ----------
    workers : int, optional
        Processes of this machine, or workers of the cluster.
    scheduler : str, optional
        Address of a Dask scheduler that runs.
    cluster : str, optional
        `slurm`.

    Raises
    ------
    InvalidSetting
        If they do not go together; on entering, if they are not to be had.
    """
    if workers is not None:
        whole("--workers", workers, at_least=1, at_most=_MOST_WORKERS)
    if scheduler is not None and (workers is not None or cluster is not None):
        raise InvalidSetting(
            "--scheduler",
            got="given with --workers or --cluster",
            need="alone: its workers are those that were started with it",
            fix="Leave one of them out.",
        )
    if scheduler is not None:
        return dask(scheduler)
    if cluster is None:
        return local(workers)
    if cluster != "slurm":
        raise InvalidSetting(
            "--cluster",
            got=cluster,
            need="slurm",
            fix="For others start a Dask cluster, and give its address with --scheduler.",
        )
    return slurm(workers or 1)


def given(executor: Executor | None) -> AbstractContextManager[Workers]:
    """Any executor of `concurrent.futures`, left open; without one, one process a core.

    MPI programs give an `mpi4py.futures.MPIPoolExecutor`.

    Raises
    ------
    InvalidSetting
        If it is no executor.
    """
    if executor is None:
        return local()
    if not isinstance(executor, Executor):
        raise InvalidSetting(
            "executor",
            got=repr(executor),
            need="an Executor of concurrent.futures, or none",
            fix="Leave it out for one process a core.",
        )
    n = getattr(executor, "_max_workers", None)  # as all those of Python and loky have it
    n_workers = n if isinstance(n, int) and n > 0 else _UNKNOWN_COUNT
    return nullcontext(Workers(executor, lambda: n_workers))


@contextmanager
def local(n_workers: int | None = None) -> Iterator[Workers]:
    """Processes of this machine, one thread each; without a number one a core.

    They end with this process, whatever ends it.
    """
    pool = Processes(n_workers or cpu_count())
    lost = (BrokenExecutor, Stopped)
    try:
        yield Workers(pool, lambda: pool.n_workers, lost=lost, renew=pool.renew)
    finally:
        pool.shutdown()


@contextmanager
def dask(address: str, *, timeout_s: float = ANSWERS_WITHIN_S) -> Iterator[Workers]:
    """Workers of a Dask scheduler that runs already; it is left running.

    Parameters
    ----------
    address : str
        As `tcp://node:8786`.
    timeout_s : float
        Within which it must answer, and have a worker.

    Raises
    ------
    InvalidSetting
        If Dask is not installed, the scheduler does not answer or has no workers, or these have
        other versions of Python or of the libraries.
    """
    distributed = _distributed("--scheduler", address)
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not (host and port.isdecimal() and 0 < int(port) < 2**16):
        raise InvalidSetting(
            "--scheduler",
            got=repr(address),
            need="an address as tcp://node:8786",
            fix="Take the one that `dask scheduler` printed when it started.",
        )
    with _quiet():
        try:
            client = distributed.Client(address, timeout=timeout_s, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InvalidSetting(
                "--scheduler",
                got=f"{address}, which does not answer ({_first_line(error)})",
                need=f"a Dask scheduler that answers within {timeout_s:g} s",
                fix="Start one with `dask scheduler`, or mend the address.",
            ) from None
        try:
            try:
                client.wait_for_workers(1, timeout=timeout_s)
            except TimeoutError:
                raise InvalidSetting(
                    "--scheduler",
                    got=f"{address}, which has no workers",
                    need="one with workers",
                    fix=f"Start some with `dask worker {address} --nthreads 1`.",
                ) from None
            yield _workers_of(client, address)
        finally:
            _close(client)


@contextmanager
def slurm(n_workers: int) -> Iterator[Workers]:
    """Workers in jobs of Slurm, submitted here and cancelled at the end.

    Queue, account, time and memory are those of `~/.config/dask/jobqueue.yaml`, under
    `jobqueue: slurm:`, as dask-jobqueue reads it; without, a core, 2 GB and 8 hours a job. A job
    of several cores holds as many workers.

    Raises
    ------
    InvalidSetting
        If dask-jobqueue is not installed, or there is no `sbatch` on this machine.
    """
    distributed = _distributed("--cluster", "slurm")
    try:
        import dask.config
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError:
        raise _needs_extra("--cluster", "slurm") from None
    if shutil.which("sbatch") is None:
        raise InvalidSetting(
            "--cluster",
            got="slurm, on a machine that has no `sbatch`",
            need="given where jobs are submitted to Slurm",
            fix="Run this on the cluster's login node, or leave --cluster out.",
        )
    with _quiet():
        with warnings.catch_warnings():
            # Beside another study its dashboard takes another port: nothing of it is needed.
            warnings.filterwarnings("ignore", r"\s*Port \d+ is already in use")
            cluster: Any = SLURMCluster(**_job(dask.config.get("jobqueue.slurm", {})))
        try:
            cluster.scale(n_workers)
            client = distributed.Client(cluster, set_as_default=False)
            try:
                yield _workers_of(client, "the scheduler of --cluster slurm")
            finally:
                _close(client)
        finally:
            cluster.close()


def _job(configured: dict[str, Any]) -> dict[str, Any]:
    """Settings of a job of Slurm: those of the user's file, and one thread a worker."""
    cores = configured.get("cores") or 1
    return {
        "cores": cores,
        "processes": cores,
        "memory": configured.get("memory") or "2GB",
        "walltime": configured.get("walltime") or "08:00:00",
        "job_name": configured.get("name") or "dechirp",
        "job_script_prologue": [
            *(configured.get("job-script-prologue") or ()),
            *(f"export {name}={number}" for name, number in ONE_THREAD.items()),
        ],
    }


def _workers_of(client: Any, where: str) -> Workers:
    from distributed.scheduler import KilledWorker

    findings = (*_must_be_alike(client), *_with_threads(client))

    gone = DechirpError(
        Mistake(
            setting="--scheduler",
            got=f"{where}, which is gone",
            need="one that runs until the study has ended",
            fix="Start it again, and call again to go on: what was done is kept.",
        )
    )

    def must_answer() -> None:
        if client.status != "running":
            raise gone

    def count() -> int:
        must_answer()
        try:
            threads = client.sync(client.scheduler.ncores, callback_timeout=ANSWERS_WITHIN_S)
        except (OSError, TimeoutError):
            raise gone from None
        return sum(threads.values())

    return Workers(
        executor=client.get_executor(pure=False),
        count=count,
        lost=(BrokenExecutor, KilledWorker),
        must_answer=must_answer,
        findings=findings,
    )


def _must_be_alike(client: Any) -> tuple[Finding, ...]:
    """Raise where workers have other versions than this process; tell of other processors."""
    here = environment()
    found = client.run(environment, on_error="return")
    mistakes: list[Mistake] = []
    others: dict[str, str] = {}
    for worker, there in found.items():
        if isinstance(there, Exception):
            mistakes.append(_other_worker(worker, _first_line(there)))
            continue
        names = [name for name in differences(here, there) if name in versions()]
        if names:
            shown = ", ".join(f"{name} {there.get(name, 'absent')}" for name in names)
            mistakes.append(_other_worker(worker, shown, need=_versions_of(here, names)))
        elif there["processor"] != here["processor"]:
            others[worker] = there["processor"]
    if mistakes:
        raise DechirpError(*mistakes)
    if not others:
        return ()
    worker, processor = next(iter(others.items()))
    return (
        Finding(
            level="warning",
            setting="--scheduler",
            got=f"{len(others)} workers on another processor, {worker} on {processor}",
            need=f"{here['processor']}, as here, for results that are equal to the bit",
            fix="They are as right; last bits may differ, and a trial at a threshold with them.",
        ),
    )


def _with_threads(client: Any) -> tuple[Finding, ...]:
    """Tell of workers with several threads: blocks of one process take turns, see `alone`."""
    several = {worker: n for worker, n in client.nthreads().items() if n > 1}
    if not several:
        return ()
    worker, n = next(iter(several.items()))
    return (
        Finding(
            level="warning",
            setting="--scheduler",
            got=f"{len(several)} workers of several threads, {worker} of {n}",
            need="one thread each: blocks of a process run one after the other",
            fix="Start as many workers as cores: dask worker ADDRESS --nworkers N --nthreads 1.",
        ),
    )


def _other_worker(worker: str, got: str, need: str | None = None) -> Mistake:
    return Mistake(
        setting=f"worker {worker}",
        got=got,
        need=need or "one that can import dechirp",
        fix="Install the same versions there, and start it again.",
    )


def _versions_of(environment: dict[str, str], names: list[str]) -> str:
    return ", ".join(f"{name} {environment.get(name, 'absent')}" for name in names)


def _distributed(option: str, got: str) -> Any:
    try:
        import distributed
    except ImportError:
        raise _needs_extra(option, got) from None
    return distributed


def _needs_extra(option: str, got: str) -> InvalidSetting:
    return InvalidSetting(
        option,
        got=got,
        need="left out, as Dask is not installed",
        fix="Install it with: pip install 'dechirp[dask]'.",
    )


def _close(client: Any) -> None:
    """Leave a scheduler, without long waits for one that is gone."""
    client.close(timeout=2)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what Dask logs of lost connections off the screen: errors say it in words."""
    import logging

    logger = logging.getLogger("distributed")
    before = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(before)


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
