"""False alarms of every detector under every window, over those of the design."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.report.figures.parts import legend
from dechirp.report.figures.style import LINE_COLORS, LINE_MARKS, MUTED

_ROOM = 0.7  # of the distance between two rows, for the detectors of one
_ROW_IN = 0.42


@value
class Rates:
    """Figures of one detector, a row each."""

    name: str
    checks: Sequence[Mapping[str, Any]]
    """Alike in number and names for all detectors."""


def height_in(detectors: Sequence[Rates]) -> float:
    """Height that all rows need."""
    return 1.2 + _ROW_IN * len(detectors[0].checks)


def over_design(axes: Axes, detectors: Sequence[Rates]) -> Axes:
    """Draw the rates with their intervals, a row for each kind of map, and what is required.

    Parameters
    ----------
    axes : Axes
        To draw on.
    detectors : sequence of Rates
        A row of each for every check.

    Returns
    -------
    Axes
        Those given.
    """
    rows = np.arange(len(detectors[0].checks))
    step = _ROOM / max(len(detectors) - 1, 1)
    for place, detector in enumerate(detectors):
        measured, low, high = (
            np.array([np.nan if one is None else one for one in column], float)
            for column in zip(
                *((c["measured"], *(c["interval"] or (None, None))) for c in detector.checks),
                strict=True,
            )
        )
        axes.errorbar(
            measured,
            rows + place * step - _ROOM / 2,
            xerr=[measured - low, high - measured],
            fmt=LINE_MARKS[place % len(LINE_MARKS)],
            color=LINE_COLORS[place % len(LINE_COLORS)],
            markersize=3.2,
            elinewidth=1.0,
            label=detector.name,
        )
    for end in (detectors[0].checks[0]["required"] or {}).values():
        axes.axvline(end, color=MUTED, linewidth=0.9, linestyle="--")
    axes.axvline(1.0, color=MUTED, linewidth=0.6)
    axes.set_yticks(rows, [str(check["name"]) for check in detectors[0].checks])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("false alarms, share of those of the design")
    axes.set_ylabel("window")
    axes.set_label("False alarms of each detector over those of the design")
    legend(axes)
    return axes
