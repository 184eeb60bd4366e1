"""Means and rates over independent trials, with confidence intervals.

Nothing within a trial is assumed to be independent: frames share target fluctuations and tracks,
neighbouring cells share noise. So the scatter of trials is the basis, and counts within a trial are
only summed. Rows of NaN are failed trials and are omitted. A single trial gives an interval of NaN.
"""

import numpy as np
import scipy

from dechirp.evaluation.score.base import NO_ESTIMATE, Estimate
from dechirp.theory import confidence_intervals


def estimate_mean(totals: np.ndarray, numbers: np.ndarray, *, confidence: float) -> Estimate:
    """Estimate the mean of summed values, (n_trials,), over their numbers in each trial.

    Student's interval from the scatter of trials about the common mean; valid from some tens of
    trials.
    """
    totals, numbers = _drop_failed_trials(totals, numbers)
    if not numbers.sum():
        return NO_ESTIMATE
    mean = float(totals.sum() / numbers.sum())
    if len(totals) < 2:
        return Estimate(mean, np.nan, np.nan)
    deviations = (totals - mean * numbers) / numbers.mean()
    low, high = confidence_intervals.mean_interval(mean + deviations, confidence=confidence)
    return Estimate(mean, low, high)


def estimate_rate(counts: np.ndarray, exposures: np.ndarray, *, confidence: float) -> Estimate:
    r"""Estimate the rate of events over exposure, (n_trials,) each; events may be clustered.

    With D the variance of the counts over their mean, at least 1, n events are equivalent to n / D
    independent ones, whose Poisson interval (Garwood 1936) is

    .. math:: D \gamma^{-1}(n / D, \tfrac{1-c}2) \ldots D \gamma^{-1}(n / D + 1, \tfrac{1+c}2)

    with the inverse of the regularised incomplete gamma function; or it is Student's, which
    accounts for few trials, if that is wider. Without an event, the upper end is that of single
    ones.

    Coverage is as stated for single events, however few. D is uncertain for few clusters: in 50 to
    1,000 trials with clusters of two to four events and a tail of 0.025, the upper end is exceeded
    with probability 0.04 to 0.06 for 10 expected clusters, 0.03 to 0.04 for 30, 0.03 for 100; that
    of `theory.confidence_intervals.rate` with 0.10 to 0.12, 0.06 to 0.08, 0.04 to 0.05.
    """
    counts, exposures = _drop_failed_trials(counts, exposures)
    exposure = float(exposures.sum())
    if not exposure:
        return NO_ESTIMATE
    n_events, tail = float(counts.sum()), (1 - confidence) / 2
    if len(counts) < 2:
        return Estimate(n_events / exposure, np.nan, np.nan)
    # Deviations from the expected count of each exposure.
    deviations = counts - n_events * exposures / exposure
    variance = float(np.sum(deviations**2)) / (len(counts) - 1)
    events_per_cluster = max(variance * len(counts) / n_events, 1.0) if n_events else 1.0
    low = (
        events_per_cluster * scipy.special.gammaincinv(n_events / events_per_cluster, tail)
        if n_events
        else 0.0
    )
    high = events_per_cluster * scipy.special.gammainccinv(n_events / events_per_cluster + 1, tail)
    half_width = -scipy.special.stdtrit(len(counts) - 1, tail) * np.sqrt(
        events_per_cluster * n_events
    )
    low, high = min(low, max(n_events - half_width, 0.0)), max(high, n_events + half_width)
    return Estimate(n_events / exposure, float(low) / exposure, float(high) / exposure)


def _drop_failed_trials(*columns: np.ndarray) -> tuple[np.ndarray, ...]:
    is_completed = np.isfinite(columns).all(axis=0)
    return tuple(column[is_completed] for column in columns)
