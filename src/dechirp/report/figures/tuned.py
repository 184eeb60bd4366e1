"""Candidates of a search: what they reach, over what their limit allows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from dechirp.core.values import value
from dechirp.report.figures.parts import in_decades, legend
from dechirp.report.figures.style import BLUE, GREEN, INK, MUTED, ORANGE, PALE
from dechirp.report.settings_words import Scale, scale_of, score_words, with_unit

_MOST_BARS = 80  # intervals of more candidates hide each other
_RARE = 0.1  # probabilities that are limited to less have a logarithmic axis


@value
class _Axis:
    """One score as an axis."""

    label: str
    scale: Scale
    floor: float | None = None
    """Where 0 is drawn on a logarithmic axis; none: the axis is linear."""

    @property
    def words(self) -> str:
        return with_unit(score_words(self.label), self.scale.unit)

    def ends(self, rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
        """Value, low and high of each, as shown, (n, 3)."""
        made = _ends(rows, self.label) * self.scale.factor
        return made if self.floor is None else np.maximum(made, self.floor)


def traded(axes: Axes, found: Mapping[str, Any]) -> Axes:
    """Draw the aim's score of all candidates over the score of the first limit.

    Small marks are of the search; the settings as they are and the best, larger, of fresh trials.
    Without a limit, over the number of the candidate.

    Parameters
    ----------
    axes : Axes
        To draw on.
    found : mapping
        The document of a search, `tune.json`.

    Returns
    -------
    Axes
        Those given.
    """
    aim = found["aim"]
    limit = aim["limits"][0] if aim["limits"] else None
    labels = [aim["score"], *([] if limit is None else [limit["score"]])]
    rows = [one for one in found["trials"] if _is_known(one, labels)]
    up = _Axis(label=labels[0], scale=scale_of(aim["unit"], _ends(rows, labels[0])))
    along = None if limit is None else _along(limit, rows)
    admitted = np.array([one["admitted"] for one in rows], dtype=bool)
    x, y = _over(along, rows), up.ends(rows)
    for chosen, color, label in (
        (~admitted, "#b4bec8", "beyond a limit"),
        (admitted, BLUE, "not shown to be beyond a limit"),
    ):
        if chosen.any():
            bars = len(rows) <= _MOST_BARS
            _marks(axes, x[chosen], y[chosen], color, label, bars=bars)
    if limit is not None and along is not None:
        bound = limit["at_most"] if limit["at_most"] is not None else limit["at_least"]
        at = bound * along.scale.factor
        axes.axvline(at, color=MUTED, linewidth=0.9, linestyle=":", label="limit")
        side = 1 if limit["at_most"] is not None else -1
        way = 1 if aim["towards"] == "most" else -1
        front = _front(side * x[:, 0], way * y[:, 0])
        axes.plot(x[front, 0], y[front, 0], color=GREEN, linewidth=1.1, label="front", zorder=1)
    for name, color, marker, label in (
        ("default", INK, "D", "as they are, fresh trials"),
        ("best", ORANGE, "o", "best, fresh trials"),
    ):
        one = found[name]
        if one is not None and _is_known(one, labels):
            at = _over(along, [one])
            _marks(axes, at, up.ends([one]), color, label, bars=True, marker=marker, size=6)
    if along is not None and along.floor is not None:
        axes.set_xscale("log")
        in_decades(axes.xaxis)
    axes.set_xlabel("candidate" if along is None else along.words)
    axes.set_ylabel(up.words)
    legend(axes)
    axes.set_label(f"{up.words} of all candidates")
    return axes


def _is_known(one: Mapping[str, Any], labels: Sequence[str]) -> bool:
    return all(np.isfinite(one["scores"].get(label, {}).get("value", np.nan)) for label in labels)


def _ends(rows: Sequence[Mapping[str, Any]], label: str) -> np.ndarray:
    found = [[one["scores"][label][end] for end in ("value", "low", "high")] for one in rows]
    return np.array(found, dtype=float).reshape(-1, 3)


def _along(limit: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> _Axis:
    ends = _ends(rows, limit["score"])
    floor = None
    if limit["unit"] is None and 0 < (limit["at_most"] or 1.0) <= _RARE:
        floor = min([limit["at_most"], *ends[ends[:, 0] > 0, 0]]) / 3
    return _Axis(label=limit["score"], scale=scale_of(limit["unit"], ends), floor=floor)


def _over(along: _Axis | None, rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
    if along is None:
        return np.array([[float(one["number"])] * 3 for one in rows]).reshape(-1, 3)
    return along.ends(rows)


def _marks(
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
        np.nan_to_num(np.maximum([of[:, 0] - of[:, 1], of[:, 2] - of[:, 0]], 0)) for of in (x, y)
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


def _front(cost: np.ndarray, worth: np.ndarray) -> np.ndarray:
    """Those than which none is better in both, in order of cost."""
    order = np.lexsort((-worth, cost))
    best = np.maximum.accumulate(worth[order])
    first = np.r_[True, best[1:] > best[:-1]] if order.size else np.zeros(0, bool)
    return np.asarray(order[first])
