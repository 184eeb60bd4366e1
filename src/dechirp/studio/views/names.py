"""Label placement that avoids overlaps of close targets."""

from collections.abc import Sequence
from itertools import product

import numpy as np

# Fractions of the figure height, which is 170 pixels at 1280 x 720; larger pages have more space.
_LINE, _LETTER, _AWAY, _MARK = 0.07, 0.036, 0.065, 0.04
_LINE_PX, _AWAY_PX = 12, 11

Box = tuple[float, float, float, float]
"""Right, left, bottom, top."""


def centred_label_boxes(positions: np.ndarray, names: Sequence[str]) -> list[Box]:
    """Return the boxes of centred labels, for `place_labels`."""
    halves = [len(name) * _LETTER / 2 for name in names]
    return [
        (x - half, x + half, y - _LINE / 2, y + _LINE / 2)
        for (x, y), half in zip(positions.astype(float), halves, strict=True)
    ]


def place_labels(
    positions: np.ndarray, names: Sequence[str], occupied_boxes: Sequence[Box] = ()
) -> dict[str, Sequence[object]]:
    """Return alignment and pixel offsets of labels beside their marks.

    Each label is on the outer side of its mark; if it would hide another label or mark, it moves a
    line up or down, or to the other side.

    Parameters
    ----------
    positions : ndarray
        (n, 2), left and forward, as fractions of the figure height.
    names : sequence of str
        Labels of the positions.
    occupied_boxes : sequence of Box
        Boxes of existing labels.
    """
    occupied: list[Box] = [
        *occupied_boxes,
        *((x - _MARK, x + _MARK, y - _MARK, y + _MARK) for x, y in positions.astype(float)),
    ]
    choices: list[tuple[int, int]] = []
    for (x, y), name in zip(positions.astype(float), names, strict=True):
        outward = 1 if x > 0 else -1
        candidates = product((outward, -outward), (0, 1, -1))
        boxes = {(side, up): _label_box(x, y, side, up, len(name)) for side, up in candidates}
        best = min(
            boxes,
            key=lambda candidate: sum(_overlap(boxes[candidate], other) for other in occupied),
        )
        occupied.append(boxes[best])
        choices.append(best)
    return {
        "align": ["right" if side > 0 else "left" for side, _ in choices],
        "away": [-side * _AWAY_PX for side, _ in choices],
        "down": [-up * _LINE_PX for _, up in choices],
    }


def _label_box(x: float, y: float, side: int, up: int, n_letters: int) -> Box:
    near, far = x + side * _AWAY, x + side * (_AWAY + n_letters * _LETTER)
    bottom = y + (up - 0.5) * _LINE
    return min(near, far), max(near, far), bottom, bottom + _LINE


def _overlap(box: Box, other: Box) -> bool:
    # Boxes of consecutive lines touch without overlapping.
    return (
        box[0] < other[1]
        and other[0] < box[1]
        and box[2] < other[3] - 1e-9
        and other[2] < box[3] - 1e-9
    )
