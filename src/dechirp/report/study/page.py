"""Self-contained HTML report on a study."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.text import format_number, format_with_si_prefix
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.study.requirements import Verdict
from dechirp.experiments.study.results import StudyResult
from dechirp.experiments.study.study import Study
from dechirp.report.check_values import format_count
from dechirp.report.labels import score_label
from dechirp.report.study.figures import draw_score_figures
from dechirp.report.study.requirements import (
    explain_decisions,
    format_point,
    format_requirement_row,
)
from dechirp.report.study.settings import (
    format_confidence_percent,
    format_grid_size,
    format_trial_settings,
    format_varied_settings,
)
from dechirp.report.study.table import build_point_table
from dechirp.report.template import format_date_and_time, library_versions, load_template

_MAX_MESSAGES = 20
_MAX_FINDINGS = 30


@frozen_dataclass
class StudyOrigin:
    """Date, files and environments of a study."""

    date: str
    """Date in ISO 8601, UTC."""
    source: str
    """Study file as given on the command line."""
    digests: tuple[tuple[str, str], ...] = ()
    """Name and SHA-256 of each input file."""
    environments: tuple[Mapping[str, str], ...] = ()
    """Libraries and processors of the workers."""
    seconds: float = np.nan
    """Computing time of the trials, summed over workers."""


def render_study_page(
    result: StudyResult,
    judged: Sequence[Verdict],
    *,
    yaml: str,
    origin: StudyOrigin,
    points_file: str = "points.parquet",
) -> str:
    """Return the HTML of the page; equal arguments give equal pages.

    Parameters
    ----------
    result : StudyResult
        Result of the study.
    judged : sequence of Verdict
        Verdicts on its requirements.
    yaml : str
        Study of the run, for reproduction.
    origin : StudyOrigin
        Provenance to show.
    points_file : str
        Name of the file with all points.

    Returns
    -------
    str
        Self-contained HTML page.
    """
    study = result.study
    grouped = _failure_rows_by_message(result, origin.source)
    rows = _finding_rows_with_point_counts(result)
    return load_template("study/study.html").render(
        study=study,
        points_file=points_file,
        headline=format_headline(result, judged),
        lead=_describe_scores_and_sensor(result),
        cards=_build_point_and_trial_cards(result, origin),
        requirements=[format_requirement_row(verdict, result) for verdict in judged],
        how_judged=explain_decisions(result, judged),
        provenance=_provenance_rows(result, origin),
        trials=format_trial_settings(study),
        varied=format_varied_settings(study),
        score_figures=draw_score_figures(result),
        about_figures=_confidence_note(study, "Bands and bars are intervals that contain")
        + " Solid lines and short strokes are theory.",
        table=build_point_table(result),
        about_table=_confidence_note(
            study, "Each value is followed by its interval, which contains"
        )
        + " Values for all targets combine their trials; theory is then the mean of the targets,"
        " except for an RMSE, which has none.",
        failures=grouped[:_MAX_MESSAGES],
        n_more_failures=max(len(grouped) - _MAX_MESSAGES, 0),
        findings=rows[:_MAX_FINDINGS],
        n_more_findings=max(len(rows) - _MAX_FINDINGS, 0),
        replay=replay_command(origin.source, 0, result.settings[0] if result.settings else ()),
        yaml=yaml,
    )


def format_headline(result: StudyResult, judged: Sequence[Verdict]) -> str:
    """Describe the verdict on the requirements, or the size of the study without any."""
    if not judged:
        points = _format_count_with_noun(result.n_points, "point")
        return f"{points}, {_format_count_with_noun(_count_trials(result), 'trial')}"
    counts = {
        decision: sum(verdict.decision == decision for verdict in judged)
        for decision in ("met", "not met", "undecided")
    }
    if counts["met"] == len(judged):
        return "All requirements met" if len(judged) > 1 else "Requirement met"
    if len(judged) == 1:
        return f"Requirement {judged[0].decision}"
    rows = [f"{n} {decision}" for decision, n in counts.items() if n]
    return f"Of {len(judged)} requirements {', '.join(rows)}"


def replay_command(source: str, trial: int, settings: Sequence[tuple[str, str]]) -> str:
    """Return the command that runs a single trial of a point."""
    words = ["dechirp", "study", source, "--trial", str(trial)]
    for path, text in settings:
        words += ["--set", f"{path}={text}"]
    return shlex.join(words)


def _provenance_rows(result: StudyResult, origin: StudyOrigin) -> list[tuple[str, str]]:
    versions_by_name = dict(library_versions())
    rows = [
        ("created", format_date_and_time(origin.date)),
        ("dechirp", versions_by_name.get("dechirp", "not installed, run from a folder")),
        ("seed", str(result.study.seed)),
        (
            "trials",
            f"{format_count(_count_trials(result))},"
            f" {format_count(int(result.n_failed_trials_per_point.sum()))}"
            " failed",
        ),
        *((f"SHA-256 of {name}", digest) for name, digest in origin.digests),
    ]
    for environment in origin.environments:
        rows.append(
            ("ran on", ", ".join(f"{name} {version}" for name, version in environment.items()))
        )
    return rows


def _describe_scores_and_sensor(result: StudyResult) -> str:
    study = result.study
    scores = ", ".join(score_label(label) for label in result.estimates)
    sensor = (
        "Detections sampled from theory" if study.sensor == "statistical" else "Samples simulated"
    )
    return f"{study.scenario.name}: {scores}. {sensor}, seed {study.seed}."


def _build_point_and_trial_cards(
    result: StudyResult, origin: StudyOrigin
) -> Sequence[Mapping[str, str]]:
    n_trials, n_failed = _count_trials(result), int(result.n_failed_trials_per_point.sum())
    most, least = int(result.trials.max(initial=0)), int(result.trials.min(initial=2**62))
    trials_per_point = (
        format_count(most) if most == least else f"{format_count(least)} to {format_count(most)}"
    )
    cards = [
        {
            "name": "points",
            "number": format_count(result.n_points),
            "unit": "",
            "small_print": format_grid_size(result.study),
        },
        {
            "name": "trials",
            "number": format_count(n_trials),
            "unit": "",
            "small_print": f"{trials_per_point} per point" if result.n_points > 1 else "",
        },
        {
            "name": "failed",
            "number": format_count(n_failed),
            "unit": "",
            "small_print": "excluded from all scores" if n_failed else "",
        },
    ]
    if np.isfinite(origin.seconds) and n_trials:
        amount, _, unit = format_with_si_prefix(origin.seconds / n_trials, "s", 3).partition(" ")
        cards.append(
            {
                "name": "time per trial",
                "number": amount,
                "unit": unit,
                "small_print": f"{format_with_si_prefix(origin.seconds, 's', 3)} in total, summed"
                " over workers"
                if origin.seconds < 1000
                else f"{format_number(origin.seconds / 3600, 3)} h in total, summed over workers",
            }
        )
    return cards


def _confidence_note(study: Study, sentence_start: str) -> str:
    confidence = format_confidence_percent(study.confidence)
    return f"{sentence_start} the true value with a confidence of {confidence}."


def _failure_rows_by_message(result: StudyResult, source: str) -> Sequence[Mapping[str, str]]:
    """Return failures by message, the most frequent first, with a command to replay each."""
    by_message: dict[str, list[tuple[int, int]]] = {}
    for point, failure in result.failures:
        by_message.setdefault(failure.message, []).append((point, failure.trial))
    ordered = sorted(by_message.items(), key=lambda item: -len(item[1]))
    rows = []
    for message, where in ordered:
        point, trial = where[0]
        point_text = format_point(result, point)
        rows.append(
            {
                "count": _format_count_with_noun(len(where), "trial"),
                "message": message,
                "first": f"{'First' if len(where) > 1 else 'It is'} trial {trial}"
                + (f", {point_text}" if point_text else ""),
                "replay": replay_command(source, trial, result.settings[point]),
            }
        )
    return rows


def _finding_rows_with_point_counts(result: StudyResult) -> list[Mapping[str, Any]]:
    """Return each finding once, with its number of points."""
    points: dict[Finding, int] = {}
    for _, finding in result.findings:
        points[finding] = points.get(finding, 0) + 1
    several = result.n_points > 1
    return [
        {
            "finding": finding,
            "where": f", {_format_count_with_noun(n, 'point')}" if several else "",
        }
        for finding, n in points.items()
    ]


def _count_trials(result: StudyResult) -> int:
    return int(result.trials.sum())


def _format_count_with_noun(n: int, thing: str) -> str:
    return f"{format_count(n)} {thing}" if n == 1 else f"{format_count(n)} {thing}s"
