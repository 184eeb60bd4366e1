"""Sampler of settings to try, and the importance of each setting."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.experiments.study.study import SweptSetting

if TYPE_CHECKING:
    from optuna.study import Study

Choice: TypeAlias = tuple[int, ...]
"""Index of the value of each setting."""

_N_RANDOM = 10  # random choices at the start
_N_SAMPLES = 8  # attempts to find an untried choice
_MAX_ENUMERATED = 100_000


def choose_next_untried_settings(
    search: Sequence[SweptSetting], history: Sequence[tuple[Choice, float]], *, seed: int
) -> Choice | None:
    """Return the next choice to try; None if all have been tried.

    Parameters
    ----------
    search : sequence of SweptSetting
        Settings with their values; numeric values are assumed to be in order.
    history : sequence of (choice, worth)
        Earlier choices in order; only the order of worths counts, more is better.
    seed : int
        The same seed and history give the same choice, for one version of optuna.

    Notes
    -----
    Tree-structured Parzen estimators (J. Bergstra et al., Algorithms for hyper-parameter
    optimization, NIPS 2011) of optuna, after ten random choices.
    """
    sizes = [len(number.texts) for number in search]
    evaluated = {choice for choice, _ in history}
    n_untried = int(np.prod([float(size) for size in sizes])) - len(evaluated)
    if n_untried <= 0:
        return None
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(history),)))
    if len(history) >= _N_RANDOM:
        proposals = _sample_choices_by_tpe(
            search, history, [int(number) for number in rng.integers(2**31, size=_N_SAMPLES)]
        )
        fresh = next((choice for choice in proposals if choice not in evaluated), None)
        if fresh is not None:
            return fresh
    if n_untried + len(evaluated) <= _MAX_ENUMERATED:
        untried = [choice for choice in np.ndindex(*sizes) if choice not in evaluated]
        return tuple(int(number) for number in untried[rng.integers(len(untried))])
    while True:
        choice = tuple(int(rng.integers(size)) for size in sizes)
        if choice not in evaluated:
            return choice


def setting_importances(
    search: Sequence[SweptSetting], history: Sequence[tuple[Choice, float]]
) -> dict[str, float]:
    """Estimate the share of the variance of the worths that each setting explains, by path.

    Empty for few choices. From a forest of trees (F. Hutter et al., An efficient approach for
    assessing hyperparameter importance, ICML 2014).
    """
    worths = [worth for _, worth in history]
    if len(history) < 2 * _N_RANDOM or not np.ptp(worths):
        return {}
    with _import_optuna_with_silent_log() as optuna:
        study = _optuna_study_with_history(optuna, search, history)
        evaluator = optuna.importance.FanovaImportanceEvaluator(seed=0)
        shares = optuna.importance.get_param_importances(study, evaluator=evaluator)
    return {path: float(share) for path, share in shares.items()}


def check_optuna_installed() -> None:
    """Raise `InvalidSetting` if optuna is not installed."""
    with _import_optuna_with_silent_log():
        pass


@contextmanager
def _import_optuna_with_silent_log() -> Iterator[ModuleType]:
    """Import optuna with its log silenced."""
    try:
        import optuna
    except ImportError:
        raise InvalidSetting(
            "dechirp tune",
            value="called without Optuna installed",
            expected="Optuna, which proposes the settings to try",
            fix="run pip install 'dechirp[tune]'",
        ) from None
    level = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        yield optuna
    finally:
        optuna.logging.set_verbosity(level)


def _sample_choices_by_tpe(
    search: Sequence[SweptSetting], history: Sequence[tuple[Choice, float]], seeds: Sequence[int]
) -> Iterator[Choice]:
    with _import_optuna_with_silent_log() as optuna:
        study = _optuna_study_with_history(optuna, search, history)
        distributions = _optuna_index_distributions(optuna, search)
        for seed in seeds:
            study.sampler = optuna.samplers.TPESampler(seed=seed, n_startup_trials=0)
            trial = study.ask(distributions)
            # Its worth is added with the next history.
            study.tell(trial, state=optuna.trial.TrialState.FAIL)
            yield tuple(int(trial.params[setting.path]) for setting in search)


def _optuna_study_with_history(
    optuna: ModuleType, search: Sequence[SweptSetting], history: Sequence[tuple[Choice, float]]
) -> "Study":
    study: Study = optuna.create_study(direction="maximize")
    distributions = _optuna_index_distributions(optuna, search)
    study.add_trials(
        [
            optuna.trial.create_trial(
                params={setting.path: index for setting, index in zip(search, choice, strict=True)},
                distributions=distributions,
                value=float(worth),
            )
            for choice, worth in history
        ]
    )
    return study


def _optuna_index_distributions(
    optuna: ModuleType, search: Sequence[SweptSetting]
) -> dict[str, Any]:
    """Represent numbers by their index, which keeps their order; texts are categories."""
    return {
        setting.path: optuna.distributions.CategoricalDistribution(range(len(setting.texts)))
        if setting.numbers is None
        else optuna.distributions.IntDistribution(0, len(setting.texts) - 1)
        for setting in search
    }
