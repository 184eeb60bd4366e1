"""Blocks of trials given to workers, kept as they come, until every point has enough.

What is kept in the end depends on nothing but the study: not on how many workers there are, not
on which is first, and not on how often it was interrupted.
"""

import pickle
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field
from functools import lru_cache
from queue import Empty, SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

import cloudpickle
import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiment.study.block import Block
from dechirp.experiment.study.environment import differences, versions
from dechirp.experiment.study.executors import Workers
from dechirp.experiment.study.ledger import Ledger

if TYPE_CHECKING:
    from dechirp.experiment.study.study import Trials

P = TypeVar("P")
Enough = Callable[[np.ndarray], bool]

WAITING_EACH = 3
"""Blocks that each worker has or waits for: the next is there when one is done."""
FEWEST_WAITING = 4

MOST_RENEWALS = 3
"""How often processes that were killed are started again: what killed them may be a block."""

FEWEST_FOR_SHARE = 100
"""Trials that a share of failures is of, until there are as many: one in ten is no tenth."""

_PATIENCE_S = 1.0
_COUNTED_EVERY_S = 2.0


@dataclass(frozen=True)
class Progress:
    """How far a study is."""

    points_done: int
    n_points: int
    trials_done: int
    """Of points that are not done as well; from earlier calls as well."""
    n_trials: int
    """At most: points may have enough before."""
    trials_per_s: float
    """Of this call; 0 before its first block."""
    seconds_left: float
    """At most; infinite before its first block."""
    n_failures: int


def run_blocks(
    work: Callable[[P, int, int], Block],
    plan: P,
    *,
    n_points: int,
    trials: "Trials",
    ledger: Ledger,
    workers: Workers,
    enough: Enough | None = None,
    stop_after_failures: float = 0.01,
    progress: Callable[[Progress], None] | None = None,
) -> list[Future[Block]]:
    """Do all blocks of a study that its ledger does not have.

    Points are taken in order, and their blocks in order. Where `enough` decides, a point has at
    most two blocks more ahead than are counted of it, so that at most about half of them are
    done for nothing; the next points are begun meanwhile. Where none is left to begin and
    workers would be idle, the point with the fewest ahead gets more.

    Parameters
    ----------
    work : callable
        work(plan, point, number) makes one block, from nothing but these.
    plan : object
        What can be pickled; a worker unpickles it once.
    n_points : int
        Points 0, 1, ... of the study.
    trials : Trials
        How many each has at most, and in a block.
    ledger : Ledger
        Blocks are on disk before they are counted.
    workers : Workers
        See `executors`.
    enough : callable, optional
        Whether a point has enough, of the sums (n_trials, n_columns) of its first blocks. It is
        asked of the first, the first two and so on, in steps that grow to 3 % (see
        `is_asked`), and of no others whatever is done already. The blocks up to the first yes
        are kept, and no more.
    stop_after_failures : float
        Share of trials that may raise, of those done, or of 100 (`FEWEST_FOR_SHARE`) while
        there are fewer: 0.01 stops at the second in the first hundred.
    progress : callable, optional
        Called after each writing, and each second without.

    Returns
    -------
    list of Future
        Blocks past the end of a point that workers are still at; nobody needs them.

    Raises
    ------
    DechirpError
        If too many trials raised, workers died again and again, a scheduler is gone, or the
        disk is full. What was done is kept, and the same call goes on.
    KeyboardInterrupt
        Saying how much is kept.
    """
    queue = _Queue(n_points, trials, ledger, enough)
    running = _Running(work, plan, queue, ledger, workers, stop_after_failures, progress)
    try:
        running.run()
        return [future for future in running.needless if not future.done()]
    except KeyboardInterrupt:
        running.keep_finished()
        raise KeyboardInterrupt(
            f"Interrupted; {queue.trials_done} of {queue.n_trials} trials are kept in"
            f" {ledger.path.parent}. The same call goes on."
        ) from None
    except BaseException:
        running.keep_finished()
        raise
    finally:
        running.cancel()


def is_asked(n_blocks: int) -> bool:
    """Whether a point with so many blocks is asked if it has enough.

    Up to 64 always, then in steps that double as the number does, 1/64 to 1/32 of it: 430 times
    in 20,000 blocks, so that the time it takes grows as the blocks do, not as their square.
    """
    step: int = 1 << max(0, n_blocks.bit_length() - 6)
    return n_blocks % step == 0


@dataclass
class _Point:
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


class _Queue:
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
        self._open: dict[int, _Point] = {}
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

    def _give(self, point: _Point) -> tuple[int, int]:
        number = point.next
        point.given.add(number)
        self._skip(point, number + 1)
        return point.number, number

    def _skip(self, point: _Point, number: int) -> None:
        while number in point.done:
            number += 1
        point.next = number

    def _opened(self, number: int) -> _Point | None:
        """A point with what is kept of it; none if it has enough."""
        if number in self._ended:
            return None
        numbers = self._kept[self._starts[number] : self._starts[number + 1], 1]
        if self._enough is None and len(numbers) == self._n_blocks:
            return None
        point = _Point(number, set(numbers.tolist()))
        self._skip(point, 0)
        self._open[number] = point
        if self._enough is not None and len(numbers):
            ends = np.cumsum([self._size(one) for one in numbers])
            sums = self._ledger.sums(number)
            point.waiting = dict(zip(numbers.tolist(), np.split(sums, ends[:-1]), strict=True))
        self._settled(point)
        return self._open.get(number)

    def _settled(self, point: _Point) -> bool:
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

    def _end(self, point: _Point) -> None:
        self._ledger.end(point.number, point.counted)
        past = [self._size(number) for number in point.done if number >= point.counted]
        self.trials_done -= sum(past)
        self.n_trials -= self._trials.at_most - point.counted * self._trials.block
        self.points_done += 1
        del self._open[point.number]

    def _size(self, number: int) -> int:
        return min(self._trials.block, self._trials.at_most - number * self._trials.block)


class _Running:
    """Blocks that are out, and what becomes of them."""

    def __init__(
        self,
        work: Callable[[P, int, int], Block],
        plan: P,
        queue: _Queue,
        ledger: Ledger,
        workers: Workers,
        stop_after_failures: float,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._packed = cloudpickle.dumps((work, plan))  # works defined in a notebook as well
        self._queue, self._ledger, self._workers = queue, ledger, workers
        self._stop_after, self._progress = stop_after_failures, progress
        self._out: dict[Future[Block], tuple[int, int]] = {}
        self._finished: SimpleQueue[Future[Block]] = SimpleQueue()
        self.needless: list[Future[Block]] = []
        self._n_failures = ledger.n_failures()
        self._n_renewals = 0
        self._started = monotonic()
        self._began_with = queue.trials_done
        self._capacity, self._counted_at = FEWEST_WAITING, -_COUNTED_EVERY_S

    def run(self) -> None:
        """Until nothing is left to do."""
        self._must_not_fail()
        while self._give():
            self._keep(self._taken(_PATIENCE_S))
            self._workers.must_answer()
            self._tell()
        self._tell()

    def keep_finished(self) -> None:
        """Write what is there, before this ends for another reason."""
        good = [
            future.result()
            for future, place in self._out.items()
            if future.done()
            and not future.cancelled()
            and future.exception() is None
            and self._queue.is_wanted(place)
        ]
        try:
            self._ledger.add(good)
        except DechirpError:
            return  # as a full disk, of which the error that ends this tells, or the next call
        self._queue.trials_done += sum(len(block.sums) for block in good)

    def cancel(self) -> None:
        """Let the blocks go that nobody works on yet."""
        out, self._out = self._out, {}
        for future in out:
            future.cancel()

    def _give(self) -> bool:
        """Keep the workers busy; whether any block is out."""
        while len(self._out) < self._most_out():
            block = self._queue.next()
            if block is None:
                break
            try:
                future = self._workers.executor.submit(_worked, self._packed, versions(), *block)
            except self._workers.lost as error:
                self._renew([block], [error])
                continue
            self._out[future] = block
            future.add_done_callback(self._finished.put)
        return bool(self._out)

    def _most_out(self) -> int:
        now = monotonic()
        if now - self._counted_at > _COUNTED_EVERY_S:
            self._capacity = max(FEWEST_WAITING, WAITING_EACH * self._workers.count())
            self._counted_at = now
        return self._capacity

    def _taken(self, patience_s: float) -> list[Future[Block]]:
        """Finished ones; none if there are none within that time."""
        try:
            first = self._finished.get(timeout=patience_s)
        except Empty:
            return []
        return [first, *(self._finished.get() for _ in range(self._finished.qsize()))]

    def _keep(self, finished: list[Future[Block]]) -> None:
        """Write what is good of what has finished, count it, then see to the rest."""
        wanted = [one for one in finished if one in self._out]
        errors = {one: _error_of(one) for one in wanted}
        good = [one.result() for one in wanted if errors[one] is None]
        if good:
            self._ledger.add(good)
        places = {one: self._out.pop(one) for one in wanted}
        self._count(good)
        bad = [(one, error) for one, error in errors.items() if error is not None]
        lost = (*self._workers.lost, CancelledError)
        for _, error in bad:
            if not isinstance(error, lost):
                raise error
        if bad:
            self._renew([places[one] for one, _ in bad], [error for _, error in bad])

    def _count(self, blocks: list[Block]) -> None:
        has_ended = False
        for block in blocks:
            if not self._queue.is_wanted((block.point, block.number)):
                has_ended = True  # by a block before it that came with it
                continue
            self._n_failures += len(block.failures)
            has_ended |= self._queue.add(block)
        if has_ended:
            self._n_failures = self._ledger.n_failures()
            for future, place in list(self._out.items()):
                if not self._queue.is_wanted(place):
                    del self._out[future]
                    if not future.cancel():
                        self.needless.append(future)
        self._must_not_fail()

    def _renew(self, lost: list[tuple[int, int]], errors: list[BaseException]) -> None:
        """Start workers again in place of those that died, and give them what was out."""
        self._workers.count()  # raises if it is the scheduler that is gone
        self._n_renewals += 1
        if self._workers.renew is None or self._n_renewals > MOST_RENEWALS:
            raise _killed(lost, errors)
        self._workers.renew()
        self._queue.give_again([*lost, *self._out.values()])
        self._out.clear()

    def _must_not_fail(self) -> None:
        done, total = self._queue.trials_done, self._queue.n_trials
        among = max(done, min(FEWEST_FOR_SHARE, total))
        if self._n_failures <= self._stop_after * among:
            return
        point, first = self._ledger.failures()[0]
        raise DechirpError(
            Mistake(
                setting="stop_after_failures",
                got=f"{self._stop_after:g}, and {self._n_failures} of {done} trials raised: trial"
                f" {first.trial} of point {point} said {first.message}",
                need="a share that they do not exceed",
                fix=f"Replay that trial alone with --trial {first.trial}. What was done is kept.",
            )
        )

    def _tell(self) -> None:
        if self._progress is None:
            return
        queue = self._queue
        n_now = queue.trials_done - self._began_with
        rate = max(0.0, n_now / (monotonic() - self._started))
        left = queue.n_trials - queue.trials_done
        self._progress(
            Progress(
                points_done=queue.points_done,
                n_points=queue.n_points,
                trials_done=queue.trials_done,
                n_trials=queue.n_trials,
                trials_per_s=rate,
                seconds_left=left / rate if rate else (np.inf if left else 0.0),
                n_failures=self._n_failures,
            )
        )


def _error_of(future: Future[Block]) -> BaseException | None:
    return CancelledError() if future.cancelled() else future.exception()


def _worked(packed: bytes, made_with: dict[str, str], point: int, number: int) -> Block:
    """Make one block, on a worker."""
    _must_be_alike(tuple(made_with.items()))
    work, plan = _unpacked(packed)
    return work(plan, point, number)


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Any:
    """Work and plan, kept: a plan is some hundred times larger than what changes."""
    return pickle.loads(packed)


@lru_cache(maxsize=4)
def _must_be_alike(made_with: tuple[tuple[str, str], ...]) -> None:
    """Refuse to work with other versions: workers may join while a study runs."""
    import platform

    there = dict(made_with)
    names = differences(there, versions())
    if names:
        raise DechirpError(
            Mistake(
                setting=f"worker on {platform.node()}",
                got=", ".join(f"{name} {versions().get(name, 'absent')}" for name in names),
                need=", ".join(f"{name} {there.get(name, 'absent')}" for name in names),
                fix="Install the same versions there, and call again to go on.",
            )
        )


def _killed(lost: list[tuple[int, int]], errors: list[BaseException]) -> DechirpError:
    point, number = lost[0]
    said = next((line for error in errors for line in str(error).splitlines()), "no reason given")
    return DechirpError(
        Mistake(
            setting="workers",
            got=f"killed while they worked, on block {number} of point {point} among others"
            f" ({said})",
            need="alive",
            fix="Often memory was short: take fewer workers, and call again to go on. What was"
            " done is kept.",
        )
    )
