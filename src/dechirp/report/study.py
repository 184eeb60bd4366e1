"""One self-contained page about a study: what was required, what was found, and of what."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.core.words import number, quantity
from dechirp.experiment.study.require import Judged
from dechirp.experiment.study.results import StudyResult
from dechirp.experiment.study.study import Study
from dechirp.report.amounts import counted
from dechirp.report.dates import dated
from dechirp.report.settings_words import score_words
from dechirp.report.study_plates import plates
from dechirp.report.study_required import how_judged, place, required
from dechirp.report.study_settings import grid, percent, tried, varied
from dechirp.report.study_table import table
from dechirp.report.template import template, versions

_MOST_MESSAGES = 20
_MOST_FINDINGS = 30


@value
class Made:
    """When a study was made, and from what."""

    date: str
    """ISO 8601, UTC."""
    source: str
    """The study file as it was called."""
    digests: tuple[tuple[str, str], ...] = ()
    """Name and SHA-256 of each file that it was read from."""
    environments: tuple[Mapping[str, str], ...] = ()
    """Libraries and processors that trials ran on."""
    seconds: float = np.nan
    """That trials took, added over workers."""


def render(result: StudyResult, judged: Sequence[Judged], *, yaml: str, made: Made) -> str:
    """Return the HTML of the page; the same arguments always give the same page.

    Parameters
    ----------
    result : StudyResult
        What was found.
    judged : sequence of Judged
        Its requirements, decided.
    yaml : str
        The study as run, shown for others to run again.
    made : Made
        What the page says of where it is from.

    Returns
    -------
    str
        A page that asks for no other file.
    """
    study = result.study
    grouped = _failures(result, made.source)
    said = _findings(result)
    return template("study.html").render(
        study=study,
        headline=headline(result, judged),
        lead=_lead(result),
        cards=_cards(result, made),
        requirements=[required(one, result) for one in judged],
        how_judged=how_judged(result, judged),
        signed=_signed(result, made),
        trials=tried(study),
        varied=varied(study),
        plates=plates(result),
        about_figures=_about(study, "Bands and bars are intervals that hold")
        + " Solid lines, or short strokes, are theory.",
        table=table(result),
        about_table=_about(study, "After each value its interval, which holds")
        + " Values of all targets together add their trials; theory is then the mean,"
        " and none of an RMSE.",
        failures=grouped[:_MOST_MESSAGES],
        n_more_failures=max(len(grouped) - _MOST_MESSAGES, 0),
        findings=said[:_MOST_FINDINGS],
        n_more_findings=max(len(said) - _MOST_FINDINGS, 0),
        replay=replay(made.source, 0, result.settings[0] if result.settings else ()),
        yaml=yaml,
    )


def headline(result: StudyResult, judged: Sequence[Judged]) -> str:
    """Say whether requirements are met, or else how much was tried."""
    if not judged:
        return f"{_several(result.n_points, 'point')}, {_several(_total(result), 'trial')}"
    counts = {
        decision: sum(one.decision == decision for one in judged)
        for decision in ("met", "not met", "undecided")
    }
    if counts["met"] == len(judged):
        return "All requirements met" if len(judged) > 1 else "Requirement met"
    if len(judged) == 1:
        return f"Requirement {judged[0].decision}"
    said = [f"{n} {decision}" for decision, n in counts.items() if n]
    return f"Of {len(judged)} requirements {', '.join(said)}"


def replay(source: str, trial: int, settings: Sequence[tuple[str, str]]) -> str:
    """Command that runs one trial of a point alone."""
    words = ["dechirp", "study", source, "--trial", str(trial)]
    for path, text in settings:
        words += ["--set", f"{path}={text}"]
    return shlex.join(words)


def _signed(result: StudyResult, made: Made) -> list[tuple[str, str]]:
    known = dict(versions())
    rows = [
        ("made", dated(made.date)),
        ("dechirp", known.get("dechirp", "from its folder")),
        ("seed", str(result.study.seed)),
        ("trials", f"{counted(_total(result))}, {counted(int(result.n_failures.sum()))} failed"),
        *((f"SHA-256 of {name}", digest) for name, digest in made.digests),
    ]
    for environment in made.environments:
        rows.append(("ran on", ", ".join(f"{name} {said}" for name, said in environment.items())))
    return rows


def _lead(result: StudyResult) -> str:
    study = result.study
    scores = ", ".join(score_words(label) for label in result.estimates)
    sensor = (
        "Detections are drawn from theory" if study.sensor == "statistical" else "Samples simulated"
    )
    return f"{study.scenario.name}: {scores}. {sensor}, seed {study.seed}."


def _cards(result: StudyResult, made: Made) -> Sequence[Mapping[str, str]]:
    n_trials, n_failed = _total(result), int(result.n_failures.sum())
    most, least = int(result.trials.max(initial=0)), int(result.trials.min(initial=2**62))
    each = counted(most) if most == least else f"{counted(least)} to {counted(most)}"
    cards = [
        {
            "name": "points",
            "number": counted(result.n_points),
            "unit": "",
            "small_print": grid(result.study),
        },
        {
            "name": "trials",
            "number": counted(n_trials),
            "unit": "",
            "small_print": f"{each} at each point" if result.n_points > 1 else "",
        },
        {
            "name": "failed",
            "number": counted(n_failed),
            "unit": "",
            "small_print": "left out of all scores" if n_failed else "",
        },
    ]
    if np.isfinite(made.seconds) and n_trials:
        amount, _, unit = quantity(made.seconds / n_trials, "s", 3).partition(" ")
        cards.append(
            {
                "name": "a trial took",
                "number": amount,
                "unit": unit,
                "small_print": f"{quantity(made.seconds, 's', 3)} in all, added over workers"
                if made.seconds < 1000
                else f"{number(made.seconds / 3600, 3)} hours in all, added over workers",
            }
        )
    return cards


def _about(study: Study, what: str) -> str:
    return f"{what} the true value with a confidence of {percent(study.confidence)}."


def _failures(result: StudyResult, source: str) -> Sequence[Mapping[str, str]]:
    """Failures by message, the most frequent first, each with how to see it again."""
    by_message: dict[str, list[tuple[int, int]]] = {}
    for point, failure in result.failures:
        by_message.setdefault(failure.message, []).append((point, failure.trial))
    ordered = sorted(by_message.items(), key=lambda item: -len(item[1]))
    rows = []
    for message, where in ordered:
        point, trial = where[0]
        at = place(result, point)
        rows.append(
            {
                "count": _several(len(where), "trial"),
                "message": message,
                "first": f"{'First' if len(where) > 1 else 'It is'} trial {trial}"
                + (f", {at}" if at else ""),
                "replay": replay(source, trial, result.settings[point]),
            }
        )
    return rows


def _findings(result: StudyResult) -> list[Mapping[str, Any]]:
    """Findings, each once, with how many points have it."""
    points: dict[Finding, int] = {}
    for _, finding in result.findings:
        points[finding] = points.get(finding, 0) + 1
    several = result.n_points > 1
    return [
        {
            "finding": finding,
            "where": f", {_several(n, 'point')}" if several else "",
        }
        for finding, n in points.items()
    ]


def _total(result: StudyResult) -> int:
    return int(result.trials.sum())


def _several(n: int, thing: str) -> str:
    return f"{counted(n)} {thing}" if n == 1 else f"{counted(n)} {thing}s"
