"""Measurement of an impairment, and the claim that follows from it."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dechirp.certificate.claim import CONFIDENCE, Check, Claim
from dechirp.certificate.trials import Job
from dechirp.core.values import frozen_dataclass
from dechirp.theory import confidence_intervals

MeasuredPair = tuple[float, float]
"""Measured value and value of the formula."""


@frozen_dataclass
class Quantity:
    """Quantity that is compared with a formula."""

    name: str
    unit: str
    tolerance: float
    """Largest permitted distance of the whole interval from the formula."""


@frozen_dataclass
class Measurement:
    """Measurement of one impairment."""

    kind: str
    """Kind of the impairment, as in settings files."""
    claim: str
    quantities: tuple[Quantity, ...]
    measure: Callable[[np.random.Generator], Sequence[MeasuredPair]]
    """Returns the measured and the formula value of each quantity."""
    n_trials: int = 1
    """Number of trials with independent noise; 1 if the measurement is deterministic."""

    @property
    def job_name(self) -> str:
        """Name of the job, from which the seed of its trials follows."""
        return f"impairment {self.kind}"

    def trial_job(self) -> Job:
        """Return the job that runs the trials."""
        return Job(
            work=_repeat_measurement,
            n_trials=self.n_trials,
            arguments={"measure": self.measure},
            block_size=16,
        )

    def evaluate_claim(self, results: Mapping[str, np.ndarray]) -> Claim:
        """Return the claim, given the results of all jobs."""
        values = results[self.job_name]
        return Claim(
            id=f"impairment_{self.kind.replace('-', '_')}",
            claim=self.claim,
            checks=tuple(
                _measured_against_formula_check(quantity, values[:, index])
                for index, quantity in enumerate(self.quantities)
            ),
        )


def _repeat_measurement(
    rng: np.random.Generator,
    n_trials: int,
    *,
    measure: Callable[[np.random.Generator], Sequence[MeasuredPair]],
) -> np.ndarray:
    """Return the measured and the formula value of each quantity, (n_trials, n_quantities, 2)."""
    return np.array([measure(rng) for _ in range(n_trials)])


def _measured_against_formula_check(quantity: Quantity, values: np.ndarray) -> Check:
    measured, formula = values.mean(axis=0)
    is_random, low, high = len(values) > 1, None, None
    if is_random and np.isfinite(values).all():
        low, high = confidence_intervals.mean_interval(values[:, 0], confidence=CONFIDENCE)
    return Check(
        name=quantity.name,
        unit=quantity.unit,
        measured=float(measured),
        low=low,
        high=high,
        at_least=float(formula - quantity.tolerance),
        at_most=float(formula + quantity.tolerance),
        limit=float(formula),
        trials=len(values) if is_random else None,
    )
