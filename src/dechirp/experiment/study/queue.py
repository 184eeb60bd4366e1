"""Which blocks of trials are next, and which points have enough."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from dechirp.experiment.study.block import Block
from dechirp.experiment.study.ledger import Ledger

if TYPE_CHECKING:
    from dechirp.experiment.study.study import Trials

Enough = Callable[[np.ndarray], bool]


@dataclass
class Point:
    """A point that was begun."""

    number: int
    done: set[int]
    next: int = 0
    given: set[int] = field(default_factory=set)
    # For `enough` alone: the first `counted` blocks are in `sums`, others of them wait.
    counted: int = 0
    sums: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    n_rows: int = 0
    waiting: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def ahead(self) -> int:
        """Blocks given or done of which it is not known that they are needed."""
        return len(self.given) + len(self.waiting)

    def append(self, sums: np.ndarray) -> None:
        """Count the next block; memory doubles, so that this takes the time of its rows."""
        n_rows = self.n_rows + len(sums)
        if n_rows > len(self.sums):
            grown = np.empty((max(n_rows, 2 * len(self.sums)), sums.shape[1]))
            grown[: self.n_rows] = self.sums[: self.n_rows].reshape(-1, sums.shape[1])
            self.sums = grown
        self.sums[self.n_rows : n_rows] = sums
        self.n_rows = n_rows
        self.counted += 1


class Queue:
    """Which block is next, and which points have enough."""

    def __init__(
        self, n_points: int, trials: "Trials", ledger: Ledger, enough: Enough | None
    ) -> None:
        self.n_points, self._trials = n_points, trials
        self._ledger, self._enough = ledger, enough
        self._n_blocks = -(-trials.at_most // trials.block)
        self._ended = ledger.ended()
        self._kept = ledger.done()
        self._starts = np.searchsorted(self._kept[:, 0], np.arange(n_points + 1))
        self._open: dict[int, Point] = {}
        self._again: deque[tuple[int, int]] = deque()
        self._next_point = 0
        n_done = len(self._kept)
        n_last = int(np.count_nonzero(self._kept[:, 1] == self._n_blocks - 1))
        self.trials_done = n_done * trials.block - n_last * (
            trials.block - self._size(self._n_blocks - 1)
        )
        self.n_trials = n_points * trials.at_most - sum(
            trials.at_most - min(n * trials.block, trials.at_most) for n in self._ended.values()
        )
        self.points_done = len(self._ended)
        if enough is None:  # others may have had enough before they were interrupted
            self.points_done += int(np.count_nonzero(np.diff(self._starts) == self._n_blocks))

    def next(self) -> tuple[int, int] | None:
        """Point and number of the next block; none if all are given."""
        while self._again:
            lost = self._again.popleft()
            if self.is_wanted(lost):
                return lost
        for point in self._open.values():
            is_near = self._enough is None or point.ahead < point.counted + 2
            if is_near and point.next < self._n_blocks:
                return self._give(point)
        while self._next_point < self.n_points:
            opened = self._opened(self._next_point)
            self._next_point += 1
            if opened is not None and opened.next < self._n_blocks:
                return self._give(opened)
        rest = [point for point in self._open.values() if point.next < self._n_blocks]
        return self._give(min(rest, key=lambda point: point.ahead)) if rest else None

    def give_again(self, blocks: Iterable[tuple[int, int]]) -> None:
        """Take back blocks that were lost."""
        self._again.extend(blocks)

    def is_wanted(self, block: tuple[int, int]) -> bool:
        """Whether a block that was given is of a point that has not enough."""
        point = self._open.get(block[0])
        return point is not None and block[1] in point.given

    def add(self, block: Block) -> bool:
        """Count a block that is on disk; whether its point has now been found to have enough."""
        point = self._open[block.point]
        point.given.remove(block.number)
        point.done.add(block.number)
        self.trials_done += len(block.sums)
        if self._enough is not None:
            point.waiting[block.number] = block.sums
        return self._settled(point)

    def _give(self, point: Point) -> tuple[int, int]:
        number = point.next
        point.given.add(number)
        self._skip(point, number + 1)
        return point.number, number

    def _skip(self, point: Point, number: int) -> None:
        while number in point.done:
            number += 1
        point.next = number

    def _opened(self, number: int) -> Point | None:
        """A point with what is kept of it; none if it has enough."""
        if number in self._ended:
            return None
        numbers = self._kept[self._starts[number] : self._starts[number + 1], 1]
        if self._enough is None and len(numbers) == self._n_blocks:
            return None
        point = Point(number, set(numbers.tolist()))
        self._skip(point, 0)
        self._open[number] = point
        if self._enough is not None and len(numbers):
            ends = np.cumsum([self._size(one) for one in numbers])
            sums = self._ledger.sums(number)
            point.waiting = dict(zip(numbers.tolist(), np.split(sums, ends[:-1]), strict=True))
        self._settled(point)
        return self._open.get(number)

    def _settled(self, point: Point) -> bool:
        """End a point that is done; whether it had enough before its last block."""
        while self._enough is not None and point.counted in point.waiting:
            point.append(point.waiting.pop(point.counted))
            if (
                point.counted < self._n_blocks
                and is_asked(point.counted)
                and self._enough(point.sums[: point.n_rows])
            ):
                self._end(point)
                return True
        if len(point.done) == self._n_blocks:
            del self._open[point.number]
            self.points_done += 1
        return False

    def _end(self, point: Point) -> None:
        self._ledger.end(point.number, point.counted)
        past = [self._size(number) for number in point.done if number >= point.counted]
        self.trials_done -= sum(past)
        self.n_trials -= self._trials.at_most - point.counted * self._trials.block
        self.points_done += 1
        del self._open[point.number]

    def _size(self, number: int) -> int:
        return min(self._trials.block, self._trials.at_most - number * self._trials.block)


def is_asked(n_blocks: int) -> bool:
    """Whether a point with so many blocks is asked if it has enough.

    Up to 64 always, then in steps that double as the number does, 1/64 to 1/32 of it: 430 times
    in 20,000 blocks, so that the time it takes grows as the blocks do, not as their square.
    """
    step: int = 1 << max(0, n_blocks.bit_length() - 6)
    return n_blocks % step == 0
