"""Scheduler: distributes trial blocks to workers and saves them until every point has enough.

The saved blocks depend on the study alone: not on the number of workers, not on the order in
which they finish, and not on interruptions.
"""

import pickle
import platform
import traceback
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from functools import lru_cache
from queue import Empty, SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, Any, TypeVar

import cloudpickle
import numpy as np

from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiments.study.block import Block
from dechirp.experiments.study.block_queue import BlockQueue, StopCriterion
from dechirp.experiments.study.environment import keys_with_different_values, library_versions
from dechirp.experiments.study.executors import Workers
from dechirp.experiments.study.ledger import Ledger

if TYPE_CHECKING:
    from dechirp.experiments.study.study import TrialBudget

P = TypeVar("P")

BLOCKS_PER_WORKER = 3
"""Blocks in flight per worker: the next one is at hand when a worker has finished one."""
MIN_BLOCKS_IN_FLIGHT = 4

MAX_RENEWALS = 3
"""Maximum number of restarts of killed workers: a block itself may be what kills them."""

MIN_TRIALS_FOR_SHARE = 100
"""Fewest trials to which a share of failures refers: one in ten is no reliable tenth."""

_WAIT_S = 1.0
_CAPACITY_PERIOD_S = 2.0


@dataclass(frozen=True)
class Progress:
    """Progress of a study."""

    n_points_done: int
    n_points: int
    n_trials_done: int
    """Including unfinished points and earlier calls."""
    n_trials: int
    """Upper bound: points may end earlier."""
    trials_per_s: float
    """Rate of this call; 0 before its first block."""
    seconds_left: float
    """Upper bound; infinite before the first block of this call."""
    n_failures: int


def run_missing_blocks(
    work: Callable[[P, int, int], Block],
    plan: P,
    *,
    n_points: int,
    trials: "TrialBudget",
    ledger: Ledger,
    workers: Workers,
    enough: StopCriterion | None = None,
    stop_after_failures: float = 0.01,
    progress: Callable[[Progress], None] | None = None,
) -> list[Future[Block]]:
    """Run all blocks of a study that its ledger does not contain.

    Points are processed in order, and so are their blocks. With `enough`, a point has at most two
    blocks in flight beyond those already counted, so that at most about half of them turn out to
    be unneeded; meanwhile the next points are started. When no point is left to start and workers
    would be idle, the point with the fewest blocks ahead gets more.

    Parameters
    ----------
    work : callable
        work(plan, point, number) computes one block from these arguments alone.
    plan : object
        Any picklable object; each worker unpickles it once.
    n_points : int
        Number of points of the study.
    trials : TrialBudget
        Maximum number of trials of a point, and trials per block.
    ledger : Ledger
        Blocks are written to disk before they are counted.
    workers : Workers
        See `executors`.
    enough : callable, optional
        Stop criterion: whether the sums (n_trials, n_columns) of the first blocks of a point are
        enough. It is evaluated for the first block, the first two and so on, in steps that grow to
        3 % (see `block_queue.is_stop_criterion_tested`), regardless of what has already finished.
        The blocks up to the first positive answer are kept, and no more.
    stop_after_failures : float
        Largest share of failed trials, of those done, or of 100 (`MIN_TRIALS_FOR_SHARE`) while
        there are fewer: 0.01 stops at the second failure in the first hundred.
    progress : callable, optional
        Called after each write, and once a second otherwise.

    Returns
    -------
    list of Future
        Unneeded blocks past the end of a point that are still running.

    Raises
    ------
    DechirpError
        If too many trials failed, workers died repeatedly, the scheduler is gone, or the disk is
        full. Finished blocks are kept, and the same call continues.
    KeyboardInterrupt
        With the number of trials that are kept.
    """
    queue = BlockQueue(n_points, trials, ledger, enough)
    running = _Scheduler(work, plan, queue, ledger, workers, stop_after_failures, progress)
    try:
        running.run_until_all_blocks_saved()
        return [future for future in running.unneeded if not future.done()]
    except KeyboardInterrupt:
        running.save_finished_blocks()
        raise KeyboardInterrupt(
            f"Interrupted; {queue.n_trials_done} of {queue.n_trials} trials are kept in"
            f" {ledger.path.parent}. The same call goes on."
        ) from None
    except BaseException:
        running.save_finished_blocks()
        raise
    finally:
        running.cancel_unstarted_blocks()


class _Scheduler:
    """State of the blocks in flight."""

    def __init__(
        self,
        work: Callable[[P, int, int], Block],
        plan: P,
        queue: BlockQueue,
        ledger: Ledger,
        workers: Workers,
        stop_after_failures: float,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self._pickled_work = cloudpickle.dumps((work, plan))  # also pickles functions of a notebook
        self._queue, self._ledger, self._workers = queue, ledger, workers
        self._max_failure_share, self._progress = stop_after_failures, progress
        self._in_flight: dict[Future[Block], tuple[int, int]] = {}
        self._finished: SimpleQueue[Future[Block]] = SimpleQueue()
        self.unneeded: list[Future[Block]] = []
        self._n_failures = ledger.count_failed_trials()
        self._n_renewals = 0
        self._start_time_s = monotonic()
        self._n_trials_before = queue.n_trials_done
        self._capacity, self._capacity_time_s = MIN_BLOCKS_IN_FLIGHT, -_CAPACITY_PERIOD_S

    def run_until_all_blocks_saved(self) -> None:
        """Run until all blocks are done."""
        self._check_share_of_failed_trials()
        while self._submit_blocks_to_capacity():
            self._save_finished_and_requeue_lost_blocks(self._wait_for_finished_futures(_WAIT_S))
            self._workers.check_alive()
            self._report_progress()
        self._report_progress()

    def save_finished_blocks(self) -> None:
        """Save blocks that have finished, before the run ends for another reason."""
        blocks = [
            future.result()
            for future, block in self._in_flight.items()
            if future.done()
            and not future.cancelled()
            and future.exception() is None
            and self._queue.is_block_needed(block)
        ]
        try:
            self._ledger.add_blocks(blocks)
        except DechirpError:
            return  # such as a full disk: the pending error or the next call reports it
        self._queue.n_trials_done += sum(len(block.sums) for block in blocks)

    def cancel_unstarted_blocks(self) -> None:
        """Cancel the blocks that no worker has started."""
        out, self._in_flight = self._in_flight, {}
        for future in out:
            future.cancel()

    def _submit_blocks_to_capacity(self) -> bool:
        """Submit blocks until the workers are busy; return whether any block is in flight."""
        while len(self._in_flight) < self._max_blocks_in_flight():
            block = self._queue.issue_next_block()
            if block is None:
                break
            try:
                future = self._workers.executor.submit(
                    run_pickled_block, self._pickled_work, library_versions(), *block
                )
            except self._workers.death_errors as error:
                self._restart_workers_and_requeue_blocks([block], [error])
                continue
            self._in_flight[future] = block
            future.add_done_callback(self._finished.put)
        return bool(self._in_flight)

    def _max_blocks_in_flight(self) -> int:
        now = monotonic()
        if now - self._capacity_time_s > _CAPACITY_PERIOD_S:
            self._capacity = max(MIN_BLOCKS_IN_FLIGHT, BLOCKS_PER_WORKER * self._workers.capacity())
            self._capacity_time_s = now
        return self._capacity

    def _wait_for_finished_futures(self, timeout_s: float) -> list[Future[Block]]:
        """Return the futures that have finished, or an empty list after the timeout."""
        try:
            first = self._finished.get(timeout=timeout_s)
        except Empty:
            return []
        return [first, *(self._finished.get() for _ in range(self._finished.qsize()))]

    def _save_finished_and_requeue_lost_blocks(self, finished: list[Future[Block]]) -> None:
        """Save and count the valid blocks among the finished ones, then handle the failed ones."""
        wanted = [future for future in finished if future in self._in_flight]
        errors = {future: _error_of_finished_future(future) for future in wanted}
        blocks = [future.result() for future in wanted if errors[future] is None]
        if blocks:
            self._ledger.add_blocks(blocks)
        issued = {future: self._in_flight.pop(future) for future in wanted}
        self._count_saved_and_cancel_unneeded_blocks(blocks)
        is_lost = {future for future, error in errors.items() if _is_lost_on_arrival(error)}
        self._queue.requeue_lost_blocks(issued[future] for future in is_lost)
        failed = [
            (future, error)
            for future, error in errors.items()
            if error is not None and future not in is_lost
        ]
        death_errors = (*self._workers.death_errors, CancelledError)
        for _, error in failed:
            if not isinstance(error, death_errors):
                raise error
        if failed:
            self._restart_workers_and_requeue_blocks(
                [issued[future] for future, _ in failed], [error for _, error in failed]
            )

    def _count_saved_and_cancel_unneeded_blocks(self, blocks: list[Block]) -> None:
        has_ended = False
        for block in blocks:
            if not self._queue.is_block_needed((block.point, block.number)):
                has_ended = True  # ended by an earlier block of this batch
                continue
            self._n_failures += len(block.failures)
            has_ended |= self._queue.count_block_and_end_point_if_enough(block)
        if has_ended:
            self._n_failures = self._ledger.count_failed_trials()
            for future, place in list(self._in_flight.items()):
                if not self._queue.is_block_needed(place):
                    del self._in_flight[future]
                    if not future.cancel():
                        self.unneeded.append(future)
        self._check_share_of_failed_trials()

    def _restart_workers_and_requeue_blocks(
        self, lost_blocks: list[tuple[int, int]], errors: list[BaseException]
    ) -> None:
        """Replace dead workers, and queue the blocks in flight again."""
        self._workers.capacity()  # raises if the scheduler is gone
        self._n_renewals += 1
        if self._workers.renew is None or self._n_renewals > MAX_RENEWALS:
            raise _dead_workers_error(lost_blocks, errors)
        self._workers.renew()
        self._queue.requeue_lost_blocks([*lost_blocks, *self._in_flight.values()])
        self._in_flight.clear()

    def _check_share_of_failed_trials(self) -> None:
        n_done, total = self._queue.n_trials_done, self._queue.n_trials
        n_reference = max(n_done, min(MIN_TRIALS_FOR_SHARE, total))
        if self._n_failures <= self._max_failure_share * n_reference:
            return
        point, first = self._ledger.failed_trials_with_points()[0]
        raise DechirpError(
            Mistake(
                setting="stop_after_failures",
                value=f"{self._max_failure_share:g}; {self._n_failures} of {n_done} trials failed:"
                f" trial {first.trial} of point {point}: {first.message}",
                expected="no more failures than this share",
                fix=f"replay that trial alone with --trial {first.trial}; finished trials are kept",
            )
        )

    def _report_progress(self) -> None:
        if self._progress is None:
            return
        queue = self._queue
        n_now = queue.n_trials_done - self._n_trials_before
        rate = max(0.0, n_now / (monotonic() - self._start_time_s))
        n_remaining = queue.n_trials - queue.n_trials_done
        self._progress(
            Progress(
                n_points_done=queue.n_points_done,
                n_points=queue.n_points,
                n_trials_done=queue.n_trials_done,
                n_trials=queue.n_trials,
                trials_per_s=rate,
                seconds_left=n_remaining / rate if rate else (np.inf if n_remaining else 0.0),
                n_failures=self._n_failures,
            )
        )


def _error_of_finished_future(future: Future[Block]) -> BaseException | None:
    return CancelledError() if future.cancelled() else future.exception()


def _is_lost_on_arrival(error: BaseException | None) -> bool:
    """Return whether a worker of Dask was lost as its result arrived: an error of Dask itself."""
    if not isinstance(error, TypeError) or error.__traceback__ is None:
        return False
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    return bool(frame.f_globals["__name__"] == "distributed.cfexecutor")


def _dead_workers_error(
    lost_blocks: list[tuple[int, int]], errors: list[BaseException]
) -> DechirpError:
    point, number = lost_blocks[0]
    reason = next((line for error in errors for line in str(error).splitlines()), "no reason given")
    return DechirpError(
        Mistake(
            setting="workers",
            value=f"killed while they worked, on block {number} of point {point} among others"
            f" ({reason})",
            expected="workers that run until the study has ended",
            fix="take fewer workers, since the usual cause is too little memory, and call again to"
            " continue; finished trials are kept",
        )
    )


def run_pickled_block(
    pickled_work: bytes, submitter_versions: dict[str, str], point: int, block_number: int
) -> Block:
    """Compute one block on a worker."""
    _check_worker_library_versions(tuple(submitter_versions.items()))
    work, plan = _unpickle_work(pickled_work)
    return work(plan, point, block_number)


@lru_cache(maxsize=4)
def _unpickle_work(pickled_work: bytes) -> Any:
    """Unpickle and cache work and plan, which are far larger than a block number."""
    return pickle.loads(pickled_work)


@lru_cache(maxsize=4)
def _check_worker_library_versions(submitter_versions: tuple[tuple[str, str], ...]) -> None:
    """Raise if the worker has other versions: workers may join while a study runs."""
    expected_versions = dict(submitter_versions)
    names = keys_with_different_values(expected_versions, library_versions())
    if names:
        raise DechirpError(
            Mistake(
                setting=f"worker on {platform.node()}",
                value=", ".join(
                    f"{name} {library_versions().get(name, 'missing')}" for name in names
                ),
                expected=", ".join(
                    f"{name} {expected_versions.get(name, 'missing')}" for name in names
                ),
                fix="install the same versions there, and call again to go on",
            )
        )
