"""Signals that end a command, SIGINT and SIGTERM, also where a library swallows their exception."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_RETRY_S = 0.05


@contextmanager
def interrupted_by_signals() -> Iterator[list[int]]:
    """Raise KeyboardInterrupt in the block on SIGINT and SIGTERM; yield the numbers received.

    A callback of a compiled library cannot pass an exception on: LLVM calls back while Numba
    compiles. The exception is then not reported, but the signal is sent again; the library may
    also raise an error of its own, to be treated as the interrupt.
    A signal that is ignored on entry (`nohup`, background jobs) stays ignored.
    """
    received: list[int] = []
    timers: list[threading.Timer] = []

    def interrupt(number: int, _frame: FrameType | None) -> NoReturn:
        received.append(number)
        raise KeyboardInterrupt

    def send_again(report: "UnraisableHookArgs") -> None:
        if not (received and issubclass(report.exc_type, KeyboardInterrupt)):
            report_unraisable(report)
            return
        timer = threading.Timer(_RETRY_S, os.kill, (os.getpid(), received[0]))
        timer.daemon = True
        timer.start()
        timers.append(timer)

    report_unraisable, sys.unraisablehook = sys.unraisablehook, send_again
    earlier = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for number, handler in earlier.items():
        if handler != signal.SIG_IGN:
            signal.signal(number, interrupt)
    try:
        yield received
    finally:
        sys.unraisablehook = report_unraisable
        for timer in timers:
            timer.cancel()
        for number, handler in earlier.items():
            signal.signal(number, handler)
