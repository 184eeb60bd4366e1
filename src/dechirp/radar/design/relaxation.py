"""Relaxation of requirements that cannot all be met: the smallest change that keeps all limits."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from dechirp.core.errors import InvalidSetting
from dechirp.core.findings import Finding
from dechirp.core.values import frozen_dataclass
from dechirp.radar.design.requirements import Requirements


@frozen_dataclass
class BrokenLimit:
    """A limit that requirements break."""

    limit: str
    """Name of the limit; it stays the same when requirements change."""
    demand: str
    """Value that the requirements demand."""
    bound: str
    """Value that the limit allows."""


LimitCheck = Callable[[Requirements], Sequence[BrokenLimit]]
"""Function that returns the limits that requirements break; relaxing never breaks another one."""

# Field: setting name, unit, and the direction in which it relaxes, upwards (1) or downwards (-1).
# Ties are relaxed in this order: an aliased velocity can still be resolved from frame to frame.
RELAXATIONS = {
    "max_velocity_m_per_s": ("max_velocity", "m/s", -1),
    "range_resolution_m": ("range_resolution", "m", 1),
    "max_range_m": ("max_range", "m", -1),
    "velocity_resolution_m_per_s": ("velocity_resolution", "m/s", 1),
}
MAX_RATIO = 1e12  # largest relaxation; a larger one means a wrong unit
TIE_RATIO = 1.02  # ratios closer than this count as equal


def relax_requirements(
    requirements: Requirements, find_broken_limits: LimitCheck
) -> tuple[Requirements, tuple[Finding, ...]]:
    """Return the closest requirements that break no limit, and a finding for each relaxed one.

    The requirement whose relaxation keeps all limits with the smallest ratio is relaxed. If no
    single one suffices, one is relaxed for the first limit, and the search is repeated.

    Raises
    ------
    InvalidSetting
        If the limits are such that no requirements keep them.
    """
    broken_limits = find_broken_limits(requirements)
    if not broken_limits:
        return requirements, ()
    relaxed_values = _find_relaxed_values_alone(requirements, find_broken_limits)
    if relaxed_values:
        return _apply_smallest_relaxation(requirements, relaxed_values, broken_limits)
    first = broken_limits[0]
    relaxed_values = _find_relaxed_values_alone(
        requirements, lambda eased: [b for b in find_broken_limits(eased) if b.limit == first.limit]
    )
    if not relaxed_values:
        raise InvalidSetting(
            "Limits",
            value=first.demand,
            expected=first.bound,
            fix="widen the limits: no radar keeps them",
        )
    relaxed, findings = _apply_smallest_relaxation(requirements, relaxed_values, [first])
    relaxed, more_findings = relax_requirements(relaxed, find_broken_limits)
    return relaxed, findings + more_findings


def _find_relaxed_values_alone(
    requirements: Requirements, find_broken_limits: LimitCheck
) -> dict[str, float]:
    """Return for each requirement the value that, changed alone, breaks no limit."""
    relaxed = {
        name: _find_relaxed_value_alone(requirements, name, find_broken_limits)
        for name in RELAXATIONS
    }
    return {name: number for name, number in relaxed.items() if number is not None}


def _find_relaxed_value_alone(
    requirements: Requirements, name: str, find_broken_limits: LimitCheck
) -> float | None:
    original, direction = getattr(requirements, name), RELAXATIONS[name][2]
    if original is None:
        return None

    def relaxed_value(ratio: float) -> float:
        return _round_to_three_digits(original * ratio**direction, up=direction > 0)

    def breaks_limit(ratio: float) -> bool:
        return bool(
            find_broken_limits(_replace_requirement(requirements, name, relaxed_value(ratio)))
        )

    def is_valid(ratio: float) -> bool:
        try:
            find_broken_limits(_replace_requirement(requirements, name, relaxed_value(ratio)))
        except InvalidSetting:
            return False
        return True

    # Find the largest ratio that still gives a valid radar, to a tenth.
    low, high = 0.0, math.log(MAX_RATIO)
    while high > 0 and not is_valid(math.exp(high)):
        high -= math.log(1.1)
    if high <= 0 or breaks_limit(math.exp(high)):
        return None
    while high - low > 1e-4:  # a tenth of the third digit
        middle = (low + high) / 2
        low, high = (middle, high) if breaks_limit(math.exp(middle)) else (low, middle)
    return relaxed_value(math.exp(high))


def _apply_smallest_relaxation(
    requirements: Requirements,
    relaxed_values: dict[str, float],
    broken_limits: Sequence[BrokenLimit],
) -> tuple[Requirements, tuple[Finding, ...]]:
    ratios = {
        name: max(number / getattr(requirements, name), getattr(requirements, name) / number)
        for name, number in relaxed_values.items()
    }
    name = next(name for name in relaxed_values if ratios[name] <= TIE_RATIO * min(ratios.values()))
    setting, unit, _ = RELAXATIONS[name]
    original, relaxed = (
        f"{number:.4g} {unit}" for number in (getattr(requirements, name), relaxed_values[name])
    )
    fix = ", or ".join(
        _format_requirement_bound(name, number) for name, number in relaxed_values.items()
    )
    findings = tuple(
        Finding(
            level="error",
            setting=f"requirements.{setting}",
            value=f"{original} needs {limit.demand}, and is relaxed to {relaxed}",
            expected=limit.bound,
            fix=f"ask for {fix}",
        )
        for limit in broken_limits
    )
    return _replace_requirement(requirements, name, relaxed_values[name]), findings


def _replace_requirement(requirements: Requirements, name: str, number: float) -> Requirements:
    changed: dict[str, Any] = {name: number}
    return replace(requirements, **changed)


def _format_requirement_bound(name: str, number: float) -> str:
    setting, unit, direction = RELAXATIONS[name]
    return f"a {setting} of {'at least' if direction > 0 else 'at most'} {number:.4g} {unit}"


def _round_to_three_digits(number: float, *, up: bool) -> float:
    digit_step = 10.0 ** (math.floor(math.log10(number)) - 2)
    digits = math.ceil(number / digit_step) if up else math.floor(number / digit_step)
    return float(f"{digits * digit_step:.3g}")
