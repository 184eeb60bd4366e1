"""Descriptions of the settings and trials of a study."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.text import EN_DASH, TIMES_SIGN, format_number
from dechirp.experiments.study.results import label_of_swept_value
from dechirp.experiments.study.study import RandomSetting, Study, SweptSetting
from dechirp.report.check_values import format_count
from dechirp.report.labels import score_label, setting_label, value_label


def format_settings(study: Study, settings: Sequence[tuple[str, str]]) -> str:
    """Format settings with their values."""
    return ", ".join(
        f"{setting_label(path)} {value_label(label_of_swept_value(study, path, text))}"
        for path, text in settings
    )


def format_grid_size(study: Study) -> str:
    """Format the size of the grid of swept settings and the number of draws."""
    sizes = [str(len(setting.texts)) for setting in study.vary if isinstance(setting, SweptSetting)]
    if study.draw is not None:
        sizes.append(f"{study.draw.n} draws")
    return f" {TIMES_SIGN} ".join(sizes) if len(sizes) > 1 or study.draw is not None else ""


def format_trial_settings(study: Study) -> list[tuple[str, str]]:
    """Return the number of trials, the confidence and the seed rule."""
    rows = [("trials per point", f"at most {format_count(study.trials.at_most)}")]
    until = study.trials.until
    if until is not None:
        owner = f" of {until.target}" if until.target else ""
        rows.append(
            (
                "stop when",
                f"the interval of {score_label(until.score)}{owner} is"
                f" {format_number(until.width)} wide",
            )
        )
    rows += [
        ("confidence of intervals", format_confidence_percent(study.confidence)),
        ("random numbers of trial t", f"seed ({study.seed}, t), the same at every point"),
        ("frames per trial", format_count(study.scenario.n_frames)),
    ]
    return rows


def format_varied_settings(study: Study) -> list[tuple[str, str]]:
    """Return each varied setting with its values or its distribution."""
    rows = []
    for setting in study.vary:
        label = setting_label(setting.path)
        if isinstance(setting, SweptSetting):
            labels = [value_label(label) for label in setting.labels]
            values_text = ", ".join(labels)
            if len(labels) > 8:
                values_text = f"{labels[0]} to {labels[-1]}, {len(labels)} values"
            rows.append((label, values_text))
        else:
            rows.append((label, _format_distribution(setting) + _format_sampling(study)))
    return rows


def _format_distribution(setting: RandomSetting) -> str:
    unit = f" {setting.unit}" if setting.unit else ""
    if setting.distribution == "uniform":
        return f"uniform, {format_number(setting.first)} to {format_number(setting.second)}{unit}"
    return f"normal, {format_number(setting.first)} ± {format_number(setting.second)}{unit}"


def _format_sampling(study: Study) -> str:
    if study.draw is None:
        return ", drawn in each trial"
    method = "Sobol points" if study.draw.method == "sobol" else "independent draws"
    return f", {format_count(study.draw.n)} {method}"


def format_confidence_percent(confidence: float) -> str:
    """Format a confidence as 95 % or 99.97 %, rounded down."""
    if not np.isfinite(confidence):
        return EN_DASH
    tail = 100 * (1 - confidence)
    if tail < 1e-4:
        return "over 99.9999\N{NO-BREAK SPACE}%"
    # Rounded down, so that the certainty is not overstated.
    decimals = 0 if tail >= 1 else min(max(1 - int(np.floor(np.log10(max(tail, 1e-9)))), 1), 7)
    down = np.floor(100 * confidence * 10**decimals + 1e-6) / 10**decimals
    text = f"{down:.{decimals}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text) + "\N{NO-BREAK SPACE}%"
