"""Threads for compiled loops that release the interpreter lock."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from functools import cache
from itertools import pairwise
from threading import RLock
from typing import TypeVar

T = TypeVar("T")
_single_thread_lock = RLock()
_n_threads: ContextVar[int | None] = ContextVar("_n_threads", default=None)


def run_in_threads(n_threads: int, work: Callable[[T], None], jobs: Iterable[T]) -> None:
    """Run independent jobs on several threads; raise the first error.

    The calling thread works as well, so jobs may start jobs of their own.
    """
    remaining_jobs = iter(list(jobs))  # threads may share it; a generator refuses two at once

    def run_remaining() -> None:
        try:
            for job in remaining_jobs:
                work(job)
        except BaseException:
            for _ in remaining_jobs:  # empties the iterator, so that no thread starts another job
                pass
            raise

    futures = [
        _thread_pool().submit(copy_context().run, run_remaining) for _ in range(n_threads - 1)
    ]
    try:
        run_remaining()
    finally:
        errors = [future.exception() for future in futures if not future.cancel()]
    for error in errors:
        if error is not None:
            raise error


def thread_count() -> int:
    """Return the threads that loops of this block may use: all that NUMBA_NUM_THREADS allows."""
    return _n_threads.get() or _available_threads()


@contextmanager
def limit_threads(n_threads: int) -> Iterator[None]:
    """Use at most `n_threads` threads in loops inside the block."""
    token = _n_threads.set(n_threads)
    try:
        yield
    finally:
        _n_threads.reset(token)


@contextmanager
def exclusive_single_thread() -> Iterator[None]:
    """Run the block on one thread, and never two such blocks of a process at once.

    Some sums are split by the number of threads, and the split changes their rounding: on one
    thread they are the same on every machine. Buffers and warning filters belong to the process,
    so two blocks may not run at once.
    """
    with _single_thread_lock, limit_threads(1):
        yield


@cache
def _available_threads() -> int:
    if n_threads := os.environ.get("NUMBA_NUM_THREADS"):
        return max(int(n_threads), 1)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@cache
def _thread_pool() -> ThreadPoolExecutor:
    """Return the shared pool: threads take 0.2 ms to start, but 0.05 ms to wake."""
    return ThreadPoolExecutor(_available_threads())


# Threads do not survive in a forked process.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_thread_pool.cache_clear)


def split_range(n: int, n_parts: int) -> list[slice]:
    """Split range(n) into at most `n_parts` nearly equal slices, none of them empty."""
    edges = [n * part // n_parts for part in range(n_parts + 1)]
    return [slice(a, b) for a, b in pairwise(edges) if a < b]
