"""Executors of trial blocks: processes of this machine, Dask, Slurm, or any other executor."""

import shutil
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

from loky import cpu_count

from dechirp.core.checks import check_integer
from dechirp.core.errors import DechirpError, InvalidSetting, Mistake
from dechirp.core.findings import Finding
from dechirp.experiments.study.environment import (
    keys_with_different_values,
    library_versions,
    versions_system_and_processor,
)
from dechirp.experiments.study.processes import ONE_THREAD, RestartablePool, WorkerStopped

ANSWER_TIMEOUT_S = 10.0
_MAX_WORKERS = 10_000
_DEFAULT_CAPACITY = 16


def _do_nothing() -> None:
    return None


@dataclass(frozen=True)
class Workers:
    """An executor, with its capacity and the means to detect dead workers."""

    executor: Executor
    capacity: Callable[[], int]
    """Return the number of blocks that run at once now: clusters grow and shrink."""
    death_errors: tuple[type[BaseException], ...] = (BrokenExecutor,)
    """Exceptions of a block that mean that workers died."""
    renew: Callable[[], None] | None = None
    """Start new workers in place of the dead ones, in the same executor."""
    check_alive: Callable[[], None] = _do_nothing
    """Raise `DechirpError` if no worker can be reached any more."""
    findings: tuple[Finding, ...] = ()


def workers_from_options(
    *, workers: int | None = None, scheduler: str | None = None, cluster: str | None = None
) -> AbstractContextManager[Workers]:
    """Create the workers that the command line selects; without options, local processes.

    Parameters
    ----------
    workers : int, optional
        Number of local processes, or of workers of the cluster.
    scheduler : str, optional
        Address of a running Dask scheduler.
    cluster : str, optional
        `slurm`.

    Raises
    ------
    InvalidSetting
        If the options exclude each other; on entering, if the workers are not available.
    """
    if workers is not None:
        check_integer("--workers", workers, at_least=1, at_most=_MAX_WORKERS)
    if scheduler is not None and (workers is not None or cluster is not None):
        raise InvalidSetting(
            "--scheduler",
            value=f"cannot be combined with --{'cluster' if workers is None else 'workers'}",
            expected="a running scheduler, which has its own workers",
            fix="remove one of them",
        )
    if scheduler is not None:
        return dask_workers(scheduler)
    if cluster is None:
        return local_workers(workers)
    if cluster != "slurm":
        raise InvalidSetting(
            "--cluster",
            value=cluster,
            expected="slurm",
            fix="for others start a Dask cluster, and give its address with --scheduler",
        )
    return slurm_workers(workers or 1)


def workers_from_executor(executor: Executor | None) -> AbstractContextManager[Workers]:
    """Wrap any executor of `concurrent.futures`, which stays open; without one, one process a core.

    MPI programs pass an `mpi4py.futures.MPIPoolExecutor`.

    Raises
    ------
    InvalidSetting
        If the argument is not an executor.
    """
    if executor is None:
        return local_workers()
    if not isinstance(executor, Executor):
        raise InvalidSetting(
            "executor",
            value=repr(executor),
            expected="an Executor of concurrent.futures, or none",
            fix="leave it out for one process a core",
        )
    n = getattr(executor, "_max_workers", None)  # all executors of Python and loky have it
    n_workers = n if isinstance(n, int) and n > 0 else _DEFAULT_CAPACITY
    return nullcontext(Workers(executor, lambda: n_workers))


@contextmanager
def local_workers(n_workers: int | None = None) -> Iterator[Workers]:
    """Start single-threaded processes on this machine, by default one a core.

    They end with this process, whatever ends it.
    """
    pool = RestartablePool(n_workers or cpu_count())
    death_errors = (BrokenExecutor, WorkerStopped)
    try:
        yield Workers(
            pool,
            lambda: pool.n_workers,
            death_errors=death_errors,
            renew=pool.replace_all_processes,
        )
    finally:
        pool.shutdown()


@contextmanager
def dask_workers(address: str, *, timeout_s: float = ANSWER_TIMEOUT_S) -> Iterator[Workers]:
    """Connect to a Dask scheduler that is already running, and leave it running.

    Parameters
    ----------
    address : str
        For example `tcp://node:8786`.
    timeout_s : float
        Time limit for the scheduler to answer and to have a worker.

    Raises
    ------
    InvalidSetting
        If Dask is not installed, the scheduler does not answer or has no workers, or the workers
        have other versions of Python or of the libraries.
    """
    distributed = _import_dask_distributed("--scheduler", address)
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not (host and port.isdecimal() and 0 < int(port) < 2**16):
        raise InvalidSetting(
            "--scheduler",
            value=repr(address),
            expected="an address as tcp://node:8786",
            fix="take the one that `dask scheduler` printed when it started",
        )
    with _silence_dask_log():
        try:
            client = distributed.Client(address, timeout=timeout_s, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InvalidSetting(
                "--scheduler",
                value=f"{address}, which does not answer ({_first_line_of_message(error)})",
                expected=f"a Dask scheduler that answers within {timeout_s:g} s",
                fix="start one with `dask scheduler`, or mend the address",
            ) from None
        try:
            try:
                client.wait_for_workers(1, timeout=timeout_s)
            except TimeoutError:
                raise InvalidSetting(
                    "--scheduler",
                    value=f"{address}, which has no workers",
                    expected="a scheduler with workers",
                    fix=f"start some with `dask worker {address} --nthreads 1`",
                ) from None
            yield _workers_of_dask_client(client, address)
        finally:
            _close_dask_client(client)


@contextmanager
def slurm_workers(n_workers: int) -> Iterator[Workers]:
    """Submit workers as Slurm jobs, and cancel the jobs at the end.

    Queue, account, time and memory are those of `~/.config/dask/jobqueue.yaml`, under
    `jobqueue: slurm:`, as dask-jobqueue reads it; by default a core, 2 GB and 8 hours a job. A job
    with several cores runs as many workers.

    Raises
    ------
    InvalidSetting
        If dask-jobqueue is not installed, or `sbatch` is missing on this machine.
    """
    distributed = _import_dask_distributed("--cluster", "slurm")
    try:
        import dask.config
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError:
        raise _dask_not_installed_error("--cluster", "slurm") from None
    if shutil.which("sbatch") is None:
        raise InvalidSetting(
            "--cluster",
            value="slurm, on a machine that has no `sbatch`",
            expected="a machine from which jobs can be submitted to Slurm",
            fix="run this on the cluster's login node, or remove --cluster",
        )
    with _silence_dask_log():
        with warnings.catch_warnings():
            # A concurrent study occupies the default port of the dashboard, which is not used.
            warnings.filterwarnings("ignore", r"\s*Port \d+ is already in use")
            cluster: Any = SLURMCluster(
                **_complete_slurm_job_settings(dask.config.get("jobqueue.slurm", {}))
            )
        try:
            cluster.scale(n_workers)
            client = distributed.Client(cluster, set_as_default=False)
            try:
                yield _workers_of_dask_client(client, "the scheduler of --cluster slurm")
            finally:
                _close_dask_client(client)
        finally:
            cluster.close()


def _complete_slurm_job_settings(user_settings: dict[str, Any]) -> dict[str, Any]:
    """Complete the user's Slurm job settings; each worker has one thread."""
    cores = user_settings.get("cores") or 1
    return {
        "cores": cores,
        "processes": cores,
        "memory": user_settings.get("memory") or "2GB",
        "walltime": user_settings.get("walltime") or "08:00:00",
        "job_name": user_settings.get("name") or "dechirp",
        "job_script_prologue": [
            *(user_settings.get("job-script-prologue") or ()),
            *(f"export {name}={number}" for name, number in ONE_THREAD.items()),
        ],
    }


def _workers_of_dask_client(client: Any, scheduler_text: str) -> Workers:
    from distributed.scheduler import KilledWorker

    findings = (
        *_check_worker_versions_and_processors(client),
        *_multithreaded_worker_findings(client),
    )

    gone_error = DechirpError(
        Mistake(
            setting="--scheduler",
            value=f"{scheduler_text}, which is gone",
            expected="a scheduler that runs until the study has ended",
            fix="start it again, and call again to go on: what was done is kept",
        )
    )

    def must_answer() -> None:
        if client.status != "running":
            raise gone_error

    def count() -> int:
        must_answer()
        try:
            threads = client.sync(client.scheduler.ncores, callback_timeout=ANSWER_TIMEOUT_S)
        except (OSError, TimeoutError):
            raise gone_error from None
        return sum(threads.values())

    return Workers(
        executor=client.get_executor(pure=False),
        capacity=count,
        death_errors=(BrokenExecutor, KilledWorker),
        check_alive=must_answer,
        findings=findings,
    )


def _check_worker_versions_and_processors(dask_client: Any) -> tuple[Finding, ...]:
    """Raise if workers have other versions than this process; find other processors."""
    own_environment = versions_system_and_processor()
    environments = dask_client.run(versions_system_and_processor, on_error="return")
    mistakes: list[Mistake] = []
    other_processors: dict[str, str] = {}
    for worker, worker_environment in environments.items():
        if isinstance(worker_environment, Exception):
            mistakes.append(
                _worker_versions_mistake(worker, _first_line_of_message(worker_environment))
            )
            continue
        names = [
            name
            for name in keys_with_different_values(own_environment, worker_environment)
            if name in library_versions()
        ]
        if names:
            texts = ", ".join(f"{name} {worker_environment.get(name, 'missing')}" for name in names)
            mistakes.append(
                _worker_versions_mistake(
                    worker, texts, expected=_versions_as_text(own_environment, names)
                )
            )
        elif worker_environment["processor"] != own_environment["processor"]:
            other_processors[worker] = worker_environment["processor"]
    if mistakes:
        raise DechirpError(*mistakes)
    if not other_processors:
        return ()
    worker, processor = next(iter(other_processors.items()))
    return (
        Finding(
            level="warning",
            setting="--scheduler",
            value=f"{len(other_processors)} workers on another processor, {worker} on {processor}",
            expected=f"{own_environment['processor']}, as here, for bitwise equal results",
            fix="no action is needed: results are equally valid, but their last bits may differ",
        ),
    )


def _multithreaded_worker_findings(dask_client: Any) -> tuple[Finding, ...]:
    """Return a finding on workers with several threads: blocks of one process run in turn."""
    several = {worker: n for worker, n in dask_client.nthreads().items() if n > 1}
    if not several:
        return ()
    worker, n = next(iter(several.items()))
    return (
        Finding(
            level="warning",
            setting="--scheduler",
            value=f"{len(several)} workers of several threads, {worker} of {n}",
            expected="one thread each: blocks of a process run one after the other",
            fix="start as many workers as cores: dask worker ADDRESS --nworkers N --nthreads 1",
        ),
    )


def _worker_versions_mistake(worker: str, value: str, expected: str | None = None) -> Mistake:
    return Mistake(
        setting=f"worker {worker}",
        value=value,
        expected=expected or "one that can import dechirp",
        fix="install the same versions there, and start it again",
    )


def _versions_as_text(environment: dict[str, str], names: list[str]) -> str:
    return ", ".join(f"{name} {environment.get(name, 'missing')}" for name in names)


def _import_dask_distributed(option: str, value: str) -> Any:
    try:
        import distributed
    except ImportError:
        raise _dask_not_installed_error(option, value) from None
    return distributed


def _dask_not_installed_error(option: str, value: str) -> InvalidSetting:
    return InvalidSetting(
        option,
        value=f"{value}, without Dask installed",
        expected="Dask, which runs the workers",
        fix="run pip install 'dechirp[dask]'",
    )


def _close_dask_client(client: Any) -> None:
    """Close the client without waiting long for a scheduler that is gone."""
    client.close(timeout=2)


@contextmanager
def _silence_dask_log() -> Iterator[None]:
    """Suppress Dask's log of lost connections, which raised errors describe in full."""
    import logging

    logger = logging.getLogger("distributed")
    previous_level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(previous_level)


def _first_line_of_message(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
