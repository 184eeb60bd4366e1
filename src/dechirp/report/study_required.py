"""Requirements of a study in words: what was required, what was found, how sure that is."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.values import value
from dechirp.core.words import NONE, fixed, number
from dechirp.experiment.study.require import Judged
from dechirp.experiment.study.results import StudyResult
from dechirp.report.amounts import counted
from dechirp.report.settings_words import Scale, scale_of, score_words, told
from dechirp.report.study_settings import in_words, percent


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
    where = in_words(result.study, asked.at)
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
    return in_words(result.study, result.settings[point])


def how_judged(result: StudyResult, judged: Sequence[Judged]) -> str:
    """Say what the words of decisions mean, as far as these need it."""
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
