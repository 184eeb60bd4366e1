"""Where names stand beside what they name, so that those of near targets can be read."""

from collections.abc import Sequence
from itertools import product

import numpy as np

# As parts of the picture's height, which is 170 pixels at 1280 x 720; larger pages have more room.
_LINE, _LETTER, _AWAY, _MARK = 0.07, 0.036, 0.065, 0.04
_LINE_PX, _AWAY_PX = 12, 11

Box = tuple[float, float, float, float]
"""Right, left, bottom, top."""


def in_middle(places: np.ndarray, names: Sequence[str]) -> list[Box]:
    """What names take that stand in the middle of their places, as for `beside`."""
    halves = [len(name) * _LETTER / 2 for name in names]
    return [
        (x - half, x + half, y - _LINE / 2, y + _LINE / 2)
        for (x, y), half in zip(places.astype(float), halves, strict=True)
    ]


def beside(
    places: np.ndarray, names: Sequence[str], free: Sequence[Box] = ()
) -> dict[str, Sequence[object]]:
    """Columns of texts: how they are aligned, and how many pixels to the right and down they are.

    Each name is on that side of its place that is not the middle's; where that hides another name
    or mark, a line further up or down, or on the other side.

    Parameters
    ----------
    places : ndarray
        (n, 2), to the left and forward, as parts of the picture's height.
    names : sequence of str
        What stands there.
    free : sequence of Box
        Where other words stand already.
    """
    taken: list[Box] = [
        *free,
        *((x - _MARK, x + _MARK, y - _MARK, y + _MARK) for x, y in places.astype(float)),
    ]
    chosen: list[tuple[int, int]] = []
    for (x, y), name in zip(places.astype(float), names, strict=True):
        own = 1 if x > 0 else -1
        ways = product((own, -own), (0, 1, -1))
        boxes = {(side, up): _box(x, y, side, up, len(name)) for side, up in ways}
        best = min(boxes, key=lambda way: sum(_meet(boxes[way], other) for other in taken))
        taken.append(boxes[best])
        chosen.append(best)
    return {
        "align": ["right" if side > 0 else "left" for side, _ in chosen],
        "away": [-side * _AWAY_PX for side, _ in chosen],
        "down": [-up * _LINE_PX for _, up in chosen],
    }


def _box(x: float, y: float, side: int, up: int, n_letters: int) -> Box:
    near, far = x + side * _AWAY, x + side * (_AWAY + n_letters * _LETTER)
    bottom = y + (up - 0.5) * _LINE
    return min(near, far), max(near, far), bottom, bottom + _LINE


def _meet(one: Box, other: Box) -> bool:
    # Lines above one another touch, and are no nearer for it.
    return (
        one[0] < other[1]
        and other[0] < one[1]
        and one[2] < other[3] - 1e-9
        and other[2] < one[3] - 1e-9
    )
