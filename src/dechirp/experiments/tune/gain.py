"""Gain of one setting over another in the same trials, with its confidence interval."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from dechirp.core.errors import InvalidSetting
from dechirp.theory.confidence_intervals import binomial_interval

_MOST_GROUPS = 100


class Gain(NamedTuple):
    """Difference of two values of a score, with its interval; NaN where it is unknown."""

    value: float
    low: float
    high: float
    certainty: float
    """Certainty that the gain is above 0: one minus the one-sided p-value of no gain."""


def estimate_paired_gain(
    first: np.ndarray,
    second: np.ndarray,
    score_of_sums: Callable[[np.ndarray], float],
    *,
    confidence: float,
) -> Gain:
    """Estimate the gain of `second` over `first` in the same trials.

    Randomness common to both cancels: the interval is that of the differences, trial by trial.
    The trials must not be those by which one of the two was chosen.

    Parameters
    ----------
    first, second : array (n_trials, n_sums)
        Sums of a score, a row a trial, as `Score.trial_sums`; the same trials in the same order.
        Trials that failed in either, rows of NaN, are excluded from both.
    score_of_sums : function
        Score of sums (n, n_sums).
    confidence : float
        Confidence of the two-sided interval.

    Raises
    ------
    InvalidSetting
        If the numbers of trials differ, or fewer than two are left.

    Notes
    -----
    Where each trial is a hit or a miss, the result is exact: of n trials, D are a hit in one
    alone. Whether they favour `second` is the sign test (Q. McNemar, Psychometrika 12, 1947); the
    interval is that of (2 t - 1) d, with t the share of D that does and d = D / n, from two
    intervals of Clopper and Pearson, each at half the error probability: conservative, and wider
    than necessary. Differences of other scores are assumed normal: up to 100 groups of trials are
    left out in turn, and Student's interval is that of the jackknife's pseudo-values (B. Efron,
    The jackknife, the bootstrap and other resampling plans, 1982, ch. 3). Valid for scores of many
    trials, no single one of which dominates.
    """
    if first.shape != second.shape:
        raise InvalidSetting(
            "after",
            value=f"sums {second.shape}",
            expected=f"those of the same trials, {first.shape}",
            fix="compare the same trials",
        )
    is_valid = ~np.isnan(np.hstack([first, second])).any(axis=1)
    first, second = first[is_valid], second[is_valid]
    if len(first) < 2:
        raise InvalidSetting(
            "before", value=f"{len(first)} trials", expected="two or more", fix="try more often"
        )
    value = score_of_sums(second) - score_of_sums(first)
    if _are_trials_hit_or_miss(first) and _are_trials_hit_or_miss(second):
        better = int(np.sum(second[:, 0] > first[:, 0]))
        worse = int(np.sum(second[:, 0] < first[:, 0]))
        return _hit_or_miss_gain(value, better, worse, len(first), confidence)
    return _jackknife_gain(value, first, second, score_of_sums, confidence)


def _are_trials_hit_or_miss(trial_sums: np.ndarray) -> bool:
    """Return whether every trial is a hit or a miss of one target."""
    return trial_sums.shape[1] == 2 and bool(
        np.all(trial_sums[:, 1] == 1) and np.isin(trial_sums[:, 0], (0, 1)).all()
    )


def _hit_or_miss_gain(
    estimated_gain: float, n_better: int, n_worse: int, n_trials: int, confidence: float
) -> Gain:
    n_discordant = n_better + n_worse
    part_confidence = 1 - (1 - confidence) / 2
    least, most = binomial_interval(n_discordant, n_trials, confidence=part_confidence)
    share = (
        binomial_interval(n_better, n_discordant, confidence=part_confidence)
        if n_discordant
        else (0.0, 1.0)
    )
    low, high = 2 * share[0] - 1, 2 * share[1] - 1
    # P(better or more | n, 1/2), under the null hypothesis.
    by_chance = float(scipy.special.betainc(n_better, n_worse + 1, 0.5)) if n_better else 1.0
    return Gain(
        estimated_gain,
        low * (least if low > 0 else most),
        high * (most if high > 0 else least),
        1 - by_chance,
    )


def _jackknife_gain(
    estimated_gain: float,
    first: np.ndarray,
    second: np.ndarray,
    score_of_sums: Callable[[np.ndarray], float],
    confidence: float,
) -> Gain:
    n_groups = min(len(first), _MOST_GROUPS)
    group = np.arange(len(first)) * n_groups // len(first)
    leave_one_out = [
        score_of_sums(second[group != index]) - score_of_sums(first[group != index])
        for index in range(n_groups)
    ]
    pseudo = n_groups * estimated_gain - (n_groups - 1) * np.array(leave_one_out)
    error = float(np.std(pseudo, ddof=1)) / np.sqrt(n_groups)
    if not np.isfinite(error):
        return Gain(estimated_gain, np.nan, np.nan, np.nan)
    if error == 0:  # identical groups
        return Gain(
            estimated_gain,
            estimated_gain,
            estimated_gain,
            1 - 0.5**n_groups if estimated_gain > 0 else 0.0,
        )
    reach = -float(scipy.special.stdtrit(n_groups - 1, (1 - confidence) / 2)) * error
    certainty = float(scipy.special.stdtr(n_groups - 1, estimated_gain / error))
    return Gain(estimated_gain, estimated_gain - reach, estimated_gain + reach, certainty)
