"""Blocks of trials given to workers, kept as they come, until every point has enough.

What is kept in the end depends on nothing but the study: not on how many workers there are, not
on which is first, and not on how often it was interrupted.
"""

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, TypeVar

import cloudpickle
import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiment.study.block import Block
from dechirp.experiment.study.environment import versions
from dechirp.experiment.study.executors import Workers
from dechirp.experiment.study.ledger import Ledger
from dechirp.experiment.study.on_worker import worked
from dechirp.experiment.study.queue import Enough, Queue

if TYPE_CHECKING:
    from dechirp.experiment.study.study import Trials

P = TypeVar("P")

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
        `queue.is_asked`), and of no others whatever is done already. The blocks up to the first yes
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
    queue = Queue(n_points, trials, ledger, enough)
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


class _Running:
    """Blocks that are out, and what becomes of them."""

    def __init__(
        self,
        work: Callable[[P, int, int], Block],
        plan: P,
        queue: Queue,
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
                future = self._workers.executor.submit(worked, self._packed, versions(), *block)
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
