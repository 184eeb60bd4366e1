"""Queue of trial blocks, and the decision when a point has enough of them."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from dechirp.experiments.study.block import Block
from dechirp.experiments.study.ledger import Ledger

if TYPE_CHECKING:
    from dechirp.experiments.study.study import TrialBudget

StopCriterion = Callable[[np.ndarray], bool]


@dataclass
class OpenPoint:
    """Progress of a point that has been started."""

    number: int
    finished: set[int]
    next_block: int = 0
    issued: set[int] = field(default_factory=set)
    # Only with a stop criterion: `sums` holds the first `n_counted` blocks, `waiting` later ones.
    n_counted: int = 0
    sums: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    n_rows: int = 0
    waiting: dict[int, np.ndarray] = field(default_factory=dict)

    @property
    def n_uncounted_blocks(self) -> int:
        """Number of blocks issued or finished beyond those that are known to be needed."""
        return len(self.issued) + len(self.waiting)

    def append_block_sums(self, block_sums: np.ndarray) -> None:
        """Append the sums of the next block; the buffer doubles, so the cost is amortised."""
        n_rows = self.n_rows + len(block_sums)
        if n_rows > len(self.sums):
            grown = np.empty((max(n_rows, 2 * len(self.sums)), block_sums.shape[1]))
            grown[: self.n_rows] = self.sums[: self.n_rows].reshape(-1, block_sums.shape[1])
            self.sums = grown
        self.sums[self.n_rows : n_rows] = block_sums
        self.n_rows = n_rows
        self.n_counted += 1


class BlockQueue:
    """Issue trial blocks in order, and end points that have enough trials."""

    def __init__(
        self, n_points: int, trials: "TrialBudget", ledger: Ledger, has_enough: StopCriterion | None
    ) -> None:
        self.n_points, self._trials = n_points, trials
        self._ledger, self._has_enough = ledger, has_enough
        self._n_blocks = -(-trials.at_most // trials.block)
        self._ended_points = ledger.n_blocks_of_points_ended_early()
        self._saved_blocks = ledger.saved_point_and_block_numbers()
        self._first_rows = np.searchsorted(self._saved_blocks[:, 0], np.arange(n_points + 1))
        self._open_points: dict[int, OpenPoint] = {}
        self._lost_blocks: deque[tuple[int, int]] = deque()
        self._next_point = 0
        n_done = len(self._saved_blocks)
        n_last = int(np.count_nonzero(self._saved_blocks[:, 1] == self._n_blocks - 1))
        self.n_trials_done = n_done * trials.block - n_last * (
            trials.block - self._n_trials_in_block(self._n_blocks - 1)
        )
        self.n_trials = n_points * trials.at_most - sum(
            trials.at_most - min(n * trials.block, trials.at_most)
            for n in self._ended_points.values()
        )
        self.n_points_done = len(self._ended_points)
        if has_enough is None:  # otherwise points may have had enough before an interruption
            self.n_points_done += int(np.count_nonzero(np.diff(self._first_rows) == self._n_blocks))

    def issue_next_block(self) -> tuple[int, int] | None:
        """Return point and number of the next block, or None if all have been issued."""
        while self._lost_blocks:
            block = self._lost_blocks.popleft()
            if self.is_block_needed(block):
                return block
        for point in self._open_points.values():
            is_near = self._has_enough is None or point.n_uncounted_blocks < point.n_counted + 2
            if is_near and point.next_block < self._n_blocks:
                return self._issue_next_block_of_point(point)
        while self._next_point < self.n_points:
            started = self._open_point_from_ledger(self._next_point)
            self._next_point += 1
            if started is not None and started.next_block < self._n_blocks:
                return self._issue_next_block_of_point(started)
        rest = [point for point in self._open_points.values() if point.next_block < self._n_blocks]
        return (
            self._issue_next_block_of_point(min(rest, key=lambda point: point.n_uncounted_blocks))
            if rest
            else None
        )

    def requeue_lost_blocks(self, point_and_block_numbers: Iterable[tuple[int, int]]) -> None:
        """Put lost blocks back into the queue."""
        self._lost_blocks.extend(point_and_block_numbers)

    def is_block_needed(self, point_and_block_number: tuple[int, int]) -> bool:
        """Return whether an issued block belongs to a point that still needs trials."""
        point = self._open_points.get(point_and_block_number[0])
        return point is not None and point_and_block_number[1] in point.issued

    def count_block_and_end_point_if_enough(self, block: Block) -> bool:
        """Count a block that is on disk; return whether its point now has enough trials."""
        point = self._open_points[block.point]
        point.issued.remove(block.number)
        point.finished.add(block.number)
        self.n_trials_done += len(block.sums)
        if self._has_enough is not None:
            point.waiting[block.number] = block.sums
        return self._close_point_if_done(point)

    def _issue_next_block_of_point(self, point: OpenPoint) -> tuple[int, int]:
        number = point.next_block
        point.issued.add(number)
        self._set_next_unfinished_block(point, number + 1)
        return point.number, number

    def _set_next_unfinished_block(self, point: OpenPoint, first_candidate: int) -> None:
        while first_candidate in point.finished:
            first_candidate += 1
        point.next_block = first_candidate

    def _open_point_from_ledger(self, point_number: int) -> OpenPoint | None:
        """Load the saved blocks of a point; return None if it has enough trials."""
        if point_number in self._ended_points:
            return None
        numbers = self._saved_blocks[
            self._first_rows[point_number] : self._first_rows[point_number + 1], 1
        ]
        if self._has_enough is None and len(numbers) == self._n_blocks:
            return None
        point = OpenPoint(point_number, set(numbers.tolist()))
        self._set_next_unfinished_block(point, 0)
        self._open_points[point_number] = point
        if self._has_enough is not None and len(numbers):
            ends = np.cumsum([self._n_trials_in_block(block_number) for block_number in numbers])
            sums = self._ledger.trial_sums_of_point(point_number)
            point.waiting = dict(zip(numbers.tolist(), np.split(sums, ends[:-1]), strict=True))
        self._close_point_if_done(point)
        return self._open_points.get(point_number)

    def _close_point_if_done(self, point: OpenPoint) -> bool:
        """End a point that is complete; return whether it had enough before its last block."""
        while self._has_enough is not None and point.n_counted in point.waiting:
            point.append_block_sums(point.waiting.pop(point.n_counted))
            if (
                point.n_counted < self._n_blocks
                and is_stop_criterion_tested(point.n_counted)
                and self._has_enough(point.sums[: point.n_rows])
            ):
                self._end_point_early(point)
                return True
        if len(point.finished) == self._n_blocks:
            del self._open_points[point.number]
            self.n_points_done += 1
        return False

    def _end_point_early(self, point: OpenPoint) -> None:
        self._ledger.end_point_and_delete_later_blocks(point.number, point.n_counted)
        past = [
            self._n_trials_in_block(number)
            for number in point.finished
            if number >= point.n_counted
        ]
        self.n_trials_done -= sum(past)
        self.n_trials -= self._trials.at_most - point.n_counted * self._trials.block
        self.n_points_done += 1
        del self._open_points[point.number]

    def _n_trials_in_block(self, block_number: int) -> int:
        return min(self._trials.block, self._trials.at_most - block_number * self._trials.block)


def is_stop_criterion_tested(n_finished_blocks: int) -> bool:
    """Return whether a point with this number of blocks is tested for having enough.

    Every number up to 64, then in steps that double with it, 1/64 to 1/32 of it: 430 tests in
    20,000 blocks, so that their cost grows linearly with the number of blocks, not quadratically.
    """
    step: int = 1 << max(0, n_finished_blocks.bit_length() - 6)
    return n_finished_blocks % step == 0
