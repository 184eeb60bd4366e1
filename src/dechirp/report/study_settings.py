"""Settings of a study in words: what varies, and how often each point is tried."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.words import NONE, TIMES, number
from dechirp.experiment.study.results import shown
from dechirp.experiment.study.study import Drawn, Listed, Study
from dechirp.report.amounts import counted
from dechirp.report.settings_words import score_words, setting_words, value_words


def in_words(study: Study, settings: Sequence[tuple[str, str]]) -> str:
    """Say what settings are set to."""
    return ", ".join(
        f"{setting_words(path)} {value_words(shown(study, path, text))}" for path, text in settings
    )


def grid(study: Study) -> str:
    """Say how many values of how many settings there are."""
    sizes = [str(len(one.texts)) for one in study.vary if isinstance(one, Listed)]
    if study.draw is not None:
        sizes.append(f"{study.draw.n} draws")
    return f" {TIMES} ".join(sizes) if len(sizes) > 1 or study.draw is not None else ""


def tried(study: Study) -> list[tuple[str, str]]:
    """Say how often each point is tried, and with which chance."""
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
