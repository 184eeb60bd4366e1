"""Repetition of interrupts whose exception a callback of a compiled library cannot pass on."""

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_RETRY_S = 0.05


@contextmanager
def repeat_lost_interrupts(
    exception: type[BaseException], repeat: Callable[[], None]
) -> Iterator[None]:
    """Call `repeat` on a thread, soon after a signal handler raised this exception in vain.

    LLVM calls back while Numba compiles. Python ignores an exception that is raised in such a
    callback and reports it on standard error; in the block it repeats the interrupt instead.
    """
    timers: list[threading.Timer] = []

    def repeat_later(report: "UnraisableHookArgs") -> None:
        if not issubclass(report.exc_type, exception):
            report_unraisable(report)
            return
        timer = threading.Timer(_RETRY_S, repeat)
        timer.daemon = True
        timer.start()
        timers.append(timer)

    report_unraisable, sys.unraisablehook = sys.unraisablehook, repeat_later
    try:
        yield
    finally:
        sys.unraisablehook = report_unraisable
        for timer in timers:
            timer.cancel()
