"""One self-contained page about a study: what was required, what was found, and of what."""

import datetime
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.core.words import NONE, TIMES, fixed, number, quantity
from dechirp.experiment.study.require import Judged
from dechirp.experiment.study.results import StudyResult, shown
from dechirp.experiment.study.study import Drawn, Listed, Study
from dechirp.report.amounts import counted
from dechirp.report.settings_words import (
    Scale,
    scale_of,
    score_words,
    setting_words,
    told,
    value_words,
    with_unit,
)
from dechirp.report.study_plates import plates
from dechirp.report.template import template, versions

_MOST_ROWS = 200
_MOST_MESSAGES = 20
_MOST_FINDINGS = 30
_MOST_SUBJECTS = 6


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
        how_judged=_how_judged(result, judged),
        signed=_signed(result, made),
        trials=_trials(study),
        varied=varied(study),
        plates=plates(result),
        about_figures=_about(study, "Bands and bars are intervals")
        + " Solid lines, or short strokes, are theory.",
        table=table(result),
        about_table=_about(study, "After each value its interval")
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


@value
class Required:
    """A requirement in words, as the columns of a table."""

    required: str
    where: str
    decision: str
    measured: str
    deciding: str
    """Which point that is."""
    bound: str
    at: str
    """Confidence of the bound."""
    trials: str
    more: str
    """How many more would decide it."""
    certainty: str


def required(one: Judged, result: StudyResult) -> Required:
    """Write a requirement and how it was decided."""
    asked = one.requirement
    unit = result.score(asked.score).unit
    scale = scale_of(unit, np.array([one.limit, one.value]))
    tail = f" {scale.unit}" if scale.unit else ""
    sign = "≥" if one.side == "at_least" else "≤"
    owner = f" of {asked.target}" if asked.target else ""
    measured, bound = _pair(one, scale)
    where = _settings(result.study, asked.at)
    several = len(one.points) > 1
    confidence = asked.confidence
    if one.decision == "not met":
        confidence = 1 - (1 - confidence) / len(one.points)
    bound_is_low = (one.side == "at_least") == (one.decision != "not met")
    limit = number(one.limit * scale.factor)
    return Required(
        required=f"{score_words(asked.score)}{owner} {sign} {limit}{tail}",
        where=_at(where, one) if several else where,
        decision=one.decision,
        measured=measured + (tail if measured != NONE else ""),
        deciding=place(result, one.point) if several else "",
        bound=bound + (tail if bound != NONE else ""),
        at=f"{'at least' if bound_is_low else 'at most'}, {percent(confidence)}",
        trials=counted(one.trials),
        more="" if one.more_trials is None else f"about {counted(one.more_trials)} more",
        certainty=certainty(one),
    )


def certainty(one: Judged) -> str:
    """Write how certain a decision is; where there is none, what speaks for which side."""
    said = percent(one.certainty)
    if one.decision != "undecided" or said == NONE:
        return said
    holds = one.value >= one.limit if one.side == "at_least" else one.value <= one.limit
    return f"{said} {'for' if holds else 'against'} it"


def _at(where: str, one: Judged) -> str:
    shown_at = f"shown at {one.n_met} of {len(one.points)} points"
    return f"{where}, {shown_at}" if where else f"at every point, {shown_at}"


def place(result: StudyResult, point: int) -> str:
    """Say which point that is, by the settings that vary."""
    return _settings(result.study, result.settings[point])


def percent(share: float) -> str:
    """Write a confidence: 95 %, 99.97 %, no more nines than it has."""
    if not np.isfinite(share):
        return NONE
    tail = 100 * (1 - share)
    if tail < 1e-4:
        return "over 99.9999\N{NO-BREAK SPACE}%"
    # Down, so that nothing is more certain than it is.
    decimals = 0 if tail >= 1 else min(max(1 - int(np.floor(np.log10(max(tail, 1e-9)))), 1), 7)
    down = np.floor(100 * share * 10**decimals + 1e-6) / 10**decimals
    text = f"{down:.{decimals}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text) + "\N{NO-BREAK SPACE}%"


@value
class Column:
    """One column of the table of points."""

    words: str
    kind: Literal["label", "count", "num", "interval", "theory"] = "num"


@value
class Table:
    """Points with their scores, in texts."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    n_more: int = 0


def table(result: StudyResult, *, most_rows: int = _MOST_ROWS) -> Table:
    """List points: settings, trials, and each score with its interval and theory.

    Of scores of several targets each of the first six has columns of its own, instead of all
    together.
    """
    n = min(result.n_points, most_rows)
    columns: list[Column] = []
    cells: list[list[str]] = []
    for at, (path, _) in enumerate(result.settings[0] if result.settings else ()):
        columns.append(Column(words=setting_words(path), kind="label"))
        texts = [result.settings[point][at] for point in range(n)]
        cells.append([value_words(shown(result.study, *one)) for one in texts])
    columns.append(Column(words="trials", kind="count"))
    cells.append([counted(int(trials)) for trials in result.trials[:n]])
    if result.failures:
        columns.append(Column(words="failed", kind="count"))
        cells.append([counted(int(failed)) for failed in result.n_failures[:n]])
    for label, values in result.estimates.items():
        scale = scale_of(result.score(label).unit, values[..., (0, 3)])
        names = result.subjects(label)
        owners = [("", 0)]
        if len(names) > 1:
            owners = [(f" of {name}", 1 + at) for at, name in enumerate(names)][:_MOST_SUBJECTS]
        for owner, at in owners:
            numbers = values[:n, at] * scale.factor
            words = with_unit(score_words(label) + owner, scale.unit)
            both = [told(*(float(one) for one in row[:3])) for row in numbers]
            columns += [Column(words=words), Column(words="", kind="interval")]
            cells += [[one for one, _ in both], [interval for _, interval in both]]
            if np.isfinite(values[:, at, 3]).any():
                columns.append(Column(words="theory", kind="theory"))
                cells.append([_like(row) for row in numbers])
    return Table(
        columns=tuple(columns),
        rows=tuple(zip(*cells, strict=True)),
        n_more=result.n_points - n,
    )


def _like(row: np.ndarray) -> str:
    """Write theory with as many digits as the value that it stands beside."""
    measured, low, high, law = (float(one) for one in row)
    half = (high - low) / 2 if np.isfinite(low) and np.isfinite(high) else np.nan
    return told(law, law - half, law + half)[0] if np.isfinite(measured) else told(law, law, law)[0]


def _pair(one: Judged, scale: Scale) -> tuple[str, str]:
    """Value and bound, to two digits of what is between them."""
    if not np.isfinite(one.value):
        return NONE, NONE
    measured, bound = one.value * scale.factor, one.bound * scale.factor
    apart = abs(measured - bound)
    limit_apart = abs(bound - one.limit * scale.factor)
    step = min([gap for gap in (apart, limit_apart) if np.isfinite(gap) and gap > 0], default=0.0)
    if step == 0 or not np.isfinite(bound):
        return number(measured), number(bound)
    decimals = min(max(1 - int(np.floor(np.log10(step))), 0), 12)
    if max(abs(measured), abs(bound)) < 1e-3:
        return told(measured, measured, measured)[0], told(bound, bound, bound)[0]
    return fixed(measured, decimals), fixed(bound, decimals)


def _how_judged(result: StudyResult, judged: Sequence[Judged]) -> str:
    several = any(len(one.points) > 1 for one in judged)
    words = (
        "Met: the one-sided bound, at the stated confidence, is on the right side of the limit."
        " Not met: the opposite bound is on the wrong side. Undecided: neither; it counts as not"
        " shown. Certainty is the highest confidence at which the decision still holds; of what"
        " is undecided, at which the side is shown on which the value lies."
    )
    if several:
        words += (
            " Of several points all must meet the limit, each at the stated confidence; the least"
            " certain one is told. That one of n fails is shown at a confidence of"
            " 1 \N{MINUS SIGN} (1 \N{MINUS SIGN} c)/n."
        )
    if result.study.trials.until is not None:
        words += (
            " Trials stopped when an interval was narrow enough; bounds are those of a number"
            " that is fixed before, and miss a little more often."
        )
    if any(len(one.points) and one.more_trials is not None for one in judged):
        words += (
            " Trials that would decide it are a forecast. Trials that are added until a"
            " requirement is met make it pass more often than the confidence says: decide"
            " their number first, and take another seed."
        )
    return words


def _signed(result: StudyResult, made: Made) -> list[tuple[str, str]]:
    known = dict(versions())
    rows = [
        ("made", _date(made.date)),
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
            "small_print": _grid(result.study),
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


def _grid(study: Study) -> str:
    sizes = [str(len(one.texts)) for one in study.vary if isinstance(one, Listed)]
    if study.draw is not None:
        sizes.append(f"{study.draw.n} draws")
    return f" {TIMES} ".join(sizes) if len(sizes) > 1 or study.draw is not None else ""


def _trials(study: Study) -> list[tuple[str, str]]:
    rows = [("at each point", f"at most {counted(study.trials.at_most)}")]
    until = study.trials.until
    if until is not None:
        owner = f" of {until.target}" if until.target else ""
        rows.append(
            ("until the interval", f"of {score_words(until.score)}{owner} is {number(until.width)}")
        )
    rows += [
        ("confidence of intervals", percent(study.confidence)),
        ("chance of trial t", f"seed {study.seed}, t: the same at every point"),
        ("frames of a trial", counted(study.scenario.n_frames)),
    ]
    return rows


def varied(study: Study) -> list[tuple[str, str]]:
    """Say of each setting that varies what it is, and its values."""
    rows = []
    for one in study.vary:
        words = setting_words(one.path)
        if isinstance(one, Listed):
            labels = [value_words(label) for label in one.labels]
            said = ", ".join(labels)
            if len(labels) > 8:
                said = f"{labels[0]} to {labels[-1]}, {len(labels)} values"
            rows.append((words, said))
        else:
            rows.append((words, _distribution(one) + _how_drawn(study)))
    return rows


def _distribution(one: Drawn) -> str:
    unit = f" {one.unit}" if one.unit else ""
    if one.distribution == "uniform":
        return f"uniform, {number(one.first)} to {number(one.second)}{unit}"
    return f"normal, {number(one.first)} ± {number(one.second)}{unit}"


def _how_drawn(study: Study) -> str:
    if study.draw is None:
        return ", anew in each trial"
    how = "Sobol points" if study.draw.method == "sobol" else "independent draws"
    return f", {counted(study.draw.n)} {how}"


def _about(study: Study, what: str) -> str:
    return f"{what} that hold the true value with a confidence of {percent(study.confidence)}."


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


def _settings(study: Study, settings: Sequence[tuple[str, str]]) -> str:
    return ", ".join(
        f"{setting_words(path)} {value_words(shown(study, path, text))}" for path, text in settings
    )


def _total(result: StudyResult) -> int:
    return int(result.trials.sum())


def _several(n: int, thing: str) -> str:
    return f"{counted(n)} {thing}" if n == 1 else f"{counted(n)} {thing}s"


def _date(iso: str) -> str:
    at = datetime.datetime.fromisoformat(iso)
    return f"{at.day} {at:%B %Y, %H:%M} UTC"
