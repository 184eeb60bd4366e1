"""When not all can be had: which requirement has to give, and how far."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import value
from dechirp.radar.requirements import Requirements


@value
class Broken:
    """A limit that requirements break: what they take, and what is allowed."""

    limit: str
    """Its name; the same limit keeps it when requirements change."""
    takes: str
    allowed: str


Breaks = Callable[[Requirements], Sequence[Broken]]
"""Limits that requirements break; an easier requirement never breaks one more."""

# Field: its word, its unit, and whether it becomes easier upwards (1) or downwards (-1). In
# the order in which they give where it makes no difference: a velocity that folds can still
# be told apart from frame to frame.
GIVING = {
    "max_velocity_m_per_s": ("max_velocity", "m/s", -1),
    "range_resolution_m": ("range_resolution", "m", 1),
    "max_range_m": ("max_range", "m", -1),
    "velocity_resolution_m_per_s": ("velocity_resolution", "m/s", 1),
}
MOST = 1e12  # the largest ratio by which a requirement gives; beyond it a unit is wrong
DRAW = 1.02  # ratios that differ by less make no difference


def nearest(asked: Requirements, breaks: Breaks) -> tuple[Requirements, tuple[Finding, ...]]:
    """Closest requirements that break no limit, and a finding for each that had to give.

    The requirement gives that has to give least, as a ratio, to keep all limits. Where none
    can alone, one gives for the first limit, and the rest is seen to after that.

    Raises
    ------
    InvalidSetting
        If the limits are such that no requirements keep them.
    """
    broken = breaks(asked)
    if not broken:
        return asked, ()
    options = _options(asked, breaks)
    if options:
        return _gives(asked, options, broken)
    first = broken[0]
    options = _options(asked, lambda eased: [b for b in breaks(eased) if b.limit == first.limit])
    if not options:
        raise InvalidSetting(
            "Limits", got=first.takes, need=first.allowed, fix="No radar keeps this; widen them."
        )
    met, findings = _gives(asked, options, [first])
    met, more = nearest(met, breaks)
    return met, findings + more


def _options(asked: Requirements, breaks: Breaks) -> dict[str, float]:
    """Value of each requirement that, changed alone, breaks nothing."""
    eased = {name: _eased(asked, name, breaks) for name in GIVING}
    return {name: number for name, number in eased.items() if number is not None}


def _eased(asked: Requirements, name: str, breaks: Breaks) -> float | None:
    before, direction = getattr(asked, name), GIVING[name][2]
    if before is None:
        return None

    def by(ratio: float) -> float:
        return _three_digits(before * ratio**direction, up=direction > 0)

    def too_little(ratio: float) -> bool:
        return bool(breaks(_with(asked, name, by(ratio))))

    def made(ratio: float) -> bool:
        try:
            breaks(_with(asked, name, by(ratio)))
        except InvalidSetting:
            return False
        return True

    # The easiest that is a radar at all, to a tenth: further, its numbers are refused.
    low, high = 0.0, math.log(MOST)
    while high > 0 and not made(math.exp(high)):
        high -= math.log(1.1)
    if high <= 0 or too_little(math.exp(high)):
        return None
    while high - low > 1e-4:  # a tenth of the third digit
        middle = (low + high) / 2
        low, high = (middle, high) if too_little(math.exp(middle)) else (low, middle)
    return by(math.exp(high))


def _gives(
    asked: Requirements, options: dict[str, float], broken: Sequence[Broken]
) -> tuple[Requirements, tuple[Finding, ...]]:
    ratios = {
        name: max(number / getattr(asked, name), getattr(asked, name) / number)
        for name, number in options.items()
    }
    gives = next(name for name in options if ratios[name] <= DRAW * min(ratios.values()))
    word, unit, _ = GIVING[gives]
    before, after = (f"{number:.4g} {unit}" for number in (getattr(asked, gives), options[gives]))
    fix = ", or ".join(_bound(name, number) for name, number in options.items())
    findings = tuple(
        Finding(
            level="error",
            setting=f"requirements.{word}",
            got=f"{after}, since {before} takes {limit.takes}",
            need=f"{before} with {limit.allowed}",
            fix=f"Ask for {fix}.",
        )
        for limit in broken
    )
    return _with(asked, gives, options[gives]), findings


def _with(asked: Requirements, name: str, number: float) -> Requirements:
    changed: dict[str, Any] = {name: number}
    return replace(asked, **changed)


def _bound(name: str, number: float) -> str:
    word, unit, direction = GIVING[name]
    return f"a {word} of {'at least' if direction > 0 else 'at most'} {number:.4g} {unit}"


def _three_digits(number: float, *, up: bool) -> float:
    last = 10.0 ** (math.floor(math.log10(number)) - 2)
    digits = math.ceil(number / last) if up else math.floor(number / last)
    return float(f"{digits * last:.3g}")
