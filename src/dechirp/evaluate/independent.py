"""What independent trials tell: means and rates, with intervals; `shares` has shares.

Within a trial nothing is taken to be independent: frames share their targets' fluctuation and
their tracks, neighbouring cells their noise. So trials are what scatters, and what is counted in
them is only summed. Rows of NaN are trials that failed, and are left out. Where one trial alone
does not tell how trials scatter the interval is NaN.
"""

import numpy as np
from scipy.special import gammainccinv, gammaincinv, stdtrit

from dechirp.evaluate.score.base import NOTHING, Estimate
from dechirp.theory import intervals


def ratio(totals: np.ndarray, numbers: np.ndarray, *, confidence: float) -> Estimate:
    """Mean of what was summed, (n_trials,), over so many in each trial.

    Student's interval, for what trials scatter about the mean of all: from some tens of trials.
    """
    totals, numbers = _finished(totals, numbers)
    if not numbers.sum():
        return NOTHING
    mean = float(totals.sum() / numbers.sum())
    if len(totals) < 2:
        return Estimate(mean, np.nan, np.nan)
    off = (totals - mean * numbers) / numbers.mean()
    low, high = intervals.mean(mean + off, confidence=confidence)
    return Estimate(mean, low, high)


def rate(counts: np.ndarray, exposures: np.ndarray, *, confidence: float) -> Estimate:
    r"""Events over exposure, (n_trials,) each; events may come in clusters.

    With D the variance of the counts over their mean, no less than 1, n events are worth n / D
    independent ones, whose Poisson interval (Garwood 1936) is

    .. math:: D \gamma^{-1}(n / D, \tfrac{1-c}2) \ldots D \gamma^{-1}(n / D + 1, \tfrac{1+c}2)

    with the inverse of the regularised incomplete gamma function; or it is Student's, which
    knows of few trials, where that is wider. Without an event, high is that of single ones.

    Missed by as many as stated where events are single, however few. D is not known well from
    few clusters: in 50 to 1,000 trials with clusters of two to four events and a tail of 0.025
    high is missed by 0.04 to 0.06 where 10 clusters are expected, 0.03 to 0.04 at 30, 0.03 at 100;
    `theory.intervals.rate` is by 0.10 to 0.12, 0.06 to 0.08, 0.04 to 0.05.
    """
    counts, exposures = _finished(counts, exposures)
    exposure = float(exposures.sum())
    if not exposure:
        return NOTHING
    n_events, tail = float(counts.sum()), (1 - confidence) / 2
    if len(counts) < 2:
        return Estimate(n_events / exposure, np.nan, np.nan)
    # Trials of unlike exposure would scatter without chance.
    off = counts - n_events * exposures / exposure
    variance = float(np.sum(off**2)) / (len(counts) - 1)
    alike = max(variance * len(counts) / n_events, 1.0) if n_events else 1.0
    low = alike * gammaincinv(n_events / alike, tail) if n_events else 0.0
    high = alike * gammainccinv(n_events / alike + 1, tail)
    reach = -stdtrit(len(counts) - 1, tail) * np.sqrt(alike * n_events)
    low, high = min(low, max(n_events - reach, 0.0)), max(high, n_events + reach)
    return Estimate(n_events / exposure, float(low) / exposure, float(high) / exposure)


def _finished(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    ran = np.isfinite(columns).all(axis=0)
    return tuple(column[ran] for column in columns)
