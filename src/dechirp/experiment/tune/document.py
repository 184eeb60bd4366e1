"""What a search found, as plain values for JSON and for the page about it."""

from collections.abc import Mapping
from typing import Any

from dechirp.config.quantities import text_of
from dechirp.config.texts import plain
from dechirp.core.kinds import KINDS
from dechirp.evaluate.score.base import Estimate
from dechirp.experiment.study.text import unit_of
from dechirp.experiment.tune.run import Candidate, Confirmed, Tuned


def document(tuned: Tuned) -> dict[str, Any]:
    """All numbers of a search, SI: settings as files write them, and scores with intervals.

    `best` is null where every candidate was shown to be beyond a limit; `default` are the
    settings as they are, candidate 0. Both are of fresh trials; `trials` are of the search.
    """
    tune = tuned.tune
    return {
        "name": tune.name,
        "seed": tune.seed,
        "confidence": tune.confidence,
        "looks": {"search": tuned.n_looks[0], "fresh": tuned.n_looks[1]},
        "aim": {
            "towards": tune.aim.towards,
            "score": tune.aim.score.label(),
            "unit": tune.aim.score.unit,
            "limits": [
                {
                    "score": limit.score.label(),
                    "unit": limit.score.unit,
                    "at_most": limit.at_most,
                    "at_least": limit.at_least,
                    "text": limit_text(tuned, number),
                }
                for number, limit in enumerate(tune.aim.limits)
            ],
        },
        "search": {one.path: list(one.texts) for one in tune.search},
        "best": None if tuned.best is None else _confirmed(tuned, tuned.best),
        "default": _confirmed(tuned, tuned.default),
        "gain": None if tuned.gain is None else tuned.gain._asdict(),
        "refuted": [_confirmed(tuned, one) for one in tuned.refuted],
        "importances": dict(tuned.importances),
        "trials": [_candidate(one) for one in tuned.candidates],
        "findings": [plain(one) for one in tuned.findings],
    }


def limit_text(tuned: Tuned, number: int) -> str:
    """A limit in words: `at most 1e-06`, `at most 10 cm`."""
    limit = tuned.tune.aim.limits[number]
    bound = limit.at_most if limit.at_most is not None else limit.at_least
    assert bound is not None
    words = "at most" if limit.at_most is not None else "at least"
    unit = unit_of(limit.score)
    return (
        f"{words} {text_of(bound, unit) if unit in KINDS and KINDS[unit].base else _plain(bound)}"
    )


def _plain(number: float) -> str:
    return f"{number:g}".replace("e-0", "e-")


def _confirmed(tuned: Tuned, one: Confirmed) -> dict[str, Any]:
    return {
        "number": one.number,
        "settings": dict(tuned.candidates[one.number].settings),
        "scores": _scores(one.scores),
        "sources": {name: _scores(scores) for name, scores in one.by_source.items()},
        "limits": list(one.verdicts),
    }


def _candidate(one: Candidate) -> dict[str, Any]:
    return {
        "number": one.number,
        "settings": dict(one.settings),
        "scores": _scores(one.scores),
        "admitted": one.is_admitted,
        "failure": one.failure,
    }


def _scores(scores: Mapping[str, Estimate]) -> dict[str, dict[str, float]]:
    return {label: estimate._asdict() for label, estimate in scores.items()}
