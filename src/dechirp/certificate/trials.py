"""Monte Carlo trials in numbered blocks, independent of the number of workers."""

import zlib
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import Any

import numpy as np
import scipy

from dechirp.certificate.claim import CONFIDENCE
from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import frozen_dataclass

# Half width of an interval at this confidence in standard deviations, 4.42.
Z_SCORE = float(scipy.special.ndtri((1 + CONFIDENCE) / 2))

MAX_QUEUED_BLOCKS = 64
"""Largest number of submitted blocks: enough for as many workers, few to cancel."""
_MAX_WORKER_DEATHS = 10


@frozen_dataclass
class Job:
    """Trials of one kind, run in blocks by `work`."""

    work: Callable[..., np.ndarray]
    """work(rng, n_trials, **arguments) returns (n_trials, ...), one independent row per trial."""
    n_trials: int
    arguments: Mapping[str, Any]
    """Further keyword arguments of `work`."""
    block_size: int = 50
    """Trials per block; about half a second of work."""

    @property
    def n_blocks(self) -> int:
        """Number of blocks; the last one may be smaller."""
        return -(-self.n_trials // self.block_size)


def count_trial_blocks(jobs: Mapping[str, Job]) -> int:
    """Return the number of blocks of all jobs."""
    return sum(job.n_blocks for job in jobs.values())


def run_jobs(
    jobs: Mapping[str, Job],
    *,
    seed: int,
    executor: Executor,
    progress: Callable[[int, int], None] | None = None,
    worker_errors: tuple[type[BaseException], ...] = (BrokenExecutor,),
    restart_workers: Callable[[], None] | None = None,
) -> dict[str, np.ndarray]:
    """Run all jobs and return their results by name, (n_trials, ...) each, in trial order.

    The random generator of a block depends only on the seed, the name of the job and the number of
    the block, so a job must keep its name to keep its numbers. `progress` is called with the
    number of finished blocks and the total number.
    `worker_errors` are the errors raised when a worker died; `restart_workers` starts others, which
    take its blocks.

    Raises
    ------
    DechirpError
        If workers die and no others can be started, or those die too.
    """
    blocks = [(name, block) for name, job in jobs.items() for block in range(job.n_blocks)]
    results_by_block: dict[str, dict[int, np.ndarray]] = {name: {} for name in jobs}
    running: dict[Future[np.ndarray], tuple[str, int]] = {}
    waiting = deque(blocks)
    n_deaths = 0
    try:
        while waiting or running:
            try:
                while waiting and len(running) < MAX_QUEUED_BLOCKS:
                    name, block = waiting[0]
                    running[_submit_trial_block(executor, jobs[name], seed, name, block)] = (
                        waiting.popleft()
                    )
                finished = next(iter(wait(running, return_when=FIRST_COMPLETED).done))
                block_result = finished.result()
            except worker_errors as error:
                n_deaths += 1
                if restart_workers is None or n_deaths > _MAX_WORKER_DEATHS:
                    raise _worker_death_error(error) from None
                waiting.extendleft(running.values())
                running.clear()
                restart_workers()
                continue
            name, block = running.pop(finished)
            results_by_block[name][block] = block_result
            if progress is not None:
                progress(len(blocks) - len(waiting) - len(running), len(blocks))
    finally:
        for future in running:
            future.cancel()
    return {
        name: np.concatenate([block_result[block] for block in sorted(block_result)])
        for name, block_result in results_by_block.items()
    }


def _worker_death_error(error: BaseException) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="workers",
            value=f"a worker process died during a block ({type(error).__name__})",
            expected="workers that stay alive",
            fix="close other programs if memory is short, and run again",
        )
    )


def _submit_trial_block(
    executor: Executor, job: Job, seed: int, name: str, block: int
) -> Future[np.ndarray]:
    key = (zlib.crc32(name.encode()), block)
    sequence = np.random.SeedSequence(seed, spawn_key=key)
    n_trials = min(job.block_size, job.n_trials - block * job.block_size)
    return executor.submit(_run_trial_block, job.work, sequence, n_trials, dict(job.arguments))


def _run_trial_block(
    work: Callable[..., np.ndarray],
    sequence: np.random.SeedSequence,
    n_trials: int,
    arguments: dict[str, Any],
) -> np.ndarray:
    use_compiled_kernels()
    return work(np.random.default_rng(sequence), n_trials, **arguments)


def count_trials_to_prove_probability(expected: float, *, at_least: float) -> int:
    """Return the number of trials that prove a probability of at least `at_least`.

    n = (z (sqrt(p (1 - p)) + sqrt(q (1 - q))) / (p - q))^2 with the true probability p (`expected`)
    and the required one q: the interval and the spread of the measured proportion share the margin.
    For p = 1, n trials without a miss are sufficient.
    """
    if expected == 1:
        return int(np.ceil(1.1 * np.log((1 - CONFIDENCE) / 2) / np.log(at_least)))
    spread = np.sqrt(expected * (1 - expected)) + np.sqrt(at_least * (1 - at_least))
    return int(np.ceil((Z_SCORE * spread / (expected - at_least)) ** 2))


def count_trials_to_prove_rms(expected: float, *, at_most: float) -> int:
    """Return the number of trials that prove an RMS value of at most `at_most`.

    The logarithm of the RMS of n normal errors has the standard deviation 1 / sqrt(2 n). The
    interval and the spread about the true value `expected` share the margin.
    """
    return int(np.ceil((2 * Z_SCORE / np.log(at_most / expected)) ** 2 / 2))


def count_trials_to_prove_mean(std: float, *, tolerance: float) -> int:
    """Return the number of trials that prove a mean `tolerance` a distance of its true value."""
    return int(np.ceil((2 * Z_SCORE * std / tolerance) ** 2))
