"""Block: the results of consecutive trials of a point, whichever worker ran them."""

from dataclasses import dataclass

import numpy as np

from dechirp.core.findings import Finding


@dataclass(frozen=True)
class Failure:
    """A trial that raised an exception."""

    trial: int
    message: str
    """Type of the exception and its message."""


@dataclass(frozen=True, eq=False)
class Block:
    """Results of the trials `first`, `first + 1`, ... of one point."""

    point: int
    number: int
    """Number of the block: its trials start at number * study.trials.block."""
    first: int
    sums: np.ndarray
    """(n_trials, n_columns) float64: the sums of all scores side by side, see `ScoreColumnLayout`;
    NaN in the rows of trials that failed."""
    seconds: float
    """Computing time of all trials."""
    failures: tuple[Failure, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Warnings; only in the first block of a point."""
    theory: np.ndarray | None = None
    """Theoretical values of each score and target, side by side, see
    `ScoreColumnLayout.theoretical_score_value`; only in the first block of a point. The ledger
    stores them beside the sums."""
    items: bytes = b""
    """Packed detections, truth and scales of data set items, see `data_set`; stored unchanged."""
