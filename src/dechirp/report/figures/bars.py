"""Bars in table rows, for the link budget and the timing."""

from collections.abc import Mapping, Sequence
from typing import Literal

from dechirp.core.text import format_fixed, format_with_si_prefix
from dechirp.core.values import frozen_dataclass
from dechirp.radar.budget import BudgetLine


@frozen_dataclass
class Bar:
    """Table row with a bar from `left` to `left + width`, in percent of its column."""

    name: str
    text: str
    left: float
    width: float
    kind: Literal["level", "gain", "loss", "time"]
    formula: str = ""


@frozen_dataclass
class Bars:
    """Group of bars with a common scale and a heading."""

    heading: str
    rows: tuple[Bar, ...]


def link_budget_bars(lines: Sequence[BudgetLine]) -> list[Bars]:
    """Lay out the link budget, with a group of bars for each run of levels in one unit.

    A level extends from the left end of its scale; a step starts at the end of the line above.
    """
    groups: list[tuple[str, list[tuple[BudgetLine, float, float]]]] = []
    running_db = 0.0
    for line in lines:
        if line.kind == "level":
            if not groups or groups[-1][0] != line.unit:
                groups.append((line.unit, []))
            start_db, running_db = line.level_db, line.level_db
        else:
            if not groups:
                groups.append((line.unit, []))
            start_db, running_db = running_db, running_db + line.level_db
        groups[-1][1].append((line, start_db, running_db))
    return [_link_budget_bar_group(unit, rows) for unit, rows in groups]


def timing_bars(timing_s: Mapping[str, float]) -> Bars:
    """Lay out the computing time of each step."""
    longest = max(timing_s.values(), default=0.0) or 1.0
    rows = tuple(
        Bar(
            name=name,
            text=format_with_si_prefix(seconds, "s", 3),
            left=0,
            width=100 * seconds / longest,
            kind="time",
        )
        for name, seconds in timing_s.items()
    )
    return Bars(heading="", rows=rows)


def _link_budget_bar_group(
    unit: str, lines_with_start_and_end_db: list[tuple[BudgetLine, float, float]]
) -> Bars:
    levels = [end for _, *both in lines_with_start_and_end_db for end in both]
    lowest = min(levels) if unit == "dBm" else min(*levels, 0.0)
    span = (max(levels) - lowest) or 1.0
    # Absolute levels have no zero, so the lowest level has a bar of 4 %.
    lowest -= 0.04 * span if lowest < 0 else 0.0
    span = max(levels) - lowest or 1.0
    bars = []
    for line, start_db, end_db in lines_with_start_and_end_db:
        level = line.kind == "level"
        left_db = lowest if level else min(start_db, end_db)
        right_db = max(start_db, end_db)
        bars.append(
            Bar(
                name=line.name,
                text=f"{format_fixed(line.level_db, 2, sign=not level)} {line.unit}",
                left=100 * (left_db - lowest) / span,
                width=100 * (right_db - left_db) / span,
                kind="level" if level else "gain" if line.level_db >= 0 else "loss",
                formula=line.formula,
            )
        )
    heading = "Power" if unit == "dBm" else "Signal to noise"
    return Bars(heading=heading, rows=tuple(bars))
