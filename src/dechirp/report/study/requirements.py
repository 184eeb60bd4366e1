"""Requirements of a study with measured values, bounds and decisions."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.text import EN_DASH, format_fixed, format_number
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.study.requirements import Verdict
from dechirp.experiments.study.results import StudyResult
from dechirp.report.check_values import format_count
from dechirp.report.labels import (
    DisplayScale,
    choose_display_scale,
    format_with_interval,
    score_label,
)
from dechirp.report.study.settings import format_confidence_percent, format_settings


@frozen_dataclass
class RequirementRow:
    """Row of the table of requirements."""

    required: str
    where: str
    decision: str
    measured: str
    deciding: str
    """Deciding point."""
    bound: str
    bound_note: str
    """Confidence of the bound."""
    trials: str
    more: str
    """Forecast of the additional trials that would decide it."""
    certainty: str


def format_requirement_row(verdict: Verdict, result: StudyResult) -> RequirementRow:
    """Format a requirement and its decision."""
    requirement = verdict.requirement
    unit = result.score_by_label(requirement.score).unit
    scale = choose_display_scale(unit, np.array([verdict.limit, verdict.value]))
    unit_text = f" {scale.unit}" if scale.unit else ""
    sign = "≥" if verdict.side == "at_least" else "≤"
    owner = f" of {requirement.target}" if requirement.target else ""
    measured, bound = _format_value_and_bound(verdict, scale)
    where = format_settings(result.study, requirement.points)
    several = len(verdict.points) > 1
    confidence = requirement.confidence
    if verdict.decision == "not met":
        confidence = 1 - (1 - confidence) / len(verdict.points)
    bound_is_low = (verdict.side == "at_least") == (verdict.decision != "not met")
    limit = format_number(verdict.limit * scale.factor)
    return RequirementRow(
        required=f"{score_label(requirement.score)}{owner} {sign} {limit}{unit_text}",
        where=_format_number_of_points_met(where, verdict) if several else where,
        decision=verdict.decision,
        measured=measured + (unit_text if measured != EN_DASH else ""),
        deciding=format_point(result, verdict.point) if several else "",
        bound=bound + (unit_text if bound != EN_DASH else ""),
        bound_note=f"{'at least' if bound_is_low else 'at most'},"
        f" {format_confidence_percent(confidence)}",
        trials=format_count(verdict.trials),
        more=""
        if verdict.more_trials is None
        else f"about {format_count(verdict.more_trials)} more",
        certainty=format_certainty(verdict),
    )


def format_certainty(verdict: Verdict) -> str:
    """Format the certainty of a decision; for undecided ones, the side that it supports."""
    percentage = format_confidence_percent(verdict.certainty)
    if verdict.decision != "undecided" or percentage == EN_DASH:
        return percentage
    holds = (
        verdict.value >= verdict.limit
        if verdict.side == "at_least"
        else verdict.value <= verdict.limit
    )
    return f"{percentage} {'for' if holds else 'against'}"


def _format_number_of_points_met(where: str, verdict: Verdict) -> str:
    points_met = f"met at {verdict.n_met} of {len(verdict.points)} points"
    return f"{where}, {points_met}" if where else f"at every point, {points_met}"


def format_point(result: StudyResult, point: int) -> str:
    """Describe a point by its varied settings."""
    return format_settings(result.study, result.settings[point])


def explain_decisions(result: StudyResult, judged: Sequence[Verdict]) -> str:
    """Explain the decisions that occur in the table."""
    several = any(len(verdict.points) > 1 for verdict in judged)
    explanation = (
        "Met: the one-sided bound at the stated confidence satisfies the limit. Not met: the"
        " opposite bound violates the limit. Undecided: neither; the requirement is not shown to be"
        " met. Certainty is the highest confidence at which the decision holds; for an undecided"
        " requirement, the highest confidence that the true value lies on the same side of the"
        " limit"
        " as the measured one."
    )
    if several:
        explanation += (
            " With several points, all must meet the limit, each at the stated confidence c; the"
            " table shows the least certain point. A failure at one of n points is decided at a"
            " confidence of 1 \N{MINUS SIGN} (1 \N{MINUS SIGN} c)/n."
        )
    if result.study.trials.until is not None:
        explanation += (
            " Trials stopped when an interval was narrow enough. The bounds assume a number of"
            " trials fixed in advance, so their coverage is slightly lower."
        )
    if any(len(verdict.points) and verdict.more_trials is not None for verdict in judged):
        explanation += (
            " The additional trials that would decide a requirement are a forecast. Adding trials"
            " until a requirement is met makes it pass more often than the confidence states:"
            " choose"
            " their number in advance, and use another seed."
        )
    return explanation


def _format_value_and_bound(verdict: Verdict, scale: DisplayScale) -> tuple[str, str]:
    """Format value and bound with two digits of their difference."""
    if not np.isfinite(verdict.value):
        return EN_DASH, EN_DASH
    measured, bound = verdict.value * scale.factor, verdict.bound * scale.factor
    apart = abs(measured - bound)
    limit_apart = abs(bound - verdict.limit * scale.factor)
    step = min([gap for gap in (apart, limit_apart) if np.isfinite(gap) and gap > 0], default=0.0)
    if step == 0 or not np.isfinite(bound):
        return format_number(measured), format_number(bound)
    decimals = min(max(1 - int(np.floor(np.log10(step))), 0), 12)
    if max(abs(measured), abs(bound)) < 1e-3:
        return format_with_interval(measured, measured, measured)[0], format_with_interval(
            bound, bound, bound
        )[0]
    return format_fixed(measured, decimals), format_fixed(bound, decimals)
