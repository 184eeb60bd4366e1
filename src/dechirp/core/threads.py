"""Threads for compiled loops that let go of the interpreter."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from threading import RLock
from typing import TypeVar

import numba

T = TypeVar("T")
_turn = RLock()


def in_threads(n_threads: int, work: Callable[[T], None], jobs: Iterable[T]) -> None:
    """Do jobs that write to different places, some at a time; raise the first error.

    The caller works too, so that jobs may themselves share out theirs.
    """
    left = iter(list(jobs))  # threads may share it; a generator refuses two at once

    def drain() -> None:
        try:
            for job in left:
                work(job)
        except BaseException:
            for _ in left:  # nobody begins another
                pass
            raise

    helpers = [_helpers().submit(drain) for _ in range(n_threads - 1)]
    try:
        drain()
    finally:
        errors = [helper.exception() for helper in helpers if not helper.cancel()]
    for error in errors:
        if error is not None:
            raise error


@contextmanager
def alone() -> Iterator[None]:
    """Work on one thread, in turn with all others of this process that do so.

    Some sums are cut by the number of threads, and rounded by the cut: on one they are the same
    wherever they are made. What is kept from call to call, and who hears warnings, belongs to
    the process, so two may not be at it at once.
    """
    with _turn:
        n_threads = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            yield
        finally:
            numba.set_num_threads(n_threads)


@cache
def _helpers() -> ThreadPoolExecutor:
    """Kept: threads take 0.2 ms to start, and 0.05 to wake."""
    return ThreadPoolExecutor(numba.get_num_threads())


# Threads do not live on in a forked process.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_helpers.cache_clear)


def slices(n: int, n_parts: int) -> list[slice]:
    """Cut n things into so many parts, as equal as can be; none is empty."""
    edges = [n * part // n_parts for part in range(n_parts + 1)]
    return [slice(a, b) for a, b in pairwise(edges) if a < b]
