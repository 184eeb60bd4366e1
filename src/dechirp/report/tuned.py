"""The page about a search for settings: what is best, by how much, and how sure that is."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dechirp.core.words import number, small
from dechirp.report.figures import tuned as figures
from dechirp.report.figures.style import TALL_IN, svg
from dechirp.report.settings_words import (
    scale_of,
    score_words,
    setting_words,
    told,
    value_words,
)
from dechirp.report.template import template

_MOST_ROWS = 40


def render(found: Mapping[str, Any], *, yaml: str) -> str:
    """Return the HTML of the page; one search always gives one page.

    Parameters
    ----------
    found : mapping
        What `experiment.tune.document` gives, and `version`.
    yaml : str
        The scenario under the best settings; empty where there are none.

    Returns
    -------
    str
        A page that asks for no other file.
    """
    changed = found["best"]["settings"] if found["best"] is not None else {}
    return template("tuned.html").render(
        d=found,
        headline=headline(found),
        lead=_lead(found),
        cards=(),
        verdict=verdict(found),
        figure=svg(lambda figure: figures.traded(figure.subplots(), found), height_in=TALL_IN),
        compared=list(compared(found)),
        settings=list(changed.items()),
        shares=list(_shares(found)),
        rows=_rows(found)[:_MOST_ROWS],
        columns=[score_words(one) for one in _labels(found)],
        searched=[setting_words(path) for path in found["search"]],
        n_more=max(len(found["trials"]) - _MOST_ROWS, 0),
        n_failed=sum(one["failure"] is not None for one in found["trials"]),
        n_admitted=sum(one["admitted"] for one in found["trials"]),
        own=score_words(found["aim"]["score"]),
        percent=number(100 * found["confidence"]),
        yaml=yaml,
    )


def headline(found: Mapping[str, Any]) -> str:
    """What was found, in a line."""
    own = found["aim"]["score"]
    if found["best"] is None:
        return "No settings keep the limits"
    if found["best"]["number"] == 0:
        return "Nothing better than the settings as they are"
    before, after = (found[one]["scores"][own] for one in ("default", "best"))
    words = score_words(own)
    unit = found["aim"]["unit"]
    return f"{words[:1].upper()}{words[1:]} {_value(before, unit)} to {_value(after, unit)}"


def _lead(found: Mapping[str, Any]) -> str:
    looks = found["looks"]
    return (
        f"Searched: {_aim(found)}. {len(found['trials']) - 1} candidates, {looks['search']} trials"
        f" each, {looks['fresh']} fresh ones to confirm; seed {found['seed']}."
    )


def verdict(found: Mapping[str, Any]) -> str:
    """What the fresh trials say of the best settings, in sentences."""
    n_tried = len(found["trials"]) - 1
    if found["best"] is None:
        why = "in fresh trials" if found["refuted"] else "in the search"
        return f"The settings as they are and all of {n_tried} others are beyond a limit {why}."
    if found["best"]["number"] == 0:
        said = f"None of {n_tried} candidates did better than the settings as they are."
    else:
        gain, unit = found["gain"], found["aim"]["unit"]
        value, interval = _told(gain, unit)
        said = (
            f"Better by {value} ({interval} at {number(100 * found['confidence'])} %); that it is"
            f" better at all is {_certain(gain['certainty'])} certain."
        )
    for limit, held in zip(found["aim"]["limits"], found["best"]["limits"], strict=True):
        words = f"{score_words(limit['score'])} {limit['text']}"
        said += (
            f" Shown to keep {words}."
            if held == "met"
            else f" Not told apart from the limit, {words}."
        )
    return said


def compared(found: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, str], tuple[str, str]]]:
    """Score by score, of fresh trials: its name, then value and interval of both settings.

    The settings as they are, then the best. Where there are several sources, of each of them too.
    """
    names = list(found["default"]["sources"])
    for name in [None, *(names if len(names) > 1 else [])]:
        for label in _labels(found):
            both = [
                ("", "") if one is None else _told(_scores(one, name)[label], _unit(found, label))
                for one in (found["default"], found["best"])
            ]
            words = score_words(label)
            yield words if name is None else f"{name}: {words}", both[0], both[1]


def _scores(one: Mapping[str, Any], source: str | None) -> Mapping[str, Any]:
    scores: Mapping[str, Any] = one["scores"] if source is None else one["sources"][source]
    return scores


def _rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Candidates of the search, those within the limits first, the best of them first."""
    sign = -1 if found["aim"]["towards"] == "most" else 1

    def key(one: Mapping[str, Any]) -> tuple[float, ...]:
        known = [one["scores"].get(label, {}).get("value", math.nan) for label in _labels(found)]
        order = [sign * known[0], *(abs(other) for other in known[1:])]
        return (not one["admitted"], *(np.nan_to_num(order, nan=math.inf)), one["number"])

    best = found["best"]["number"] if found["best"] is not None else None
    return [
        {
            "number": one["number"],
            "settings": [
                _short(one["settings"][path]) if path in one["settings"] else ""
                for path in found["search"]
            ],
            "scores": [
                _told(one["scores"][label], _unit(found, label)) if one["scores"] else ("", "")
                for label in _labels(found)
            ],
            "said": _said(one, best),
        }
        for one in sorted(found["trials"], key=key)
    ]


def _said(one: Mapping[str, Any], best: int | None) -> str:
    words = ["as they are"] if one["number"] == 0 else []
    if one["number"] == best:
        words.append("best")
    if one["failure"]:
        words.append(one["failure"])
    elif not one["admitted"]:
        words.append("beyond a limit")
    return ", ".join(words)


def _short(text: str) -> str:
    """A value as a table has room for it: numbers to four digits."""
    try:
        value = float(text)
    except ValueError:
        return value_words(text)
    return small(value) if 0 < value < 1e-3 else number(value)


def _shares(found: Mapping[str, Any]) -> Iterator[tuple[str, str, float]]:
    for path, share in found["importances"].items():
        yield path, f"{number(100 * share, 2)} %", 100 * share


def _aim(found: Mapping[str, Any]) -> str:
    aim = found["aim"]
    words = f"{aim['towards']} {score_words(aim['score'])}"
    limits = " and ".join(f"{score_words(one['score'])} {one['text']}" for one in aim["limits"])
    return f"{words} with {limits}" if limits else words


def _labels(found: Mapping[str, Any]) -> list[str]:
    aim = found["aim"]
    return list(dict.fromkeys([aim["score"], *(limit["score"] for limit in aim["limits"])]))


def _unit(found: Mapping[str, Any], label: str) -> str | None:
    aim = found["aim"]
    units = {limit["score"]: limit["unit"] for limit in aim["limits"]}
    return {**units, aim["score"]: aim["unit"]}[label]


def _value(estimate: Mapping[str, float], unit: str | None) -> str:
    return _told(estimate, unit)[0]


def _told(estimate: Mapping[str, float], unit: str | None) -> tuple[str, str]:
    """Value and interval of a score, or of a difference of two, with its unit."""
    ends = np.array([estimate[end] for end in ("value", "low", "high")])
    if unit is None and not ends[0]:
        return "0", told(*(float(end) for end in ends))[1]
    scale = scale_of(unit, ends)
    value, interval = told(*(float(end) for end in ends * scale.factor))
    tail = "" if not scale.unit else scale.unit if scale.unit == "°" else f" {scale.unit}"
    return value + tail, interval + tail


def _certain(certainty: float) -> str:
    if math.isnan(certainty):
        return "not at all"
    if certainty > 1 - 1e-6:
        return "more than 99.9999 %"
    # As many nines as there are, and a digit more.
    decimals = max(-math.floor(math.log10(max(1 - certainty, 1e-9))) - 2, 0)
    cut = math.floor(certainty * 10 ** (decimals + 2)) / 10**decimals
    return f"{cut:.{decimals}f} %"
