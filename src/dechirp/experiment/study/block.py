"""What comes back of some trials of one point: small, and the same wherever they ran."""

from dataclasses import dataclass

import numpy as np

from dechirp.core.findings import Finding


@dataclass(frozen=True)
class Failure:
    """A trial that raised."""

    trial: int
    message: str
    """Kind of the error and what it says."""


@dataclass(frozen=True, eq=False)
class Block:
    """Trials `first`, `first + 1`, ... of one point."""

    point: int
    number: int
    """Of the block: trials number * study.trials.block and on."""
    first: int
    sums: np.ndarray
    """(n_trials, n_columns) float64: the sums of all scores side by side, see `Layout`; NaN in
    the rows of trials that failed."""
    seconds: float
    """That all of them took."""
    failures: tuple[Failure, ...] = ()
    findings: tuple[Finding, ...] = ()
    """Warnings of the first block of the point."""
    theory: np.ndarray | None = None
    """With the first block of the point: what theory gives, of each score and subject, side by
    side, see `Layout.theory_of`; kept in the ledger beside the sums."""
    items: bytes = b""
    """All that is small of what a data set keeps of its trials, see `data_set`; kept as it is."""
