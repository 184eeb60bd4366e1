"""Which settings to try next, and which of them matter."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.experiment.study.study import Listed

if TYPE_CHECKING:
    from optuna.study import Study

Choice: TypeAlias = tuple[int, ...]
"""Of each setting, which of its values."""

_AT_RANDOM = 10  # choices before any is learnt from
_ASKED = 8  # times for one that was not tried yet
_MOST_LISTED = 100_000


def next_choice(
    search: Sequence[Listed], tried: Sequence[tuple[Choice, float]], *, seed: int
) -> Choice | None:
    """The choice to try after those; None when all were.

    Parameters
    ----------
    search : sequence of Listed
        Settings with their values; those of numbers are taken to be in order.
    tried : sequence of (choice, worth)
        In the order in which they were tried; only the order of worths counts, more is better.
    seed : int
        The same seed and the same past give the same choice, on one version of optuna.

    Notes
    -----
    Tree-structured Parzen estimators (J. Bergstra et al., Algorithms for hyper-parameter
    optimization, NIPS 2011) of optuna, after ten choices at random.
    """
    sizes = [len(one.texts) for one in search]
    past = {choice for choice, _ in tried}
    n_left = int(np.prod([float(size) for size in sizes])) - len(past)
    if n_left <= 0:
        return None
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(tried),)))
    if len(tried) >= _AT_RANDOM:
        asked = _asked(search, tried, [int(one) for one in rng.integers(2**31, size=_ASKED)])
        fresh = next((choice for choice in asked if choice not in past), None)
        if fresh is not None:
            return fresh
    if n_left + len(past) <= _MOST_LISTED:
        left = [choice for choice in np.ndindex(*sizes) if choice not in past]
        return tuple(int(one) for one in left[rng.integers(len(left))])
    while True:
        choice = tuple(int(rng.integers(size)) for size in sizes)
        if choice not in past:
            return choice


def importances(
    search: Sequence[Listed], tried: Sequence[tuple[Choice, float]]
) -> dict[str, float]:
    """Share of the variance of the worths that each setting explains, by path; none for few.

    From a forest of trees (F. Hutter et al., An efficient approach for assessing hyperparameter
    importance, ICML 2014).
    """
    worths = [worth for _, worth in tried]
    if len(tried) < 2 * _AT_RANDOM or not np.ptp(worths):
        return {}
    with _optuna() as optuna:
        study = _study(optuna, search, tried)
        evaluator = optuna.importance.FanovaImportanceEvaluator(seed=0)
        found = optuna.importance.get_param_importances(study, evaluator=evaluator)
    return {path: float(share) for path, share in found.items()}


def must_have_optuna() -> None:
    """Raise `InvalidSetting` where optuna is not installed."""
    with _optuna():
        pass


@contextmanager
def _optuna() -> Iterator[ModuleType]:
    """Optuna, which says nothing."""
    try:
        import optuna
    except ImportError:
        raise InvalidSetting(
            "dechirp tune",
            got="called without optuna",
            need="called where optuna is installed",
            fix="Install it: pip install 'dechirp[tune]'.",
        ) from None
    level = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        yield optuna
    finally:
        optuna.logging.set_verbosity(level)


def _asked(
    search: Sequence[Listed], tried: Sequence[tuple[Choice, float]], seeds: Sequence[int]
) -> Iterator[Choice]:
    with _optuna() as optuna:
        study = _study(optuna, search, tried)
        distributions = _distributions(optuna, search)
        for seed in seeds:
            study.sampler = optuna.samplers.TPESampler(seed=seed, n_startup_trials=0)
            trial = study.ask(distributions)
            study.tell(trial, state=optuna.trial.TrialState.FAIL)  # its worth is told next time
            yield tuple(int(trial.params[one.path]) for one in search)


def _study(
    optuna: ModuleType, search: Sequence[Listed], tried: Sequence[tuple[Choice, float]]
) -> "Study":
    study: Study = optuna.create_study(direction="maximize")
    distributions = _distributions(optuna, search)
    study.add_trials(
        [
            optuna.trial.create_trial(
                params={one.path: at for one, at in zip(search, choice, strict=True)},
                distributions=distributions,
                value=float(worth),
            )
            for choice, worth in tried
        ]
    )
    return study


def _distributions(optuna: ModuleType, search: Sequence[Listed]) -> dict[str, Any]:
    """Numbers by their place in the list, which keeps their order; words have none."""
    return {
        one.path: optuna.distributions.CategoricalDistribution(range(len(one.texts)))
        if one.numbers is None
        else optuna.distributions.IntDistribution(0, len(one.texts) - 1)
        for one in search
    }
