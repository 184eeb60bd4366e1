"""A measurement of an impairment: what it gives, and the claim that it makes."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dechirp.core.values import value
from dechirp.experiment.verify.claim import CONFIDENCE, Check, Claim
from dechirp.experiment.verify.trials import Job
from dechirp.theory import intervals

Measured = tuple[float, float]
"""What was measured, and what the formula gives."""


@value
class Quantity:
    """One number that is measured against a formula."""

    name: str
    unit: str
    within: float
    """Distance from the formula that is allowed, all of the interval included."""


@value
class Measurement:
    """How one impairment is measured."""

    kind: str
    """Of the impairment, as in settings files."""
    claim: str
    quantities: tuple[Quantity, ...]
    measure: Callable[[np.random.Generator], Sequence[Measured]]
    """Gives both numbers of each quantity."""
    n_trials: int = 1
    """With noise of their own each; one where no chance is involved."""

    @property
    def name(self) -> str:
        """Of its job."""
        return f"impairment {self.kind}"

    def job(self) -> Job:
        """Its trials."""
        return Job(work=_trials, n_trials=self.n_trials, told={"measure": self.measure}, n_each=16)

    def judged(self, results: Mapping[str, np.ndarray]) -> Claim:
        """The claim, from the results of all jobs."""
        found = results[self.name]
        return Claim(
            id=f"impairment_{self.kind.replace('-', '_')}",
            claim=self.claim,
            checks=tuple(
                _check(quantity, found[:, place]) for place, quantity in enumerate(self.quantities)
            ),
        )


def _trials(
    rng: np.random.Generator,
    n_trials: int,
    *,
    measure: Callable[[np.random.Generator], Sequence[Measured]],
) -> np.ndarray:
    """Both numbers of each quantity, (n_trials, n_quantities, 2)."""
    return np.array([measure(rng) for _ in range(n_trials)])


def _check(quantity: Quantity, found: np.ndarray) -> Check:
    measured, formula = found.mean(axis=0)
    by_chance, low, high = len(found) > 1, None, None
    if by_chance and np.isfinite(found).all():
        low, high = intervals.mean(found[:, 0], confidence=CONFIDENCE)
    return Check(
        name=quantity.name,
        unit=quantity.unit,
        measured=float(measured),
        low=low,
        high=high,
        at_least=float(formula - quantity.within),
        at_most=float(formula + quantity.within),
        limit=float(formula),
        trials=len(found) if by_chance else None,
    )
