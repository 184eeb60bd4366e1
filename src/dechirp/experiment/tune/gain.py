"""How much better one setting is than another in the same trials, and how sure that is."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import betainc, stdtr, stdtrit

from dechirp.core.errors import InvalidSetting
from dechirp.theory.intervals import binomial

_MOST_GROUPS = 100


class Gain(NamedTuple):
    """A difference of two values of a score, with its interval; NaN where it is not known."""

    value: float
    low: float
    high: float
    certainty: float
    """That it is above 0: one less the chance of so much where there is no gain, one-sided."""


def paired_gain(
    before: np.ndarray,
    after: np.ndarray,
    value_of: Callable[[np.ndarray], float],
    *,
    confidence: float,
) -> Gain:
    """What `after` gains over `before`, of the same trials.

    Chance that both meet alike cancels: the interval is that of the differences, trial by trial.
    The trials must not be those by which one of the two was chosen.

    Parameters
    ----------
    before, after : array (n_trials, n_sums)
        Sums of a score, a row a trial, as `Score.sums`; the same trials in the same order. Trials
        that failed in either, rows of NaN, are left out of both.
    value_of : function
        The score of sums (n, n_sums).
    confidence : float
        Of the interval, two-sided.

    Raises
    ------
    InvalidSetting
        If the trials are not the same number, or fewer than two are left.

    Notes
    -----
    Where each trial is one look, a hit or a miss, all is exact: of n trials, D are a hit in one
    alone. Whether they favour `after` is the sign test (Q. McNemar, Psychometrika 12, 1947); the
    interval is that of (2 t - 1) d, with t the share of D that does and d = D / n, from two
    intervals of Clopper and Pearson, each missed half as often as stated: never missed more
    often in all, and wider than need be. Of other scores differences are taken as normal: up to
    100 groups of trials are left out in turn, and Student's interval is that of the jackknife's
    pseudo-values (B. Efron, The jackknife, the bootstrap and other resampling plans, 1982, ch. 3).
    Good for scores of many trials, none of which decides them.
    """
    if before.shape != after.shape:
        raise InvalidSetting(
            "after",
            got=f"sums {after.shape}",
            need=f"those of the same trials, {before.shape}",
            fix="Compare the same trials.",
        )
    whole = ~np.isnan(np.hstack([before, after])).any(axis=1)
    before, after = before[whole], after[whole]
    if len(before) < 2:
        raise InvalidSetting(
            "before", got=f"{len(before)} trials", need="two or more", fix="Try more often."
        )
    value = value_of(after) - value_of(before)
    if _are_hits(before) and _are_hits(after):
        better = int(np.sum(after[:, 0] > before[:, 0]))
        worse = int(np.sum(after[:, 0] < before[:, 0]))
        return _of_hits(value, better, worse, len(before), confidence)
    return _jackknifed(value, before, after, value_of, confidence)


def _are_hits(sums: np.ndarray) -> bool:
    """Whether every trial is one look: a hit or a miss, and 1."""
    return sums.shape[1] == 2 and bool(
        np.all(sums[:, 1] == 1) and np.isin(sums[:, 0], (0, 1)).all()
    )


def _of_hits(value: float, better: int, worse: int, n: int, confidence: float) -> Gain:
    apart = better + worse
    each = 1 - (1 - confidence) / 2
    least, most = binomial(apart, n, confidence=each)
    share = binomial(better, apart, confidence=each) if apart else (0.0, 1.0)
    low, high = 2 * share[0] - 1, 2 * share[1] - 1
    # P(better or more | n, 1/2): what chance alone would give.
    by_chance = float(betainc(better, worse + 1, 0.5)) if better else 1.0
    return Gain(
        value,
        low * (least if low > 0 else most),
        high * (most if high > 0 else least),
        1 - by_chance,
    )


def _jackknifed(
    value: float,
    before: np.ndarray,
    after: np.ndarray,
    value_of: Callable[[np.ndarray], float],
    confidence: float,
) -> Gain:
    n_groups = min(len(before), _MOST_GROUPS)
    group = np.arange(len(before)) * n_groups // len(before)
    left = [
        value_of(after[group != one]) - value_of(before[group != one]) for one in range(n_groups)
    ]
    pseudo = n_groups * value - (n_groups - 1) * np.array(left)
    error = float(np.std(pseudo, ddof=1)) / np.sqrt(n_groups)
    if not np.isfinite(error):
        return Gain(value, np.nan, np.nan, np.nan)
    if error == 0:  # every group the same
        return Gain(value, value, value, 1 - 0.5**n_groups if value > 0 else 0.0)
    reach = -float(stdtrit(n_groups - 1, (1 - confidence) / 2)) * error
    certainty = float(stdtr(n_groups - 1, value / error))
    return Gain(value, value - reach, value + reach, certainty)
