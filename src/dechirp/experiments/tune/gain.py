"""Gain of one setting over another in the same trials, with its confidence interval."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import betainc, stdtr, stdtrit

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


def paired_gain(
    first: np.ndarray,
    second: np.ndarray,
    value_of: Callable[[np.ndarray], float],
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
    value_of : function
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
    value = value_of(second) - value_of(first)
    if _are_binary(first) and _are_binary(second):
        better = int(np.sum(second[:, 0] > first[:, 0]))
        worse = int(np.sum(second[:, 0] < first[:, 0]))
        return _binary_gain(value, better, worse, len(first), confidence)
    return _jackknife_gain(value, first, second, value_of, confidence)


def _are_binary(sums: np.ndarray) -> bool:
    """Return whether every trial is a hit or a miss of one target."""
    return sums.shape[1] == 2 and bool(
        np.all(sums[:, 1] == 1) and np.isin(sums[:, 0], (0, 1)).all()
    )


def _binary_gain(value: float, better: int, worse: int, n: int, confidence: float) -> Gain:
    n_discordant = better + worse
    part_confidence = 1 - (1 - confidence) / 2
    least, most = binomial_interval(n_discordant, n, confidence=part_confidence)
    share = (
        binomial_interval(better, n_discordant, confidence=part_confidence)
        if n_discordant
        else (0.0, 1.0)
    )
    low, high = 2 * share[0] - 1, 2 * share[1] - 1
    # P(better or more | n, 1/2), under the null hypothesis.
    by_chance = float(betainc(better, worse + 1, 0.5)) if better else 1.0
    return Gain(
        value,
        low * (least if low > 0 else most),
        high * (most if high > 0 else least),
        1 - by_chance,
    )


def _jackknife_gain(
    value: float,
    first: np.ndarray,
    second: np.ndarray,
    value_of: Callable[[np.ndarray], float],
    confidence: float,
) -> Gain:
    n_groups = min(len(first), _MOST_GROUPS)
    group = np.arange(len(first)) * n_groups // len(first)
    leave_one_out = [
        value_of(second[group != index]) - value_of(first[group != index])
        for index in range(n_groups)
    ]
    pseudo = n_groups * value - (n_groups - 1) * np.array(leave_one_out)
    error = float(np.std(pseudo, ddof=1)) / np.sqrt(n_groups)
    if not np.isfinite(error):
        return Gain(value, np.nan, np.nan, np.nan)
    if error == 0:  # identical groups
        return Gain(value, value, value, 1 - 0.5**n_groups if value > 0 else 0.0)
    reach = -float(stdtrit(n_groups - 1, (1 - confidence) / 2)) * error
    certainty = float(stdtr(n_groups - 1, value / error))
    return Gain(value, value - reach, value + reach, certainty)
