"""Trials in numbered blocks: the same numbers for any number of workers."""

import zlib
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, as_completed
from typing import Any

import numpy as np
from scipy.special import ndtri

from dechirp.core.values import value
from dechirp.experiment.verify.claim import CONFIDENCE

# Standard deviations between what theory gives and the end of its interval, 4.42.
Z = float(ndtri((1 + CONFIDENCE) / 2))


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


def run_all(
    jobs: Mapping[str, Job],
    *,
    seed: int,
    executor: Executor,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, np.ndarray]:
    """Results of all jobs by name, (n_trials, ...) each, in the order of the trials.

    The generator of a block follows from the seed, the name of the job and the number of the
    block alone. `progress` is called with the number of blocks done and of all.
    """
    waiting = {}
    for name, job in jobs.items():
        for block, start in enumerate(range(0, job.n_trials, job.n_each)):
            key = (zlib.crc32(name.encode()), block)
            sequence = np.random.SeedSequence(seed, spawn_key=key)
            n = min(job.n_each, job.n_trials - start)
            waiting[executor.submit(_block, job.work, sequence, n, dict(job.told))] = (name, block)
    parts: dict[str, dict[int, np.ndarray]] = {name: {} for name in jobs}
    try:
        for done, future in enumerate(as_completed(waiting), start=1):
            name, block = waiting[future]
            parts[name][block] = future.result()
            if progress is not None:
                progress(done, len(waiting))
    finally:
        for future in waiting:
            future.cancel()
    return {
        name: np.concatenate([part[block] for block in sorted(part)])
        for name, part in parts.items()
    }


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
