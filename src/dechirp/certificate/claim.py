"""Claims of a certificate and the checks that decide them."""

import math

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.theory import confidence_intervals

CONFIDENCE = 1 - 1e-5
"""Confidence of every interval that decides a check: 5e-6 on each side.

A check passes if its whole interval satisfies the requirement, so a pass is demonstrated and not
merely not refuted. The trial counts are chosen so that a check fails by chance with a probability
of 5e-6 per side if theory holds. No claim has more than sixteen interval ends with a requirement,
so the probability of a false failure is below 1e-4.
"""


@frozen_dataclass
class Check:
    """Measurement with its interval, its requirement and its theoretical value."""

    name: str
    """Name of the measured quantity, unique within the claim."""
    unit: str
    """SI unit, dB, or 1 for ratios."""
    measured: float
    low: float | None = None
    """Lower and upper end of the interval; None if the measurement is deterministic."""
    high: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    limit: float | None = None
    """Value or bound from theory; None if theory adds nothing to the requirement."""
    published: float | str | None = None
    """Value or statement of the report; None if the report has none."""
    trials: int | None = None
    """Number of independent trials: frames, or cells for a false-alarm rate."""

    @property
    def passed(self) -> bool:
        """True if the whole interval satisfies the requirement."""
        low = self.measured if self.low is None else self.low
        high = self.measured if self.high is None else self.high
        if not all(math.isfinite(number) for number in (self.measured, low, high)):
            return False
        at_least = -math.inf if self.at_least is None else self.at_least
        at_most = math.inf if self.at_most is None else self.at_most
        return bool(at_least <= low and high <= at_most)


@frozen_dataclass
class Claim:
    """Statement with its checks; the first check provides the value shown for the claim."""

    id: str
    claim: str
    """Statement that is certified, one sentence."""
    checks: tuple[Check, ...]
    note: str = ""
    """Note on the measurement, or on the difference from the published value."""

    @property
    def passed(self) -> bool:
        """True if all checks passed."""
        return all(check.passed for check in self.checks)


@frozen_dataclass
class Part:
    """Part of a full certificate: claims on one subject beyond the reference report."""

    id: str
    title: str
    method: str
    """Measurement method, in sentences."""
    claims: tuple[Claim, ...]


def proportion_check(
    name: str, hits: np.ndarray, *, at_least: float, limit: float | None = None
) -> Check:
    """Return the check of a proportion of trials; `hits` (n,) is 0 or 1."""
    low, high = confidence_intervals.binomial_interval(
        int(hits.sum()), hits.size, confidence=CONFIDENCE
    )
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
