"""Measured over designed false-alarm rates of every detector with every window."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import frozen_dataclass
from dechirp.report.figures.common import add_legend
from dechirp.report.figures.style import LINE_COLORS, LINE_MARKS, MUTED

_ROOM = 0.7  # part of the row distance used by the detectors
_ROW_IN = 0.42


@frozen_dataclass
class DetectorRates:
    """Checks of one detector."""

    name: str
    checks: Sequence[Mapping[str, Any]]
    """Checks with the same names for all detectors."""


def figure_height_in(detectors: Sequence[DetectorRates]) -> float:
    """Return the figure height (in) that all rows need."""
    return 1.2 + _ROW_IN * len(detectors[0].checks)


def draw_false_alarm_ratios(axes: Axes, detectors: Sequence[DetectorRates]) -> Axes:
    """Draw the ratios with intervals, a row per kind of map, and the requirement.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    detectors : sequence of DetectorRates
        Checks of each detector; each check is a row.

    Returns
    -------
    Axes
        The given axes.
    """
    rows = np.arange(len(detectors[0].checks))
    step = _ROOM / max(len(detectors) - 1, 1)
    for index, detector in enumerate(detectors):
        measured, low, high = (
            np.array([np.nan if value is None else value for value in column], float)
            for column in zip(
                *((c["measured"], *(c["interval"] or (None, None))) for c in detector.checks),
                strict=True,
            )
        )
        axes.errorbar(
            measured,
            rows + index * step - _ROOM / 2,
            xerr=[measured - low, high - measured],
            fmt=LINE_MARKS[index % len(LINE_MARKS)],
            color=LINE_COLORS[index % len(LINE_COLORS)],
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
    axes.set_xlabel("Measured over designed false-alarm rate")
    axes.set_ylabel("Window")
    axes.set_label("False alarms of each detector over those of the design")
    add_legend(axes)
    return axes
