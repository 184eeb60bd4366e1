"""Self-contained HTML report on a tune: best settings, gain and certainty."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dechirp.core.text import EN_DASH, format_number, format_probability
from dechirp.report.figures import tune as figures
from dechirp.report.figures.style import TALL_IN, render_svg
from dechirp.report.labels import (
    choose_display_scale,
    format_with_interval,
    score_label,
    setting_label,
    value_label,
)
from dechirp.report.template import load_template

_MAX_ROWS = 40


def render_tune_page(document: Mapping[str, Any], *, yaml: str) -> str:
    """Return the HTML of the page; equal documents give equal pages.

    Parameters
    ----------
    document : mapping
        Result of `experiments.tune.document`, and `version`.
    yaml : str
        Scenario with the best settings; empty without any.

    Returns
    -------
    str
        Self-contained HTML page.
    """
    changed = document["best"]["settings"] if document["best"] is not None else {}
    return load_template("tuned.html").render(
        d=document,
        headline=format_headline(document),
        lead=_describe_objective_and_trials(document),
        cards=(),
        verdict=describe_improvement_and_limits(document),
        figure=render_svg(
            lambda figure: figures.draw_candidate_scores_over_limited_score(
                figure.subplots(), document
            ),
            height_in=TALL_IN,
        ),
        compared=list(compare_initial_and_best_scores(document)),
        settings=list(changed.items()),
        shares=list(_setting_importance_rows(document)),
        rows=_candidate_table_rows(document)[:_MAX_ROWS],
        columns=[score_label(item) for item in _objective_and_limited_score_names(document)],
        searched=[setting_label(path) for path in document["search"]],
        n_more=max(len(document["candidates"]) - _MAX_ROWS, 0),
        n_failed=sum(item["failure"] is not None for item in document["candidates"]),
        n_admitted=sum(item["admitted"] for item in document["candidates"]),
        score=score_label(document["objective"]["score"]),
        percent=format_number(100 * document["confidence"]),
        yaml=yaml,
    )


def format_headline(document: Mapping[str, Any]) -> str:
    """Describe the result in one line."""
    score = document["objective"]["score"]
    if document["best"] is None:
        return "No settings meet the limits"
    if document["best"]["number"] == 0:
        return "No improvement over the initial settings"
    value_before, value_after = (document[key]["scores"][score] for key in ("default", "best"))
    label = score_label(score)
    unit = document["objective"]["unit"]
    text_before, text_after = (
        _format_score_value(estimate, unit) for estimate in (value_before, value_after)
    )
    return f"{label[:1].upper()}{label[1:]}: {text_before} to {text_after}"


def _describe_objective_and_trials(document: Mapping[str, Any]) -> str:
    n_trials = document["n_trials"]
    return (
        f"Objective: {_format_objective(document)}. {len(document['candidates']) - 1} candidates"
        " with"
        f" {n_trials['search']} trials each, {n_trials['confirmation']} confirmation trials;"
        f" seed {document['seed']}."
    )


def describe_improvement_and_limits(document: Mapping[str, Any]) -> str:
    """Describe the gain of the best settings in confirmation trials."""
    n_tried = len(document["candidates"]) - 1
    if document["best"] is None:
        trials_text = "in confirmation trials" if document["refuted"] else "in the search"
        return f"The initial settings and all {n_tried} candidates violate a limit {trials_text}."
    if document["best"]["number"] == 0:
        sentence = f"None of {n_tried} candidates is better than the initial settings."
    else:
        gain, unit = document["gain"], document["objective"]["unit"]
        value, interval = _format_score_and_interval(gain, unit)
        sentence = (
            f"Improvement {value} ({interval} at {format_number(100 * document['confidence'])} %);"
            f" certainty of an improvement {_format_certainty(gain['certainty'])}."
        )
    for limit, decision in zip(
        document["objective"]["limits"], document["best"]["limits"], strict=True
    ):
        words = f"{score_label(limit['score'])} {limit['text']}"
        sentence += f" Limit {words}: met." if decision == "met" else f" Limit {words}: undecided."
    return sentence


def compare_initial_and_best_scores(
    document: Mapping[str, Any],
) -> Iterator[tuple[str, tuple[str, str], tuple[str, str]]]:
    """Yield each score with the values of the initial and the best settings.

    Each item is the label, then value and interval of both settings in confirmation trials. With
    several sources, their individual scores follow.
    """
    names = list(document["default"]["sources"])
    for name in [None, *(names if len(names) > 1 else [])]:
        for label in _objective_and_limited_score_names(document):
            both = [
                ("", "")
                if settings_result is None
                else _format_score_and_interval(
                    _scores_in_total_or_of_source(settings_result, name)[label],
                    _score_unit(document, label),
                )
                for settings_result in (document["default"], document["best"])
            ]
            words = score_label(label)
            yield words if name is None else f"{name}: {words}", both[0], both[1]


def _scores_in_total_or_of_source(
    candidate: Mapping[str, Any], source: str | None
) -> Mapping[str, Any]:
    scores: Mapping[str, Any] = (
        candidate["scores"] if source is None else candidate["sources"][source]
    )
    return scores


def _candidate_table_rows(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the candidates, those within the limits first, then by score."""
    sign = -1 if document["objective"]["direction"] == "maximise" else 1

    def key(candidate: Mapping[str, Any]) -> tuple[float, ...]:
        values = [
            candidate["scores"].get(label, {}).get("value", math.nan)
            for label in _objective_and_limited_score_names(document)
        ]
        order = [sign * values[0], *(abs(other) for other in values[1:])]
        return (
            not candidate["admitted"],
            *(np.nan_to_num(order, nan=math.inf)),
            candidate["number"],
        )

    best = document["best"]["number"] if document["best"] is not None else None
    return [
        {
            "number": candidate["number"],
            "settings": [
                _format_setting_value(candidate["settings"][path])
                if path in candidate["settings"]
                else ""
                for path in document["search"]
            ],
            "scores": [
                _format_score_and_interval(candidate["scores"][label], _score_unit(document, label))
                if candidate["scores"]
                else ("", "")
                for label in _objective_and_limited_score_names(document)
            ],
            "note": _candidate_note(candidate, best),
        }
        for candidate in sorted(document["candidates"], key=key)
    ]


def _candidate_note(candidate: Mapping[str, Any], best: int | None) -> str:
    notes = ["initial"] if candidate["number"] == 0 else []
    if candidate["number"] == best:
        notes.append("best")
    if candidate["failure"]:
        notes.append(candidate["failure"])
    elif not candidate["admitted"]:
        notes.append("violates a limit")
    return ", ".join(notes)


def _format_setting_value(text: str) -> str:
    """Format a setting value for the table, numbers with four digits."""
    try:
        value = float(text)
    except ValueError:
        return value_label(text)
    return format_probability(value) if 0 < value < 1e-3 else format_number(value)


def _setting_importance_rows(document: Mapping[str, Any]) -> Iterator[tuple[str, str, float]]:
    for path, share in document["importances"].items():
        yield path, f"{format_number(100 * share, 2)} %", 100 * share


def _format_objective(document: Mapping[str, Any]) -> str:
    objective = document["objective"]
    words = f"{objective['direction']} {score_label(objective['score'])}"
    limits = " and ".join(
        f"{score_label(limit['score'])} {limit['text']}" for limit in objective["limits"]
    )
    return f"{words} with {limits}" if limits else words


def _objective_and_limited_score_names(document: Mapping[str, Any]) -> list[str]:
    objective = document["objective"]
    return list(
        dict.fromkeys([objective["score"], *(limit["score"] for limit in objective["limits"])])
    )


def _score_unit(document: Mapping[str, Any], score_name: str) -> str | None:
    objective = document["objective"]
    units = {limit["score"]: limit["unit"] for limit in objective["limits"]}
    return {**units, objective["score"]: objective["unit"]}[score_name]


def _format_score_value(estimate: Mapping[str, float], unit: str | None) -> str:
    return _format_score_and_interval(estimate, unit)[0]


def _format_score_and_interval(estimate: Mapping[str, float], unit: str | None) -> tuple[str, str]:
    """Format value and interval of a score or of a difference, with the unit."""
    ends = np.array([estimate[end] for end in ("value", "low", "high")])
    if unit is None and not ends[0]:
        return "0", format_with_interval(*(float(end) for end in ends))[1]
    scale = choose_display_scale(unit, ends)
    value, interval = format_with_interval(*(float(end) for end in ends * scale.factor))
    tail = "" if not scale.unit else scale.unit if scale.unit == "°" else f" {scale.unit}"
    return value + tail, interval + tail


def _format_certainty(certainty: float) -> str:
    if math.isnan(certainty):
        return EN_DASH
    if certainty > 1 - 1e-6:
        return "more than 99.9999 %"
    # All leading nines, and one more digit.
    decimals = max(-math.floor(math.log10(max(1 - certainty, 1e-9))) - 2, 0)
    cut = math.floor(certainty * 10 ** (decimals + 2)) / 10**decimals
    return f"{cut:.{decimals}f} %"
