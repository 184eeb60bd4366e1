"""Threads for compiled loops that let go of the interpreter."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")


def in_threads(n_threads: int, work: Callable[[T], None], jobs: Iterable[T]) -> None:
    """Do jobs that write to different places, some at a time; raise the first error."""
    if n_threads == 1:
        for job in jobs:
            work(job)
        return
    with ThreadPoolExecutor(n_threads) as pool:
        for _ in pool.map(work, jobs):
            pass


def slices(n: int, n_parts: int) -> list[slice]:
    """Cut n things into so many parts, as equal as can be; none is empty."""
    edges = [n * part // n_parts for part in range(n_parts + 1)]
    return [slice(a, b) for a, b in pairwise(edges) if a < b]
