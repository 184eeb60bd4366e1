"""What `--full` certifies beyond the reference report: trials and claims, part by part."""

from collections.abc import Mapping

import numpy as np

from dechirp.experiment.verify import directions, every_detector, impaired
from dechirp.experiment.verify.claim import Part
from dechirp.experiment.verify.trials import Job, n_blocks


def jobs(n_trials: int) -> dict[str, Job]:
    """Trials of all parts, but for those that need what some of these find."""
    return {**every_detector.factor_jobs(), **directions.jobs(n_trials), **impaired.jobs()}


def n_later() -> int:
    """Blocks of `later`."""
    return n_blocks(every_detector.jobs(None, every_detector.CELLS))


def later(results: Mapping[str, np.ndarray]) -> dict[str, Job]:
    """Trials that need results of `jobs`: maps of noise need factors."""
    return every_detector.jobs(results, every_detector.CELLS)


def parts(results: Mapping[str, np.ndarray]) -> tuple[Part, ...]:
    """All claims."""
    return every_detector.part(results), directions.part(results), impaired.part(results)
