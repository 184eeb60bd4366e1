"""Candidates of a tune: score over the limited score."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import frozen_dataclass
from dechirp.report.figures.common import add_legend, set_decade_ticks
from dechirp.report.figures.style import BLUE, GREEN, INK, MUTED, ORANGE, PALE
from dechirp.report.labels import DisplayScale, axis_label, choose_display_scale, score_label

_MAX_BARS = 80  # intervals of more candidates overlap
_MAX_LOG_LIMIT = 0.1  # probabilities with lower limits have a logarithmic axis


@frozen_dataclass
class _ScoreAxis:
    """Axis of one score."""

    score: str
    scale: DisplayScale
    floor: float | None = None
    """Position of 0 on a logarithmic axis; None for a linear axis."""

    @property
    def label_text(self) -> str:
        return axis_label(score_label(self.score), self.scale.unit)

    def displayed_values_and_intervals(self, candidates: Sequence[Mapping[str, Any]]) -> np.ndarray:
        """Return value, low and high of each candidate in display units, (n, 3)."""
        intervals = _score_values_and_intervals(candidates, self.score) * self.scale.factor
        return intervals if self.floor is None else np.maximum(intervals, self.floor)


def draw_candidate_scores_over_limited_score(axes: Axes, document: Mapping[str, Any]) -> Axes:
    """Draw the optimised score of all candidates over the score of the first limit.

    Small marks are results of the search; large marks are results of the initial and the best
    settings in confirmation trials. Without a limit, x is the number of the candidate.

    Parameters
    ----------
    axes : Axes
        Axes to draw on.
    document : mapping
        Document of a tune, `tune.json`.

    Returns
    -------
    Axes
        The given axes.
    """
    aim = document["objective"]
    limit = aim["limits"][0] if aim["limits"] else None
    labels = [aim["score"], *([] if limit is None else [limit["score"]])]
    rows = [
        candidate for candidate in document["candidates"] if _has_finite_scores(candidate, labels)
    ]
    y_axis = _ScoreAxis(
        score=labels[0],
        scale=choose_display_scale(aim["unit"], _score_values_and_intervals(rows, labels[0])),
    )
    x_axis = None if limit is None else _axis_of_limited_score(limit, rows)
    admitted = np.array([candidate["admitted"] for candidate in rows], dtype=bool)
    x, y = _x_values_and_intervals(x_axis, rows), y_axis.displayed_values_and_intervals(rows)
    for is_chosen, color, label in (
        (~admitted, "#b4bec8", "violates a limit"),
        (admitted, BLUE, "within the limits"),
    ):
        if is_chosen.any():
            bars = len(rows) <= _MAX_BARS
            _draw_candidate_marks(axes, x[is_chosen], y[is_chosen], color, label, bars=bars)
    if limit is not None and x_axis is not None:
        bound = limit["at_most"] if limit["at_most"] is not None else limit["at_least"]
        best_x = bound * x_axis.scale.factor
        axes.axvline(best_x, color=MUTED, linewidth=0.9, linestyle=":", label="limit")
        side = 1 if limit["at_most"] is not None else -1
        way = 1 if aim["direction"] == "maximise" else -1
        front = _pareto_front_indices(side * x[:, 0], way * y[:, 0])
        axes.plot(
            x[front, 0], y[front, 0], color=GREEN, linewidth=1.1, label="Pareto front", zorder=1
        )
    for name, color, marker, label in (
        ("default", INK, "D", "initial settings, confirmation trials"),
        ("best", ORANGE, "o", "best settings, confirmation trials"),
    ):
        candidate = document[name]
        if candidate is not None and _has_finite_scores(candidate, labels):
            best_x = _x_values_and_intervals(x_axis, [candidate])
            _draw_candidate_marks(
                axes,
                best_x,
                y_axis.displayed_values_and_intervals([candidate]),
                color,
                label,
                bars=True,
                marker=marker,
                size=6,
            )
    if x_axis is not None and x_axis.floor is not None:
        axes.set_xscale("log")
        set_decade_ticks(axes.xaxis)
    axes.set_xlabel("Candidate" if x_axis is None else x_axis.label_text)
    axes.set_ylabel(y_axis.label_text)
    add_legend(axes)
    axes.set_label(f"{y_axis.label_text} of all candidates")
    return axes


def _has_finite_scores(candidate: Mapping[str, Any], labels: Sequence[str]) -> bool:
    return all(
        np.isfinite(candidate["scores"].get(label, {}).get("value", np.nan)) for label in labels
    )


def _score_values_and_intervals(candidates: Sequence[Mapping[str, Any]], label: str) -> np.ndarray:
    intervals = [
        [candidate["scores"][label][end] for end in ("value", "low", "high")]
        for candidate in candidates
    ]
    return np.array(intervals, dtype=float).reshape(-1, 3)


def _axis_of_limited_score(
    limit: Mapping[str, Any], candidates: Sequence[Mapping[str, Any]]
) -> _ScoreAxis:
    ends = _score_values_and_intervals(candidates, limit["score"])
    floor = None
    if limit["unit"] is None and 0 < (limit["at_most"] or 1.0) <= _MAX_LOG_LIMIT:
        floor = min([limit["at_most"], *ends[ends[:, 0] > 0, 0]]) / 3
    return _ScoreAxis(
        score=limit["score"], scale=choose_display_scale(limit["unit"], ends), floor=floor
    )


def _x_values_and_intervals(
    x_axis: _ScoreAxis | None, candidates: Sequence[Mapping[str, Any]]
) -> np.ndarray:
    if x_axis is None:
        return np.array([[float(candidate["number"])] * 3 for candidate in candidates]).reshape(
            -1, 3
        )
    return x_axis.displayed_values_and_intervals(candidates)


def _draw_candidate_marks(
    axes: Axes,
    x: np.ndarray,
    y: np.ndarray,
    color: str,
    label: str,
    *,
    bars: bool,
    marker: str = "o",
    size: float = 3.4,
) -> None:
    xerr, yerr = (
        np.nan_to_num(
            np.maximum([intervals[:, 0] - intervals[:, 1], intervals[:, 2] - intervals[:, 0]], 0)
        )
        for intervals in (x, y)
    )
    is_large = size > 5
    axes.errorbar(
        x[:, 0],
        y[:, 0],
        xerr=xerr if bars else None,
        yerr=yerr if bars else None,
        color=color,
        ecolor=color if is_large else PALE,
        marker=marker,
        markersize=size,
        linestyle="",
        elinewidth=1.1 if is_large else 0.6,
        zorder=4 if is_large else 2,
        label=label,
    )


def _pareto_front_indices(cost: np.ndarray, worth: np.ndarray) -> np.ndarray:
    """Return the indices of the Pareto-optimal candidates, in order of cost."""
    order = np.lexsort((-worth, cost))
    best = np.maximum.accumulate(worth[order])
    first = np.r_[True, best[1:] > best[:-1]] if order.size else np.zeros(0, bool)
    return np.asarray(order[first])
