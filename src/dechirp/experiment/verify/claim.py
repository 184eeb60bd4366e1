"""What is certified: a claim, and the measurements that decide on it."""

import math

import numpy as np

from dechirp.core.values import value
from dechirp.theory import intervals

CONFIDENCE = 1 - 1e-5
"""Of every interval that decides: 5e-6 on each side.

A check passes when its interval lies within what is required, so that a pass is shown, not
merely not refuted. Trial counts make it miss by chance, where theory holds, 5e-6 of the time
on each side; no claim rests on more than sixteen sides, so that a false fail is rarer than
1e-4.
"""


@value
class Check:
    """One measurement, and what is required of it."""

    name: str
    """What tells it from the other checks of its claim."""
    unit: str
    """SI, dB, or 1 for ratios."""
    measured: float
    low: float | None = None
    """Ends of the interval; none where no chance is involved."""
    high: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    limit: float | None = None
    """What theory gives, or allows at best; none where it says no more than the requirement."""
    published: float | str | None = None
    """What the report says; none where it is silent."""
    trials: int | None = None
    """Independent trials (frames, or cells for a rate of false alarms) that it rests on."""

    @property
    def passed(self) -> bool:
        """Whether all of the interval lies within what is required."""
        low = self.measured if self.low is None else self.low
        high = self.measured if self.high is None else self.high
        if not all(math.isfinite(number) for number in (self.measured, low, high)):
            return False
        at_least = -math.inf if self.at_least is None else self.at_least
        at_most = math.inf if self.at_most is None else self.at_most
        return bool(at_least <= low and high <= at_most)


@value
class Claim:
    """One claim; the first check is its figure."""

    id: str
    claim: str
    """What is certified, a sentence."""
    checks: tuple[Check, ...]
    note: str = ""
    """What a reader should know about how it was measured, or why it differs."""

    @property
    def passed(self) -> bool:
        """Whether every check did."""
        return all(check.passed for check in self.checks)


@value
class Part:
    """Claims on one subject beyond the reference report."""

    id: str
    title: str
    how: str
    """How they were measured, sentences."""
    claims: tuple[Claim, ...]


def share(name: str, hits: np.ndarray, *, at_least: float, limit: float | None = None) -> Check:
    """Check of a share of trials, hits being 0 or 1."""
    low, high = intervals.binomial(int(hits.sum()), hits.size, confidence=CONFIDENCE)
    return Check(
        name=name,
        unit="1",
        measured=float(hits.mean()),
        low=low,
        high=high,
        at_least=at_least,
        limit=limit,
        trials=hits.size,
    )
