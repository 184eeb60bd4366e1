"""Measured shares with their intervals, beside the curves of theory."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.core.words import fixed
from dechirp.report.amounts import typographic
from dechirp.report.figures.parts import legend
from dechirp.report.figures.style import BLUE, GREEN, INK, MUTED, ORANGE
from dechirp.theory import intervals

_COLORS = (BLUE, GREEN, ORANGE)
_MARKERS = "osD"


@value
class Gap:
    """Two ratios at which the same share is reached, dB."""

    low_db: float
    high_db: float
    share: float


def detection(
    axes: Axes, curves: Sequence[Mapping[str, Any]], *, confidence: float, gap: Gap | None = None
) -> Axes:
    """Draw the share of frames in which the target was found, over its ratio, with theory.

    Parameters
    ----------
    axes : Axes
        To draw on.
    curves : sequence of mapping
        Each with `name`, `over` (words of the axis), `x`, `hits`, `trials`, `theory_x` and
        `theory`, as the certificate has them.
    confidence : float
        Of the intervals, 0 to 1.
    gap : Gap, optional
        A distance between two curves, drawn with its length.

    Returns
    -------
    Axes
        Those given.
    """
    _shares(axes, curves, confidence=confidence)
    axes.set_ylabel("share of frames with the car found")
    axes.plot([], [], color=INK, linewidth=1.2, label="theory")
    legend(axes)
    if gap is not None:
        axes.axhline(gap.share, color=MUTED, linewidth=0.6, linestyle=":")
        axes.annotate(
            "",
            xy=(gap.high_db, gap.share),
            xytext=(gap.low_db, gap.share),
            arrowprops={"arrowstyle": "<->", "color": INK, "shrinkA": 0, "shrinkB": 0},
        )
        axes.text(
            (gap.low_db + gap.high_db) / 2,
            gap.share - 0.02,
            f"{fixed(gap.high_db - gap.low_db, 1)} dB",
            ha="center",
            va="top",
        )
    axes.set_label("Probability of detection over the ratio")
    return axes


def resolution(
    axes: Axes,
    curves: Sequence[Mapping[str, Any]],
    *,
    confidence: float,
    required: float | None = None,
) -> Axes:
    """Draw the share of trials in which both of two targets were found, over their separation.

    Parameters
    ----------
    axes : Axes
        To draw on.
    curves, confidence
        See `detection`.
    required : float, optional
        A share that is asked for, drawn across.

    Returns
    -------
    Axes
        Those given.
    """
    _shares(axes, curves, confidence=confidence)
    axes.set_ylabel("share of trials with both found")
    if required is not None:
        axes.axhline(required, color=MUTED, linewidth=0.8, linestyle=":", label="required")
    axes.legend(loc="lower right")
    axes.set_label("Share of pairs resolved over their separation")
    return axes


def _shares(axes: Axes, curves: Sequence[Mapping[str, Any]], *, confidence: float) -> None:
    for curve, color, marker in zip(curves, _COLORS, _MARKERS, strict=False):
        x, hits, trials = (np.asarray(curve[name]) for name in ("x", "hits", "trials"))
        share = hits / trials
        ends = np.array(
            [
                intervals.binomial(int(k), int(n), confidence=confidence)
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
            label=typographic(curve["name"]),
        )
    axes.set(ylim=(-0.02, 1.05))
    axes.set_xlabel(curves[0]["over"] if curves else "")
