"""Trials in numbered blocks: the same numbers for any number of workers."""

import zlib
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import Any

import numpy as np
from scipy.special import ndtri

from dechirp.core.errors import DechirpError, Mistake
from dechirp.core.values import value
from dechirp.experiment.verify.claim import CONFIDENCE

# Standard deviations between what theory gives and the end of its interval, 4.42.
Z = float(ndtri((1 + CONFIDENCE) / 2))

MOST_WAITING = 64
"""Blocks that an executor is given at once: enough for as many workers, little to cancel."""
_MOST_DEATHS = 10


@value
class Job:
    """Trials of one kind: `work` makes some of them with a generator of their own."""

    work: Callable[..., np.ndarray]
    """work(rng, n_trials, **told) gives (n_trials, ...), independent along the first axis."""
    n_trials: int
    told: Mapping[str, Any]
    """What else it is told; sent to the workers."""
    n_each: int = 50
    """Trials in a block: half a second of work or so."""

    @property
    def n_blocks(self) -> int:
        """Blocks of all trials, the last of which may be smaller."""
        return -(-self.n_trials // self.n_each)


def n_blocks(jobs: Mapping[str, Job]) -> int:
    """Of all jobs."""
    return sum(job.n_blocks for job in jobs.values())


def run_all(
    jobs: Mapping[str, Job],
    *,
    seed: int,
    executor: Executor,
    progress: Callable[[int, int], None] | None = None,
    lost: tuple[type[BaseException], ...] = (BrokenExecutor,),
    renew: Callable[[], None] | None = None,
) -> dict[str, np.ndarray]:
    """Results of all jobs by name, (n_trials, ...) each, in the order of the trials.

    The generator of a block follows from the seed, the name of the job and the number of the
    block alone. `progress` is called with the number of blocks done and of all.
    `lost` are errors that say that a worker died; `renew` starts others, which take its blocks.

    Raises
    ------
    DechirpError
        If workers die and no others can be started, or those die too.
    """
    blocks = [(name, block) for name, job in jobs.items() for block in range(job.n_blocks)]
    parts: dict[str, dict[int, np.ndarray]] = {name: {} for name in jobs}
    running: dict[Future[np.ndarray], tuple[str, int]] = {}
    waiting = deque(blocks)
    n_deaths = 0
    try:
        while waiting or running:
            try:
                while waiting and len(running) < MOST_WAITING:
                    name, block = waiting[0]
                    running[_submit(executor, jobs[name], seed, name, block)] = waiting.popleft()
                first = next(iter(wait(running, return_when=FIRST_COMPLETED).done))
                part = first.result()
            except lost as error:
                n_deaths += 1
                if renew is None or n_deaths > _MOST_DEATHS:
                    raise _killed(error) from None
                waiting.extendleft(running.values())
                running.clear()
                renew()
                continue
            name, block = running.pop(first)
            parts[name][block] = part
            if progress is not None:
                progress(len(blocks) - len(waiting) - len(running), len(blocks))
    finally:
        for future in running:
            future.cancel()
    return {
        name: np.concatenate([part[block] for block in sorted(part)])
        for name, part in parts.items()
    }


def _killed(error: BaseException) -> DechirpError:
    return DechirpError(
        Mistake(
            setting="workers",
            got=f"killed while they worked ({type(error).__name__})",
            need="alive",
            fix="Often memory was short: end other programs, and call again.",
        )
    )


def _submit(executor: Executor, job: Job, seed: int, name: str, block: int) -> Future[np.ndarray]:
    key = (zlib.crc32(name.encode()), block)
    sequence = np.random.SeedSequence(seed, spawn_key=key)
    n = min(job.n_each, job.n_trials - block * job.n_each)
    return executor.submit(_block, job.work, sequence, n, dict(job.told))


def _block(
    work: Callable[..., np.ndarray], sequence: np.random.SeedSequence, n: int, told: dict[str, Any]
) -> np.ndarray:
    return work(np.random.default_rng(sequence), n, **told)


def trials_for_probability(expected: float, *, at_least: float) -> int:
    """Trials that show a probability to be at least so large, where `expected` is the truth.

    n = (z (sqrt(p (1 - p)) + sqrt(q (1 - q))) / (p - q))^2 with p expected and q required: the
    interval of q and the spread of p meet in the middle. Where p is 1, so many that all hits
    show it.
    """
    if expected == 1:
        return int(np.ceil(1.1 * np.log((1 - CONFIDENCE) / 2) / np.log(at_least)))
    spread = np.sqrt(expected * (1 - expected)) + np.sqrt(at_least * (1 - at_least))
    return int(np.ceil((Z * spread / (expected - at_least)) ** 2))


def trials_for_rms(expected: float, *, at_most: float) -> int:
    """Trials that show a root mean square to be at most so large, where `expected` is the truth.

    The logarithm of a root mean square of n normal errors has a standard deviation of
    1 / sqrt(2 n); interval and spread have one share of the margin each.
    """
    return int(np.ceil((2 * Z / np.log(at_most / expected)) ** 2 / 2))


def trials_for_mean(std: float, *, within: float) -> int:
    """Trials that show a mean to be within so much of its truth, of values with that spread."""
    return int(np.ceil((2 * Z * std / within) ** 2))
