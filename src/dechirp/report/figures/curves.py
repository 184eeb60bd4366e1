"""Measured proportions with intervals, and theoretical curves."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.text import format_fixed
from dechirp.core.values import frozen_dataclass
from dechirp.report.check_values import apply_typography
from dechirp.report.figures.common import add_legend
from dechirp.report.figures.style import BLUE, GREEN, INK, MUTED, ORANGE
from dechirp.report.labels import DETECTION_PROBABILITY_LABEL
from dechirp.theory import confidence_intervals

_COLORS = (BLUE, GREEN, ORANGE)
_MARKERS = "osD"


@frozen_dataclass
class SnrGap:
    """SNR interval between two curves at one detection probability, dB."""

    low_db: float
    high_db: float
    probability: float


def draw_detection_curves(
    axes: Axes, curves: Sequence[Mapping[str, Any]], *, confidence: float, gap: SnrGap | None = None
) -> Axes:
    """Draw the measured and theoretical detection probability over the SNR.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    curves : sequence of mapping
        Each with `name`, `x_label`, `x`, `hits`, `trials`, `theory_x` and
        `theory`, as in the certificate.
    confidence : float
        Confidence of the intervals, 0 to 1.
    gap : Gap, optional
        Interval between two curves, drawn with its length.

    Returns
    -------
    Axes
        The given axes.
    """
    _draw_hit_proportions(axes, curves, confidence=confidence)
    axes.set_ylabel(DETECTION_PROBABILITY_LABEL)
    axes.plot([], [], color=INK, linewidth=1.2, label="theory")
    add_legend(axes)
    if gap is not None:
        axes.axhline(gap.probability, color=MUTED, linewidth=0.6, linestyle=":")
        axes.annotate(
            "",
            xy=(gap.high_db, gap.probability),
            xytext=(gap.low_db, gap.probability),
            arrowprops={"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0},
        )
        axes.text(
            (gap.low_db + gap.high_db) / 2,
            gap.probability - 0.02,
            f"{format_fixed(gap.high_db - gap.low_db, 1)} dB",
            ha="center",
            va="top",
        )
    axes.set_label("Detection probability over SNR")
    return axes


def draw_resolution_curves(
    axes: Axes,
    curves: Sequence[Mapping[str, Any]],
    *,
    confidence: float,
    required: float | None = None,
) -> Axes:
    """Draw the proportion of trials with both targets detected over their separation.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    curves, confidence
        See `draw_detection_curves`.
    required : float, optional
        Required proportion, drawn as a line.

    Returns
    -------
    Axes
        The given axes.
    """
    _draw_hit_proportions(axes, curves, confidence=confidence)
    axes.set_ylabel("Proportion of trials with both detected")
    if required is not None:
        axes.axhline(required, color=MUTED, linewidth=0.8, linestyle=":", label="required")
    axes.legend(loc="lower right")
    axes.set_label("Proportion of resolved pairs over their separation")
    return axes


def _draw_hit_proportions(
    axes: Axes, curves: Sequence[Mapping[str, Any]], *, confidence: float
) -> None:
    for curve, color, marker in zip(curves, _COLORS, _MARKERS, strict=False):
        x, hits, trials = (np.asarray(curve[name]) for name in ("x", "hits", "trials"))
        share = hits / trials
        ends = np.array(
            [
                confidence_intervals.binomial_interval(int(k), int(n), confidence=confidence)
                for k, n in zip(hits, trials, strict=True)
            ]
        )
        if len(curve["theory_x"]):
            axes.plot(curve["theory_x"], curve["theory"], color=color, linewidth=1.2)
        else:
            axes.plot(x, share, color=color, linewidth=0.8, alpha=0.5)
        axes.errorbar(
            x,
            share,
            yerr=np.maximum([share - ends[:, 0], ends[:, 1] - share], 0.0),
            color=color,
            marker=marker,
            markersize=3.6,
            linestyle="",
            elinewidth=0.9,
            capsize=1.8,
            label=apply_typography(curve["name"]),
        )
    axes.set(ylim=(-0.02, 1.05))
    axes.set_xlabel(curves[0]["x_label"] if curves else "")
